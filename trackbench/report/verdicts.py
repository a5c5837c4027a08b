"""Does it reproduce? Published numbers and claims against a results folder.

What decides is in `agreement`: all runs together, and each of the experiment's independent batches.
"""

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from math import inf, isfinite, isnan, nan
from typing import Any, NamedTuple

from trackbench.evaluation.statistics import Estimate, z_score
from trackbench.experiment.published import Claim, PublishedNumber, split
from trackbench.experiment.source import scalar
from trackbench.report import agreement, lost
from trackbench.report.agreement import NOT_MEASURED, NUMBER_WORDS, UNDECIDED, Verdict
from trackbench.report.expressions import Expressions, Term
from trackbench.report.results import Results


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
    """A published number by its best reading, out of so many."""

    best: Compared
    readings: int


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
        return [Reproduced(min(rows, key=_rank), len(rows)) for rows in found.values()]


def _rank(row: Compared) -> tuple[int, float]:
    """The best verdict first; of equal ones the nearest value."""
    printed, value = row.published.value, row.measured.value
    off = abs(value - printed) if not isinstance(printed, str) and isfinite(value) else inf
    return NUMBER_WORDS.index(row.verdict.word), off


def compare(results: Results) -> Comparison:
    """Hold the results against what is published about the experiment."""
    published = results.published
    rows = [row for number in published.numbers for row in _readings(results, number)]
    claims = [judge(results, claim) for claim in published.claims]
    return Comparison(rows, claims, list(rank_agreement(rows)))


def judge(results: Results, claim: Claim, point: dict[str, Any] | None = None) -> Judged:
    """The verdict on a claim, at its own point unless told: it holds if it does against every filter."""
    point = point_of(results, claim.point) if point is None else point
    if point is None or not claim.left or not claim.expression:
        verdict = Verdict(NOT_MEASURED, nan)
        return Judged(claim, verdict, False, False, _unmeasured(claim, point))
    whole = Expressions(results, point)
    batches = whole.batches(seeds_of(results))
    found = [_score(whole, batches, claim, right) for right in claim.rights or [""]]
    weakest = min(found, key=lambda score: -inf if isnan(score.z) else score.z)
    every = all(score.batches for score in found)
    of_batches = [min(zs) for zs in zip(*(s.batches for s in found), strict=True)] if every else []
    verdict = agreement.of_claim(weakest.z, of_batches, claim.relation == "~")
    if isnan(weakest.off):
        verdict = verdict._replace(word=NOT_MEASURED)
    if verdict.word == "holds" and any(score.loses_more for score in found):
        verdict = verdict._replace(word=UNDECIDED)
    fragile = any(score.fragile for score in found)
    note = _joined(*(score.loses_more for score in found), weakest.why, claim.note)
    return Judged(claim, verdict, weakest.paired, fragile, note)


def seeds_of(results: Results) -> int:
    """Number of independent batches that a verdict needs; 1 of a folder from before there were any."""
    seeds: int = results.config.get("verdict_seeds", 1)
    return seeds


class _Score(NamedTuple):
    """One comparison: z in the claim's favour, of each batch too; how far off; in words."""

    z: float
    batches: list[float]
    off: float
    paired: bool
    fragile: bool
    loses_more: str
    why: str


def _score(whole: Expressions, batches: list[Expressions], claim: Claim, right: str) -> _Score:
    """The claim against one filter of its right side, or against its factor if there is none."""
    off, target = _off(whole, claim, right)
    sides = [(claim.left, claim.expression)]
    sides += [(right, claim.right_expression or claim.expression)] if right else []
    why = [_in_words(label, whole.term(label, expression)) for label, expression in sides]
    why += [] if right else [f"{target:g}"]
    return _Score(
        _in_favour(claim, off, target),
        [_in_favour(claim, *_off(batch, claim, right)) for batch in batches] if off.splits else [],
        off.value,
        off.splits,
        off.fragile,
        _loses_more(whole, claim, right),
        ", ".join(why) + ("; no standard error" if isnan(off.stderr) else ""),
    )


def _in_words(label: str, term: Term) -> str:
    runs = term.runs + term.lost
    return f"{label} {term.value:.4g}" + (
        f" ({lost.in_words(term.lost, runs)})" if term.lost else ""
    )


def _off(expressions: Expressions, claim: Claim, right: str) -> tuple[Term, float]:
    """How far the left side is off its target, and the target."""
    left = (claim.left, claim.expression)
    if not right:
        a = expressions.term(*left)
        return a._replace(value=a.value - claim.factor), claim.factor
    other = (right, claim.right_expression or claim.expression)
    target = claim.factor * expressions.term(*other).value
    return expressions.difference(left, other, claim.factor), target


def _in_favour(claim: Claim, off: Term, target: float) -> float:
    """z of the claim, whose left side is so far off its target."""
    if claim.relation == "~":
        room = claim.tolerance * abs(target)
        return z_score(Estimate(room - abs(off.value), off.stderr))
    z = off.z()
    return -z if claim.relation == "<" else z


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


def point_of(results: Results, text: str) -> dict[str, Any] | None:
    """The point with results that ``path=value; path=value`` picks; the first one if it is empty."""
    wanted = {k.strip(): scalar(v.strip()) for k, _, v in (p.partition("=") for p in split(text))}
    for point in results.points():
        if all(point.get(path) == value for path, value in wanted.items()):
            return point
    return None


def _unmeasured(row: PublishedNumber | Claim, point: dict[str, Any] | None) -> str:
    return _joined("" if point is not None else f"no results at {row.point}", row.note)


def _readings(results: Results, number: PublishedNumber) -> Iterator[Compared]:
    point = point_of(results, number.point)
    if point is None or not number.labels or not number.expression:
        nothing = Term(nan, nan, None, 0)
        note = _unmeasured(number, point)
        yield Compared(number, "", nothing, Verdict(NOT_MEASURED, nan), False, note)
        return
    whole = Expressions(results, point)
    batches = whole.batches(seeds_of(results))
    for label in number.labels:
        measured = whole.term(label, number.expression)
        parts = [b.term(label, number.expression) for b in batches] if measured.splits else []
        verdict = agreement.of_number(number, measured, parts)
        runs = measured.runs + measured.lost
        losses = lost.in_words(measured.lost, runs) if measured.lost else ""
        note = _joined(losses, number.chosen, number.note)
        yield Compared(number, label, measured, verdict, measured.fragile, note)


def _joined(*notes: str) -> str:
    return "; ".join(filter(None, notes))
