"""Does it reproduce? Published numbers and claims against a results folder.

What decides is in `agreement`: all runs together, and each of the experiment's independent batches.
"""

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from math import inf, isfinite, isnan, nan
from typing import NamedTuple

from trackbench.evaluation.statistics import Estimate, z_score
from trackbench.experiment.grammar import STEP, plain
from trackbench.experiment.published import Claim, PublishedNumber
from trackbench.report import agreement, lost
from trackbench.report.agreement import NOT_MEASURED, NUMBER_WORDS, UNDECIDED, Verdict
from trackbench.report.evidence import Evidence, evidence_at
from trackbench.report.expressions import Expressions
from trackbench.report.results import Results
from trackbench.report.terms import MISSING, Term


class Compared(NamedTuple):
    """A published number, what was measured for it under one reading, and the verdict."""

    published: PublishedNumber
    label: str
    measured: Term
    verdict: Verdict
    fragile: bool
    note: str

    @property
    def printed_at(self) -> tuple[str, ...]:
        """Where it stands: readings of one number have this in common."""
        p = self.published
        return p.paper, p.table, p.row, p.filter, p.metric


class Judged(NamedTuple):
    """A claim, the verdict by the z of its weakest comparison (positive: in its favour), and why."""

    claim: Claim
    verdict: Verdict
    paired: bool
    fragile: bool
    note: str


class Ranked(NamedTuple):
    """Agreement of the order of the filters in one column of a published table."""

    paper: str
    table: str
    metric: str
    filters: int
    tau: float


class Reproduced(NamedTuple):
    """A published number under every reading of it that was tried."""

    rows: list[Compared]

    @property
    def best(self) -> Compared:
        """The reading that gives the number its verdict."""
        return min(self.rows, key=_rank)

    @property
    def readings(self) -> int:
        """How many were tried."""
        return len(self.rows)


@dataclass(frozen=True)
class Comparison:
    """Everything that is published about one experiment, with verdicts."""

    rows: list[Compared]
    claims: list[Judged]
    ranks: list[Ranked]

    @cached_property
    def numbers(self) -> list[Reproduced]:
        """A verdict for each published number, however many readings of it were tried."""
        found: dict[tuple[str, ...], list[Compared]] = defaultdict(list)
        for row in self.rows:
            found[row.printed_at].append(row)
        return [Reproduced(rows) for rows in found.values()]


def _rank(row: Compared) -> tuple[int, float]:
    """The best verdict first; of equal ones the nearest value."""
    printed, value = row.published.value, row.measured.value
    off = abs(value - printed) if not isinstance(printed, str) and isfinite(value) else inf
    return NUMBER_WORDS.index(row.verdict.word), off


def compare(results: Results) -> Comparison:
    """Hold the results against what is published about the experiment."""
    published, at = results.published, cache(partial(evidence_at, results))
    rows = [row for number in published.numbers for row in _readings(number, at(number.point))]
    claims = [judge(claim, at(claim.point)) for claim in published.claims]
    return Comparison(rows, claims, list(rank_agreement(rows)))


def judge(claim: Claim, evidence: Evidence | None) -> Judged:
    """The verdict on a claim: it holds if it does against every filter that it names."""
    if evidence is None or not claim.left or not claim.expression:
        return _unjudged(claim, _no_results(claim, evidence))
    single = _at_each_step(claim, evidence.whole)
    found = [_score(evidence, one, right) for one in single for right in claim.rights or [""]]
    if not found:
        return _unjudged(claim, f"nothing is known of {claim.left}'s {claim.expression}")
    weakest = min(found, key=lambda score: -inf if isnan(score.z) else score.z)
    z = agreement.weakest([score.z for score in found], len(single))
    every = all(score.batches for score in found)
    batches = zip(*(score.batches for score in found), strict=True) if every else ()
    of_batches = [agreement.weakest(zs, len(single)) for zs in batches]
    verdict = agreement.of_claim(z, of_batches, claim.relation == "~")
    if isnan(weakest.off.term.value):
        verdict = verdict._replace(word=NOT_MEASURED)
    losing = [_loses_more(evidence.whole, claim, right) for right in claim.rights]
    if verdict.word == "holds" and any(losing):
        verdict = verdict._replace(word=UNDECIDED)
    fragile = any(score.off.term.fragile for score in found)
    surely = sum(score.z >= agreement.SURE for score in found)
    steps = f"{surely} of {len(found)} comparisons hold by themselves" if len(single) > 1 else ""
    note = _joined(*losing, _why(evidence.whole, weakest), steps, claim.note)
    return Judged(claim, verdict, weakest.off.splits, fragile, note)


def _unjudged(claim: Claim, why: str) -> Judged:
    return Judged(claim, Verdict(NOT_MEASURED, nan), False, False, _joined(why, claim.note))


def _at_each_step(claim: Claim, whole: Expressions) -> list[Claim]:
    """The claim at each of the steps that it is about; or itself, if that is no matter of steps."""
    left = whole.at_each_step(claim.left, claim.expression)
    right = whole.at_each_step(claim.left, claim.right_expression)
    return [
        replace(claim, expression=a, right_expression=b)
        for a, b in zip(left, right if len(right) == len(left) else right * len(left), strict=True)
    ]


class _Off(NamedTuple):
    """What tells how far a claim's left side is off, what it is at the claim's edge, and its target."""

    term: Term
    edge: float
    target: float

    @property
    def splits(self) -> bool:
        """Whether batches of runs have it, too."""
        return self.term.splits

    def in_favour(self, claim: Claim) -> float:
        """z of the claim."""
        if claim.relation == "~":
            room = claim.tolerance * abs(self.target)
            off = Estimate(room - abs(self.term.value - self.edge), self.term.stderr)
            return z_score(off)
        z = self.term.z(self.edge)
        return -z if claim.relation == "<" else z


class _Score(NamedTuple):
    """The claim against one filter: z in its favour, of each batch too; how far it is off."""

    claim: Claim
    right: str
    z: float
    batches: list[float]
    off: _Off


def _score(evidence: Evidence, claim: Claim, right: str) -> _Score:
    """The claim against one filter of its right side, or against its factor if there is none."""
    off, of_batches = evidence.of(lambda expressions: _off(expressions, claim, right))
    zs = [of_batch.in_favour(claim) for of_batch in of_batches]
    return _Score(claim, right, off.in_favour(claim), zs, off)


def _off(expressions: Expressions, claim: Claim, right: str) -> _Off:
    left = (claim.left, claim.expression)
    if not right:
        return _Off(expressions.term(*left), claim.factor, claim.factor)
    other = (right, claim.right_expression or claim.expression)
    target = claim.factor * expressions.term(*other).value
    return _Off(expressions.difference(left, other, claim.factor), 0.0, target)


def _why(whole: Expressions, score: _Score) -> str:
    """Both sides of a comparison, in words."""
    claim, right, step = score.claim, score.right, STEP.fullmatch(plain(score.claim.expression))
    sides = [(claim.left, claim.expression)]
    sides += [(right, claim.right_expression or claim.expression)] if right else []
    why = [_in_words(label, whole.term(label, expression)) for label, expression in sides]
    why += [] if right else [f"{score.off.target:g}"]
    why += [f"at step {step.group(2)}"] if step else []
    return ", ".join(why) + ("; no standard error" if isnan(score.off.term.stderr) else "")


def _in_words(label: str, term: Term) -> str:
    return f"{label} {term.value:.4g}" + (f" ({term.losses})" if term.lost else "")


def _loses_more(expressions: Expressions, claim: Claim, right: str) -> str:
    """Why a filter whose error is said to be smaller is not better: it loses more of the same runs."""
    a, b = (expressions.runs.get((label, "lost")) for label in (claim.left, right))
    if claim.relation != "<" or a is None or b is None or not lost.loses_more(a, b):
        return ""
    return f"{claim.left} loses {int((a > 0).sum())} runs, {right} {int((b > 0).sum())}"


def rank_agreement(rows: list[Compared]) -> Iterator[Ranked]:
    """Kendall's tau between the published and the measured order, per column with three filters."""
    columns: dict[tuple[str, str, str, str], list[Compared]] = defaultdict(list)
    for row in rows:
        if isfinite(row.measured.value) and not isinstance(row.published.value, str):
            p = row.published
            columns[p.paper, p.table, p.row, p.metric].append(row)
    for (paper, table, part, metric), found in columns.items():
        if len(found) < 3 or len({r.published.filter for r in found}) < len(found):
            continue
        from scipy.stats import kendalltau  # half a second that most experiments need not wait

        order = kendalltau(
            [r.published.value for r in found], [r.measured.value for r in found]
        ).statistic
        heading = f"{metric}, {part}" if part else metric
        yield Ranked(paper, table, heading, len(found), float(order))


def _no_results(row: PublishedNumber | Claim, evidence: Evidence | None) -> str:
    return "" if evidence is not None else f"no results at {row.point}"


def _readings(number: PublishedNumber, evidence: Evidence | None) -> Iterator[Compared]:
    if evidence is None or not number.labels or not number.expression:
        note = _joined(_no_results(number, evidence), number.note)
        yield Compared(number, "", MISSING, Verdict(NOT_MEASURED, nan), False, note)
        return
    for label in number.labels:
        measured, of_batches = evidence.of(partial(_term, label, number.expression))
        verdict = agreement.of_number(number, measured, of_batches)
        note = _joined(measured.losses, number.chosen, number.note)
        yield Compared(number, label, measured, verdict, measured.fragile, note)


def _term(label: str, expression: str, expressions: Expressions) -> Term:
    return expressions.term(label, expression)


def _joined(*notes: str) -> str:
    return "; ".join(filter(None, notes))
