"""Table kinds that search the readings of a paper.

`readings` ranks them by the distance to all printed numbers, `claim-readings` by the claims that hold.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from math import comb, inf, isfinite, nan
from typing import Literal, NamedTuple

import numpy as np

from trackbench.config.key_mistakes import unknown
from trackbench.config.published_csv import Claim, PublishedNumber, read_published
from trackbench.core import elementary
from trackbench.errors import Mark, Problem, UserError
from trackbench.field_types import Count, Digits
from trackbench.registry import register
from trackbench.report.expressions import Evaluator
from trackbench.report.kinds import TableKind
from trackbench.report.table import Cell, Table, rounded
from trackbench.report.tables_and_figures import Results
from trackbench.report.verdicts.claims import judge
from trackbench.report.verdicts.searches import searched_points, ways_to_measure
from trackbench.statistics.comparison import as_family, compare_estimates
from trackbench.statistics.estimates import RunEstimate
from trackbench.statistics.sample_statistics import Estimate, mean
from trackbench.statistics.significance_rules import NEAR
from trackbench.statistics.verdict_rules import CLAIM_WORDS, UNDECIDED


class Number(NamedTuple):
    """A printed number of a filter, and what is measured for it."""

    label: str
    printed: float
    measured: RunEstimate
    is_variance: bool = False

    @property
    def power(self) -> float:
        """Power to which both numbers are raised for comparison: the root is taken of a variance."""
        if self.is_variance:
            return 0.5
        return 1.0


class Distance(NamedTuple):
    """Root mean square of log(measured / printed), and how many numbers are within 10 %."""

    estimate: RunEstimate
    """its error covers the runs, not the choice among interpretations"""
    near: int
    """number of the measured numbers within 10 % of the printed ones"""
    loses_most: bool = False
    """True if the distance is infinite because a filter loses most of its runs"""


class RankedReading(NamedTuple):
    """A reading of the printed numbers: a point of the grid, and a way to measure them."""

    values: list[str]
    """what distinguishes the reading, in the order of the headings"""
    distance: Distance
    """of all printed numbers"""
    filter_distances: list[Distance]
    """of the numbers of each filter"""


@register("tables", "readings")
@dataclass(frozen=True, kw_only=True)
class Readings(TableKind):
    """The points of the grid, each a reading of a paper, by their distance to what it prints.

    The distance is the root mean square, over the printed numbers of the filters, of
    log(measured / printed): 0.1 is about 10 %. Of a variance the root is taken, which has the unit of
    the other numbers. Numbers that are made of others (ratios, gains) are left out, and so are words; a
    reading that loses most runs of a filter is infinitely far, and so is one with a number that is not
    positive. Points that differ only in keys of filters that do not count are one reading. Where the
    published files measure a number in several ways (the range of the mean, the mean range), each way is
    a reading of its own, one for all filters. The nearest of many readings is nearer than one chosen
    beforehand: the notes say how many were tried, and how many of them are not significantly farther, by
    the rule for filters over all pairs of readings.

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
        """Rank the readings by the distance of their measured numbers from the printed ones.

        A reading is a point of the grid together with a way to measure the printed numbers.
        """
        # Step 1: printed numbers, distinct points of the grid, ways to measure the numbers.
        numbers = self._published_numbers(results)
        measured_labels = set[str]().union(*(number.labels for number in numbers))
        labels = [label for label in results.filters if label in measured_labels]
        point_heads, points = searched_points(results, labels)
        way_heads, ways = ways_to_measure(numbers, self.statistics)
        heads = [*point_heads, *way_heads]
        # Step 2: distance of each point measured in each way, the nearest first.
        readings = []
        for point_values, point in points:
            evaluator = Evaluator(results, point)
            for way_values, numbers_of_way in ways:
                measured = _measure(evaluator, numbers_of_way)
                filter_distances = []
                for label in labels:
                    numbers_of_filter = [number for number in measured if number.label == label]
                    filter_distances.append(distance(numbers_of_filter))
                readings.append(
                    RankedReading(
                        values=[*point_values, *way_values],
                        distance=distance(measured),
                        filter_distances=filter_distances,
                    )
                )
        readings.sort(key=lambda reading: reading.distance.estimate.value)
        # Step 3: a row per reading; of several filters also the distance of each.
        several = len(labels) > 1
        columns = ["Distance"]
        if several:
            columns += labels
        table = Table(self.title, ["Rank", *heads], columns, self.digits)
        for rank, reading in enumerate(readings[: self.rows], start=1):
            distances = [reading.distance]
            if several:
                distances += reading.filter_distances
            cells = [Cell.of(distance_of_reading.estimate) for distance_of_reading in distances]
            table.add([str(rank), *reading.values], cells)
        if numbers:
            _, numbers_of_first_way = ways[0]
            table.notes += _notes(heads, readings, len(numbers_of_first_way))
        else:
            table.notes.append(f"Nothing is published about {self.of} that these filters measure.")
        return table

    def _published_numbers(self, results: Results) -> list[PublishedNumber]:
        """Read the printed numbers of the chosen filters, without words, ratios and gains."""
        paths = results.config.get("published", [])
        published = read_published(results.folder, paths, self.of)
        self._check_chosen(published.numbers)
        counted_labels = set(results.filters if self.filters is None else self.filters)
        numbers = []
        for number in published.numbers:
            is_word = isinstance(number.value, str)
            # A ratio or gain follows from numbers that count by themselves.
            is_ratio_or_gain = number.expression is None or number.expression.relation
            if is_word or is_ratio_or_gain:
                continue
            if counted_labels & set(number.labels):
                numbers.append(number)
        return numbers

    def _check_chosen(self, numbers: list[PublishedNumber]) -> None:
        """Reject a key of `chosen` that names no printed number."""
        names = dict.fromkeys(number.metric for number in numbers)
        names |= dict.fromkeys(f"{number.filter}: {number.metric}" for number in numbers)
        for key in self.chosen:
            if key not in names:
                message = f"{key!r} is no printed number of {self.of}; {unknown(key, [*names])}"
                raise UserError(Problem(Mark("tables"), "chosen", message))


def distance(numbers: list[Number]) -> Distance:
    """Return the distance of the measured numbers from the printed ones.

    The distance is the root mean square of ``log(measured / printed)``. Of variances the square roots
    are compared. The distance is infinite if a number is not positive or not finite. It is also infinite
    if a number has lost most of its runs, as the few others do not represent the filter.
    """
    terms = [number.measured for number in numbers]
    runs = max((len(t.influences) for t in terms if t.influences is not None), default=0)
    lost = max((t.lost for t in terms), default=0)
    infinite = RunEstimate(value=inf, stderr=nan, influences=None, runs=runs - lost, lost=lost)
    if any(term.lost > term.runs for term in terms):
        return Distance(infinite, near=0, loses_most=True)
    # Step 1: squares of the logarithms, and influences of the runs on half their sum.
    squares = 0.0
    near = 0
    influences_on_sum = np.zeros(runs)
    for number in numbers:
        term = number.measured
        printed = number.printed
        if not (isfinite(term.value) and term.value > 0.0 < printed):
            return Distance(infinite, near=0)
        # log(measured / printed); the power 0.5 takes the square root of a variance
        log_ratio = number.power * float(elementary.log(term.value / printed))
        squares += log_ratio * log_ratio
        if abs(term.value - printed) <= NEAR * printed:
            near += 1
        # d distance = sum log_ratio power dx / x / (n distance), x the measured value
        if term.influences is not None:
            # The influences of lost runs are 0 here. In a mean over all runs the others count for more.
            weight = runs / term.runs
            changes = np.nan_to_num(term.influences)
            influences_on_sum += log_ratio * number.power / term.value * weight * changes
    # Step 2: the root mean square D = sqrt(squares / n), with dD = d(squares / 2) / (n D).
    value = float(np.sqrt(squares / max(len(numbers), 1)))
    influences = influences_on_sum
    if value:
        influences = influences_on_sum / (len(numbers) * value)
    estimate = RunEstimate(
        value=value,
        stderr=mean(influences).stderr,
        influences=influences,
        runs=runs - lost,
        lost=lost,
    )
    return Distance(estimate, near)


def _measure(evaluator: Evaluator, numbers: list[PublishedNumber]) -> list[Number]:
    """Measure the printed numbers at a point, each for all its filters."""
    measured = []
    for number in numbers:
        m = number.expression
        if m is None:
            continue
        for label in number.labels:
            measured.append(
                Number(
                    label=label,
                    printed=float(number.value),
                    measured=evaluator.term(m.of(label)),
                    is_variance=m.statistic == "variance",
                )
            )
    return measured


def _notes(heads: list[str], readings: list[RankedReading], numbers: int) -> list[str]:
    """Write how many readings were tried, which is the nearest, and how many are as near.

    A reading is an interpretation of a paper, that is a point of the grid and a way to measure the
    printed numbers. ``readings`` are sorted by distance from these numbers. ``heads`` are the headings
    of the values that name a reading. ``numbers`` is the number of printed numbers.
    """
    nearest = readings[0]
    finite = []
    for reading in readings:
        if isfinite(reading.distance.estimate.value):
            finite.append(reading.distance.estimate)
    # The distance is infinite if a filter loses most runs, or if a number has no logarithm.
    lost = sum(reading.distance.loses_most for reading in readings)
    without_logarithm = len(readings) - len(finite) - lost
    tried = f"{len(readings)} readings, {lost} of which lose most runs of a filter"
    if without_logarithm:
        tried += (
            f", and {without_logarithm} have a number that is missing, infinite or not positive"
        )
    notes = [f"{tried}; {numbers} printed numbers."]
    if not finite:
        return notes
    pairs = {}
    for i, estimate in enumerate(finite):
        pairs[i] = compare_estimates(estimate, nearest.distance.estimate)
    # The nearest is chosen from many, so the correction is for the tests of all pairs of readings.
    family = as_family(pairs, tests=comb(len(finite), 2))
    alike = sum(comparison.sign == 0 for comparison in family.values())
    how_near = f"distance {rounded(*nearest.distance.estimate.estimate, 3)}"
    how_near += f", {nearest.distance.near} of {numbers} numbers within 10 %"
    name = _name_reading(heads, nearest.values)
    notes.append(
        f"Nearest: {name}; {how_near}. Not significantly farther, itself counted: {alike}."
    )
    most = max(readings, key=lambda reading: reading.distance.near)
    if most.distance.near > nearest.distance.near:
        name = _name_reading(heads, most.values)
        notes.append(f"Most numbers within 10 %: {name}; {most.distance.near} of {numbers}.")
    return notes


def _name_reading(heads: list[str], values: list[str]) -> str:
    return ", ".join(f"{head} {value}" for head, value in zip(heads, values, strict=True))


class _JudgedReading(NamedTuple):
    """A reading of a paper: a point of the grid, with the verdicts on the claims there."""

    values: list[str]
    """what distinguishes the point, in the order of the headings"""
    words: list[str]
    """verdict on each claim"""


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
        evaluators = [Evaluator(results, point) for _, point in points]
        claims, words_of_claims = _judge_measured(self._claims(results), evaluators)
        if not claims:
            note = f"Nothing is claimed in {self.of} that these filters measure."
            return Table(self.title, ["Rank"], [], digits=1, notes=[note])
        # Step 2: the most claims that hold come first, then the fewest that fail.
        readings = []
        for i, (values, _) in enumerate(points):
            words = [words_of_claim[i] for words_of_claim in words_of_claims]
            readings.append(_JudgedReading(values=values, words=words))
        readings.sort(
            key=lambda reading: (-reading.words.count("holds"), reading.words.count("fails"))
        )
        columns = [word.capitalize() for word in CLAIM_WORDS]
        table = Table(self.title, ["Rank", *heads], columns, digits=1)
        for rank, reading in enumerate(readings[: self.rows], start=1):
            cells = []
            for word in CLAIM_WORDS:
                number = reading.words.count(word)  # of claims: no estimate over runs
                cells.append(Cell(Estimate(number, nan), runs=0, lost=0))
            table.add([str(rank), *reading.values], cells)
        table.notes += _claim_notes(heads, claims, readings)
        return table

    def _claims(self, results: Results) -> list[Claim]:
        """Read the claims about filters of the results, without claims about times."""
        published = read_published(results.folder, results.config.get("published", []), self.of)
        claims = []
        for claim in published.claims:
            is_of_time = any(m.metric.startswith("cpu_s") for m in claim.expressions)
            if claim.labels and set(claim.labels) <= {*results.filters} and not is_of_time:
                claims.append(claim)
        return claims


def _judge_measured(
    claims: list[Claim], evaluators: list[Evaluator]
) -> tuple[list[Claim], list[list[str]]]:
    """Judge every claim at every point, and leave out those that no point measures.

    ``evaluators`` have the measures at the points. Returns the claims that are left, and for each of
    them the words of the verdicts at the points.
    """
    measured_claims = []
    words_of_claims = []
    for claim in claims:
        verdicts = [judge(claim, evaluator) for evaluator in evaluators]
        if any(verdict.is_measured for verdict in verdicts):
            measured_claims.append(claim)
            words = [verdict.verdict.word for verdict in verdicts]
            # A point that does not measure the claim leaves it undecided.
            words_of_claims.append([word if word in CLAIM_WORDS else UNDECIDED for word in words])
    return measured_claims, words_of_claims


def _claim_notes(
    heads: list[str], claims: list[Claim], readings: list[_JudgedReading]
) -> Iterator[str]:
    """Yield how many readings and claims there are, and at how many readings each claim holds.

    ``readings`` are points of the grid with the verdicts there, sorted by the number of claims that
    hold. ``heads`` are the headings of the values that name a reading.
    """
    best = readings[0]
    holding = [reading.words.count("holds") for reading in readings]
    name = _name_reading(heads, best.values)
    most = f"Most hold at {name}: {holding[0]}; as many at {holding.count(holding[0])}"
    yield f"{len(readings)} readings, {len(claims)} claims. {most} of the readings."
    for i, claim in enumerate(claims):
        words = [reading.words[i] for reading in readings]
        holds = words.count("holds")
        fails = words.count("fails")
        yield f"{claim.claim}: holds at {holds}, fails at {fails} of the readings."
