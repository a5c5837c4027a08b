"""Table kinds that search the readings of a paper.

`readings` ranks them by the distance to all printed numbers, `claim-readings` by the claims that hold.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from math import comb, inf, isfinite, nan
from typing import Literal, NamedTuple

import numpy as np

from trackbench.config.mistakes import unknown
from trackbench.config.published import Claim, PublishedNumber, read_published
from trackbench.core import elementary
from trackbench.errors import Mark, Problem, UserError
from trackbench.field_types import Count, Digits
from trackbench.registry import register
from trackbench.report.expressions import Evaluator
from trackbench.report.kinds import TableKind
from trackbench.report.results import Results
from trackbench.report.table import Cell, Table, rounded
from trackbench.report.verdicts.claims import judge
from trackbench.report.verdicts.searches import searched_points, ways_to_measure
from trackbench.results.point_facts import GridPoint
from trackbench.statistics.comparison import as_family, compare_estimates
from trackbench.statistics.estimates import RunEstimate
from trackbench.statistics.over_runs import Estimate, mean
from trackbench.statistics.rules import CLAIM_WORDS, NEAR


class Number(NamedTuple):
    """A printed number of a filter, what is measured for it, and whether it is a variance."""

    label: str
    printed: float
    measured: RunEstimate
    is_variance: bool = False

    @property
    def power(self) -> float:
        """Power of ten by which both numbers are scaled for comparison."""
        return 0.5 if self.is_variance else 1.0


class Distance(NamedTuple):
    """Root mean square of log(measured / printed), and how many numbers are within 10 %."""

    estimate: RunEstimate
    """its error covers the runs, not the choice among interpretations"""
    near: int


@register("tables", "readings")
@dataclass(frozen=True, kw_only=True)
class Readings(TableKind):
    """The points of the grid, each a reading of a paper, by their distance to what it prints.

    The distance is the root mean square, over the printed numbers of the filters, of
    log(measured / printed): 0.1 is about 10 %. Of a variance the root is taken, which has the unit of
    the other numbers. Numbers that are made of others (ratios, gains) are left out, and so are words; a
    reading that loses most runs of a filter is infinitely far. Points that differ only in keys of
    filters that do not count are one reading. Where the published files measure a number in several ways
    (the range of the mean, the mean range), each way is a reading of its own, one for all filters. The
    nearest of many readings is nearer than one chosen beforehand: the notes say how many were tried, and
    how many of them are not significantly farther, by the rule for filters over all pairs of readings.

    Every printed number also gets a verdict, under the reading that is best for it alone, and counts in
    the ledger with it. Ratios and gains get one, too.
    """

    of: str
    """experiment whose rows in the published files are held against every point"""
    filters: tuple[str, ...] | None = None
    """labels of the filters whose numbers count; default: all"""
    statistics: tuple[Literal["time-mean", "mean", "rms", "median"], ...] = ()
    """what a printed error may be, each a reading: the mean over steps of the RMSE over runs, or a
    statistic of the runs' RMSE; default: what the published rows say"""
    chosen: dict[str, str] = field(default_factory=dict)
    """printed numbers to which a setting of the grid was fitted, as `METRIC` or `FILTER: METRIC`, and
    the setting, in words: their verdict is `inconclusive`"""
    rows: Count = 10
    """how many readings are shown"""
    digits: Digits = 3
    """significant digits of the values"""

    def table(self, results: Results) -> Table:
        """Rank the readings by the distance of their numbers from the printed ones."""
        # Step 1: printed numbers, distinct points of the grid, ways to measure the numbers.
        numbers = self._numbers(results)
        measured = set[str]().union(*(number.labels for number in numbers))
        labels = [label for label in results.filters if label in measured]
        heads, points = searched_points(results, labels)
        more, ways = ways_to_measure(numbers, self.statistics)
        heads += more
        printed = len(ways[0][1]) if numbers else 0
        # Step 2: distance of each point measured in each way, the nearest first.
        tried = []
        for shown, point in points:
            expressions = Evaluator(results, point)
            for way, chosen in ways:
                every = _measured(expressions, chosen)
                parts = []
                for label in labels:
                    parts.append(distance([number for number in every if number.label == label]))
                tried.append(([*shown, *way], distance(every), parts))
        tried.sort(key=lambda reading: reading[1].estimate.value)
        # Step 3: a row per reading; of several filters also the distance of each.
        columns = ["Distance", *labels] if len(labels) > 1 else ["Distance"]
        table = Table(self.title, ["Rank", *heads], columns, self.digits)
        for rank, (shown, whole, parts) in enumerate(tried[: self.rows], start=1):
            cells = [whole, *parts] if len(labels) > 1 else [whole]
            table.add([str(rank), *shown], [Cell.of(d.estimate) for d in cells])
        if numbers:
            table.notes += _notes(heads, [(shown, whole) for shown, whole, _ in tried], printed)
        else:
            table.notes.append(f"Nothing is published about {self.of} that these filters measure.")
        return table

    def _numbers(self, results: Results) -> list[PublishedNumber]:
        paths = results.config.get("published", [])
        published = read_published(results.folder, paths, self.of)
        self._check_chosen(published.numbers)
        wanted = results.filters if self.filters is None else self.filters
        numbers = []
        for number in published.numbers:
            is_made = number.expression is None or number.expression.relation
            if set(number.labels) & set(wanted) and not (isinstance(number.value, str) or is_made):
                numbers.append(number)
        return numbers

    def _check_chosen(self, numbers: list[PublishedNumber]) -> None:
        """Reject a key of `chosen` that names no printed number."""
        named = dict.fromkeys(number.metric for number in numbers)
        named |= dict.fromkeys(f"{number.filter}: {number.metric}" for number in numbers)
        for key in self.chosen:
            if key not in named:
                what = f"{key!r} is no printed number of {self.of}; {unknown(key, [*named])}"
                raise UserError(Problem(Mark("tables"), "chosen", what))


def distance(numbers: list[Number]) -> Distance:
    """Return the distance of what is measured from what is printed."""
    terms = [number.measured for number in numbers]
    runs = max((len(t.influences) for t in terms if t.influences is not None), default=0)
    lost = max((t.lost for t in terms), default=0)
    influences, squares, near = np.zeros(runs), 0.0, 0
    for number in numbers:
        term, printed = number.measured, number.printed
        if not (isfinite(term.value) and term.value > 0.0 < printed) or term.lost > term.runs:
            return Distance(RunEstimate(inf, nan, None, runs - lost, lost), 0)
        # log(measured / printed), half of it for a variance
        off = number.power * float(elementary.log(term.value / printed))
        squares += off * off
        near += abs(term.value - printed) <= NEAR * printed
        # d distance = sum off power dx / x / (n distance), x the measured value
        if term.influences is not None:
            share = runs / term.runs  # of survivors, each counts for more
            influences += off * number.power / term.value * share * np.nan_to_num(term.influences)
    value = float(np.sqrt(squares / max(len(numbers), 1)))
    influences = influences / (len(numbers) * value) if value else influences
    estimate = RunEstimate(value, mean(influences).stderr, influences, runs - lost, lost)
    return Distance(estimate, near)


def _measured(expressions: Evaluator, numbers: list[PublishedNumber]) -> list[Number]:
    measured = []
    for number in numbers:
        if (m := number.expression) is not None:
            printed, is_variance = float(number.value), m.statistic == "variance"
            for label in number.labels:
                term = expressions.term(m.of(label))
                measured.append(Number(label, printed, term, is_variance))
    return measured


def _notes(heads: list[str], tried: list[tuple[list[str], Distance]], numbers: int) -> list[str]:
    shown, nearest = tried[0]
    finite = [d.estimate for _, d in tried if isfinite(d.estimate.value)]
    lost = len(tried) - len(finite)
    what = f"{len(tried)} readings, {lost} of which lose most runs of a filter"
    notes = [f"{what}; {numbers} printed numbers."]
    if finite:
        pairs = {i: compare_estimates(d, nearest.estimate) for i, d in enumerate(finite)}
        # The nearest is one of many: the family is of all pairs.
        family = as_family(pairs, tests=comb(len(finite), 2))
        alike = sum(comparison.sign == 0 for comparison in family.values())
        what = f"distance {rounded(*nearest.estimate.estimate, 3)}"
        what += f", {nearest.near} of {numbers} numbers within 10 %"
        further = f"Not significantly farther, itself counted: {alike}"
        notes.append(f"Nearest: {_named(heads, shown)}; {what}. {further}.")
        shown, most = max(tried, key=lambda reading: reading[1].near)
        if most.near > nearest.near:
            where = _named(heads, shown)
            notes.append(f"Most numbers within 10 %: {where}; {most.near} of {numbers}.")
    return notes


def _named(heads: list[str], shown: list[str]) -> str:
    return ", ".join(f"{head} {value}" for head, value in zip(heads, shown, strict=True))


@register("tables", "claim-readings")
@dataclass(frozen=True, kw_only=True)
class ClaimReadings(TableKind):
    """The points of the grid, each a reading of a paper, by how many of its claims hold there.

    For a paper that prints no numbers. Of equal readings the one with fewer claims that fail comes
    first. The verdicts are those of the comparison, over all batches of runs; claims about times, and
    those that nothing here measures, are left out. With many readings one does well by chance: the notes
    say how many were tried, how many do as well, and at how many each claim holds.
    """

    of: str
    """experiment whose claims in the published files are judged at every point"""
    rows: Count = 10
    """how many readings are shown"""

    def table(self, results: Results) -> Table:
        """Rank the readings by the number of claims that hold."""
        # Step 1: judge every claim at every point.
        heads, points = searched_points(results, list(results.filters))
        claims, verdicts = _judged(results, self._claims(results), [point for _, point in points])
        if not claims:
            note = f"Nothing is claimed in {self.of} that these filters measure."
            return Table(self.title, ["Rank"], [], digits=1, notes=[note])
        # Step 2: the most claims that hold come first, then the fewest that fail.
        tried = [(shown, words) for (shown, _), words in zip(points, verdicts, strict=True)]
        tried.sort(key=lambda reading: (-reading[1].count("holds"), reading[1].count("fails")))
        table = Table(self.title, ["Rank", *heads], [w.capitalize() for w in CLAIM_WORDS], digits=1)
        for rank, (shown, words) in enumerate(tried[: self.rows], start=1):
            cells = [Cell(Estimate(words.count(w), nan), 0, 0) for w in CLAIM_WORDS]
            table.add([str(rank), *shown], cells)
        table.notes += _claim_notes(heads, claims, tried)
        return table

    def _claims(self, results: Results) -> list[Claim]:
        published = read_published(results.folder, results.config.get("published", []), self.of)
        claims = []
        for claim in published.claims:
            is_of_time = any(m.metric.startswith("cpu_s") for m in claim.expressions)
            if claim.labels and set(claim.labels) <= {*results.filters} and not is_of_time:
                claims.append(claim)
        return claims


def _judged(
    results: Results, claims: list[Claim], points: list[GridPoint]
) -> tuple[list[Claim], list[list[str]]]:
    """Judge at every point the claims that any point measures."""
    evidence = [Evaluator(results, point) for point in points]
    measured, by_claim = [], []
    for claim in claims:
        verdicts = [judge(claim, at_point) for at_point in evidence]
        if any(judged.is_measured for judged in verdicts):
            measured.append(claim)
            by_claim.append([judged.verdict.word for judged in verdicts])
    return measured, [list(words) for words in zip(*by_claim, strict=True)]


def _claim_notes(
    heads: list[str], claims: list[Claim], tried: list[tuple[list[str], list[str]]]
) -> Iterator[str]:
    first, hold = tried[0][0], [words.count("holds") for _, words in tried]
    most = f"Most hold at {_named(heads, first)}: {hold[0]}; as many at {hold.count(hold[0])}"
    yield f"{len(tried)} readings, {len(claims)} claims. {most} of the readings."
    for i, claim in enumerate(claims):
        words = [verdicts[i] for _, verdicts in tried]
        holds, fails = words.count("holds"), words.count("fails")
        yield f"{claim.claim}: holds at {holds}, fails at {fails} of the readings."
