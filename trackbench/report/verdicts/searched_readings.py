"""Readings of a paper that an experiment searches: each a point of its grid, and a way to measure.

A table of kind `readings` ranks them; the verdicts take the best one for each printed number.
"""

from collections.abc import Iterator
from dataclasses import replace
from math import isnan
from typing import NamedTuple

from trackbench.config.published_numbers_and_claims import PublishedNumber, picks
from trackbench.config.read_published_files import read_published
from trackbench.errors import counted
from trackbench.report.expressions import Evaluator
from trackbench.report.tables_and_figures import Results
from trackbench.report.verdicts.cpu_time_verdicts import without_times
from trackbench.report.verdicts.grid_points_as_readings import searched_points
from trackbench.report.verdicts.number_verdicts import Compared, Reproduced, compare_filters
from trackbench.report.verdicts.ways_to_measure import with_statistic
from trackbench.results.points_json import GridPoint
from trackbench.statistics.verdict_rules import noted


class SearchedReading(NamedTuple):
    """A printed number as one reading measures it: by an expression of a filter at a point."""

    number: PublishedNumber
    """with the one label that is measured, and the reading in words"""
    point: GridPoint


def searched_numbers(results: Results) -> Iterator[list[SearchedReading]]:
    """Yield the list of readings of each printed number that a table of kind `readings` searches.

    A reading is an interpretation of a paper: a point of the grid, and a way to measure the number.
    """
    yielded_places = set[tuple[str, ...]]()
    for table_keys in (results.config.get("tables") or {}).values():
        if table_keys.get("kind") != "readings":
            continue
        # Step 1: rows of the published files, by the place where a paper prints the number. The key `of`
        # is the experiment that the rows are for. CPU times have verdicts of their own.
        paths = results.config.get("published", [])
        published = without_times(read_published(results.folder, paths, table_keys["of"]))
        rows_by_place: dict[tuple[str, ...], list[PublishedNumber]] = {}
        # Settings that were fitted to numbers, in words, by `filter: metric` or by the metric alone.
        fitted_settings = table_keys.get("chosen") or {}
        for number in published.numbers:
            if number.printed_at not in yielded_places:
                of_filter = fitted_settings.get(f"{number.filter}: {number.metric}")
                of_metric = fitted_settings.get(number.metric)
                row = replace(number, chosen=of_filter or of_metric or number.chosen)
                rows_by_place.setdefault(number.printed_at, []).append(row)
        # Step 2: the readings of each number. If several tables search a number, the first one counts.
        # The empty statistic stands for that of the published row.
        statistics = table_keys.get("statistics") or [""]
        for place, rows in rows_by_place.items():
            readings = _readings(results, rows, statistics)
            if readings:
                yielded_places.add(place)
                yield readings


def _readings(
    results: Results, rows: list[PublishedNumber], statistics: list[str]
) -> list[SearchedReading]:
    """Return the readings of one printed number: each expression of each label at each point.

    ``rows`` are the published rows of the number. ``statistics`` are the statistics that a printed error
    may be; an empty one stands for that of its row.
    """
    # Step 1: the number with each expression, without duplicates, and of these one for each label.
    variants: dict[PublishedNumber, None] = {}
    for row in rows:
        for name in statistics:
            variants[with_statistic(row, name)] = None
    numbers: list[PublishedNumber] = []
    for row in variants:
        numbers += [replace(row, label=label) for label in row.labels]
    # Step 2: each of them at each point of the grid, with the reading in words.
    readings = []
    for number in numbers:
        if number.expression is None:  # a row that names nothing to measure
            continue
        # An expression such as a ratio compares the label with another filter.
        labels = [number.label]
        if number.expression.other:
            labels.append(number.expression.other)
        if not set(labels) <= {*results.filters}:
            continue
        heads, points = searched_points(results, labels)
        for values, point in points:
            if not picks(number.point, point):
                continue
            words = [f"{head} {value}" for head, value in zip(heads, values, strict=True)]
            if len(variants) > 1:
                words.append(str(number.expression))
            reading = replace(number, reading=", ".join(words))
            readings.append(SearchedReading(number=reading, point=point))
    return readings


def best_rows_of_searches(results: Results) -> Iterator[Compared]:
    """Yield each printed number that a `readings` table searches, compared under its best reading.

    A reading is an interpretation of what the paper leaves open: a point of the grid, and an expression
    of a filter that measures the number. The best one has the best verdict, and of equal verdicts the
    number nearest to the printed one. A number that no reading measures is left out.
    """
    evaluators: dict[tuple[str, ...], Evaluator] = {}
    for readings in searched_numbers(results):
        rows: list[Compared] = []
        for number, point in readings:
            values = tuple(map(str, point.values()))
            if values not in evaluators:
                evaluators[values] = Evaluator(results, point)
            # One row: the number of a reading names a single filter.
            for row in compare_filters(number, evaluators[values]):
                # A NaN without lost runs means that this reading is not measured.
                if row.measured.lost or not isnan(row.measured.value):
                    rows.append(row)
        if rows:
            best = Reproduced(rows).best
            note = noted(f"best of {counted(len(rows), 'reading')} searched", best.note)
            yield best._replace(tried=len(rows), note=note)
