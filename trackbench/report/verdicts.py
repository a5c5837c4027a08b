"""Does it reproduce? Published numbers and claims against a results folder.

A number `agrees` when it is within three combined standard errors (theirs from our spread over runs and
their number of runs) or rounds to the printed digits; it is `near` within 10 %; else it `differs`, as it
does when most runs are lost. A claim `holds` or `fails` when its paired z is beyond three, else it is
`not decided`.
"""

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from math import hypot, inf, isfinite, isnan, nan, sqrt
from typing import Any, NamedTuple

from trackbench.evaluation.statistics import Estimate, z_score
from trackbench.experiment.published import Claim, PublishedNumber, split
from trackbench.experiment.source import scalar
from trackbench.report.expressions import Expressions, Term
from trackbench.report.results import Results

SURE = 3.0
"""Standard errors beyond which a difference is taken for real."""
NEAR = 0.1
"""Share of a published number that still counts as near."""
NOT_MEASURED = "not measured"


class Compared(NamedTuple):
    """A published number, what was measured for it, and the verdict."""

    published: PublishedNumber
    label: str
    measured: Term
    z: float
    verdict: str
    note: str


class Judged(NamedTuple):
    """A claim, the z of its weakest comparison (positive: in its favour), the verdict, and why."""

    claim: Claim
    z: float
    paired: bool
    verdict: str
    note: str


class Ranked(NamedTuple):
    """Agreement of the order of the filters in one column of a published table."""

    paper: str
    table: str
    metric: str
    filters: int
    tau: float


class _Score(NamedTuple):
    """One comparison: z in the claim's favour, how far off, on common runs or not, in words."""

    z: float
    off: float
    paired: bool
    why: str


@dataclass(frozen=True)
class Comparison:
    """Everything that is published about one experiment, with verdicts."""

    numbers: list[Compared]
    claims: list[Judged]
    ranks: list[Ranked]


def compare(results: Results) -> Comparison:
    """Hold the results against what is published about the experiment."""
    published = results.published
    numbers = [row for number in published.numbers for row in _numbers(results, number)]
    claims = [judge(results, claim) for claim in published.claims]
    return Comparison(numbers, claims, list(rank_agreement(numbers)))


def verdict(number: PublishedNumber, measured: Term) -> tuple[str, float]:
    """Verdict and z of a measured number; a word is decided by whether zero is excluded."""
    value, stderr = measured.estimate
    if measured.lost > measured.runs > 0:
        return "differs", inf  # what survives says nothing of the filter
    if not isfinite(value):
        return (NOT_MEASURED, nan) if not measured.lost else ("differs", inf)
    if isinstance(number.value, str):
        z = z_score(Estimate(value, stderr))
        word = "biased" if abs(z) >= SURE else "unbiased"
        return ("agrees" if word == number.value else "differs"), z
    theirs = stderr * sqrt(measured.runs / number.runs) if number.runs else 0.0
    off = value - number.value
    z = z_score(Estimate(off, hypot(stderr, theirs)))
    if abs(z) <= SURE or abs(off) <= 0.5 * 10.0**-number.digits:
        return "agrees", z
    return ("near" if abs(off) <= NEAR * abs(number.value) else "differs"), z


def judge(results: Results, claim: Claim) -> Judged:
    """The verdict on a claim: it holds if it does against every filter it names."""
    point = point_of(results, claim.point)
    if point is None or not claim.left or not claim.expression:
        return Judged(claim, nan, False, NOT_MEASURED, _unmeasured(claim, point))
    expressions = Expressions(results, point)
    found = [_score(expressions, claim, right) for right in claim.rights or [""]]
    weakest = min(found, key=lambda score: -inf if isnan(score.z) else score.z)
    z, paired = weakest.z, weakest.paired
    word = "holds" if z >= SURE else "fails" if z <= -SURE else "not decided"
    if isnan(weakest.off):
        word = NOT_MEASURED
    return Judged(claim, z, paired, word, _joined(weakest.why, claim.note))


def rank_agreement(numbers: list[Compared]) -> Iterator[Ranked]:
    """Kendall's tau between the published and the measured order, per column with three filters."""
    columns: dict[tuple[str, str, str, str], list[Compared]] = defaultdict(list)
    for row in numbers:
        if isfinite(row.measured.value) and not isinstance(row.published.value, str):
            p = row.published
            columns[p.paper, p.table, p.row, p.metric].append(row)
    for (paper, table, part, metric), rows in columns.items():
        if len(rows) < 3 or len({r.published.filter for r in rows}) < len(rows):
            continue
        from scipy.stats import kendalltau  # half a second that most experiments need not wait

        order = kendalltau(
            [r.published.value for r in rows], [r.measured.value for r in rows]
        ).statistic
        heading = f"{metric}, {part}" if part else metric
        yield Ranked(paper, table, heading, len(rows), float(order))


def point_of(results: Results, text: str) -> dict[str, Any] | None:
    """The point with results that ``path=value; path=value`` picks; the first one if it is empty."""
    wanted = {k.strip(): scalar(v.strip()) for k, _, v in (p.partition("=") for p in split(text))}
    for point in results.points():
        if all(point.get(path) == value for path, value in wanted.items()):
            return point
    return None


def _unmeasured(row: PublishedNumber | Claim, point: dict[str, Any] | None) -> str:
    return _joined("" if point is not None else f"no results at {row.point}", row.note)


def _numbers(results: Results, number: PublishedNumber) -> Iterator[Compared]:
    point = point_of(results, number.point)
    if point is None or not number.labels or not number.expression:
        nothing = Term(nan, nan, None, 0)
        yield Compared(number, "", nothing, nan, NOT_MEASURED, _unmeasured(number, point))
        return
    expressions = Expressions(results, point)
    for label in number.labels:
        measured = expressions.term(label, number.expression)
        word, z = verdict(number, measured)
        yield Compared(number, label, measured, z, word, _note(number, measured, word))


def _note(number: PublishedNumber, measured: Term, word: str) -> str:
    notes = []
    if measured.lost:
        notes.append(f"{measured.lost} of {measured.runs + measured.lost} runs lost")
    wide = word == "agrees" and not isinstance(number.value, str)
    if wide and SURE * measured.stderr > 0.5 * abs(float(number.value)):
        notes.append("too few runs to tell")
    return _joined(*notes, number.note)


def _joined(*notes: str) -> str:
    return "; ".join(filter(None, notes))


def _score(expressions: Expressions, claim: Claim, right: str) -> _Score:
    """The claim against one filter of its right side, or against its factor if there is none."""
    left = (claim.left, claim.expression)
    a = expressions.term(*left)
    why = f"{claim.left} {a.value:.4g}" + (f" ({a.lost} runs lost)" if a.lost else "")
    if right:
        other = (right, claim.right_expression or claim.expression)
        b = expressions.term(*other).value
        difference = expressions.difference(left, other, claim.factor)
        off, paired = difference.estimate, difference.influences is not None
        target, why = claim.factor * b, f"{why}, {right} {b:.4g}"
    else:
        off, paired = Estimate(a.value - claim.factor, a.stderr), True
        target, why = claim.factor, f"{why}, {claim.factor:g}"
    why += "; no standard error" if isnan(off.stderr) else ""
    return _Score(_in_favour(claim, off, target), off.value, paired, why)


def _in_favour(claim: Claim, off: Estimate, target: float) -> float:
    """z of the claim, whose left side is so far off its target."""
    if claim.relation == "~":
        room = claim.tolerance * abs(target)
        return z_score(Estimate(room - abs(off.value), off.stderr))
    z = z_score(off)
    return -z if claim.relation == "<" else z
