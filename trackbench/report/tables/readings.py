"""Table kind `readings`: the readings of a paper by their distance from its printed numbers.

A filter that loses most of its runs makes the distance infinite.
"""

from dataclasses import dataclass, field
from math import comb, isfinite
from typing import Literal, NamedTuple

from trackbench.config.did_you_mean import unknown
from trackbench.config.published_numbers_and_claims import PublishedNumber
from trackbench.config.read_published_files import read_published
from trackbench.errors import Mark, Problem, UserError, counted, form_for
from trackbench.field_types import Count, Digits
from trackbench.registry import register
from trackbench.report.expressions import Evaluator
from trackbench.report.kinds import TableKind
from trackbench.report.rounded_numbers import rounded
from trackbench.report.table import Cell, Table
from trackbench.report.tables_and_figures import Results
from trackbench.report.verdicts.distance_from_printed_numbers import (
    Distance,
    distance,
    measured_numbers,
)
from trackbench.report.verdicts.grid_points_as_readings import reading_name, searched_points
from trackbench.report.verdicts.ways_to_measure import ways_to_measure
from trackbench.statistics.comparison import compare_estimates
from trackbench.statistics.holm_correction import as_family


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

        A reading is an interpretation of what a paper leaves open: a point of the grid together with a
        way to measure the printed numbers. A printed number names one or several ``labels``, the filters
        of the experiment that measure it. A measured number is of one ``label``.
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
                measured = measured_numbers(evaluator, numbers_of_way)
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
            # The first way stands for all: they measure the same printed numbers by other expressions.
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
            # A row without an expression measures nothing. One with a relation to another filter, such
            # as a ratio or gain, follows from numbers that count by themselves.
            is_left_out = number.expression is None or number.expression.relation
            if is_word or is_left_out:
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
    verb = form_for(lost, "loses", "lose")
    tried = f"{counted(len(readings), 'reading')}, {lost} of which {verb} most runs of a filter"
    if without_logarithm:
        verb = form_for(without_logarithm, "has", "have")
        tried += (
            f", and {without_logarithm} {verb} a number that is missing, infinite or not positive"
        )
    notes = [f"{tried}; {counted(numbers, 'printed number')}."]
    if not finite:
        return notes
    pairs = {}
    for i, estimate in enumerate(finite):
        pairs[i] = compare_estimates(estimate, nearest.distance.estimate)
    # The nearest is chosen from many, so the correction is for the tests of all pairs of readings.
    family = as_family(pairs, tests=comb(len(finite), 2))
    alike = sum(comparison.sign == 0 for comparison in family.values())
    how_near = f"distance {rounded(*nearest.distance.estimate.estimate, 3)}"
    how_near += f", {nearest.distance.near} of {counted(numbers, 'number')} within 10 %"
    name = reading_name(heads, nearest.values)
    notes.append(
        f"Nearest: {name}; {how_near}. Not significantly farther, itself counted: {alike}."
    )
    # ``near`` of a distance is the number of measured numbers within 10 % of the printed ones.
    most = max(readings, key=lambda reading: reading.distance.near)
    if most.distance.near > nearest.distance.near:
        name = reading_name(heads, most.values)
        notes.append(f"Most numbers within 10 %: {name}; {most.distance.near} of {numbers}.")
    return notes
