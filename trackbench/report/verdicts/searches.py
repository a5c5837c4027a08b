"""Readings of a paper that an experiment searches: points of its grid, and ways to measure a number.

A table of kind `readings` ranks them; the verdicts take the best one for each printed number.
"""

import itertools
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

from trackbench.config.grid import single_paths
from trackbench.config.overrides import split_path
from trackbench.config.published_csv import PublishedNumber, picks, read_published
from trackbench.evaluation.metric_expression import TIME_MEAN, Measure
from trackbench.report.findings import phrases
from trackbench.report.tables_and_figures import Results
from trackbench.report.verdicts.cpu_times import without_times
from trackbench.results.points_json import GridPoint
from trackbench.statistics.sample_statistics import STATISTICS


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
        for place, rows in rows_by_place.items():
            readings = _readings(results, rows, table_keys.get("statistics") or [""])
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
        if number.expression is None:
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


def searched_points(
    results: Results, labels: list[str]
) -> tuple[list[str], list[tuple[list[str], dict[str, Any]]]]:
    """List the combinations of those values of the grid that concern the filters ``labels``.

    Returns
    -------
    Headings of the paths that vary these filters or the scenario, and the combinations of their values.
    A combination is the values as texts, and the first point of the grid that has them.
    """
    paths = [path for path in results.grid if _varies_scenario_or_filters(results, path, labels)]
    # Points that differ in other paths only are one reading: the first stands for it.
    points_by_values: dict[tuple[str, ...], dict[str, Any]] = {}
    for point in results.points():
        values = tuple(phrases.number(point[path]) for path in paths)
        points_by_values.setdefault(values, point)
    # A column is called by the last word of its key, by two words if that is ambiguous.
    keys_of_paths = [split_path(results.source, single_paths(path)[0]) for path in paths]
    last_words = [keys[-1] for keys in keys_of_paths]
    heads = []
    for keys in keys_of_paths:
        words = keys[-1:] if last_words.count(keys[-1]) == 1 else keys[-2:]
        heads.append(".".join(map(str, words)))
    return heads, [(list(values), point) for values, point in points_by_values.items()]


def _varies_scenario_or_filters(results: Results, path: str, labels: list[str]) -> bool:
    """Test whether a path of the grid varies the scenario, or one of the filters ``labels``."""
    for single_path in single_paths(path):
        # Such as `scenario`, `sensor`, `sigma`, or `filters`, `EKF`, `motion`, `q`.
        keys = split_path(results.source, single_path)
        if keys[0] == "scenario" or keys[1] in labels:
            return True
    return False


def ways_to_measure(
    numbers: list[PublishedNumber], statistics: tuple[str, ...] = ()
) -> tuple[list[str], list[tuple[list[str], list[PublishedNumber]]]]:
    """List the ways to measure all printed numbers together.

    A printed metric may have rows of several expressions. A way takes one of them for all numbers of the
    metric, and one of ``statistics`` for all errors if there are any.

    Returns
    -------
    Headings of the columns that name a way, and the ways. A way is its texts under these headings, and
    the printed numbers, each with the expression that measures it this way.
    """
    heads: list[str] = []
    ways = []
    for statistic in statistics or ("",):
        # Step 1: rows that differ in their statistic alone are one row after it is replaced.
        rows_of_statistic = _without_repetitions([with_statistic(n, statistic) for n in numbers])
        # Step 2: printed metrics that are measured by several expressions, and these expressions.
        alternatives = _alternatives(rows_of_statistic)
        heads = [*alternatives]
        # Step 3: every combination of one expression for each of these metrics.
        for measures_of_way in itertools.product(*alternatives.values()):
            measure_by_metric = dict(zip(alternatives, measures_of_way, strict=True))
            rows = []
            for number in rows_of_statistic:
                # A metric with one expression only is in every way.
                wanted = measure_by_metric.get(number.metric, number.expression)
                if number.expression == wanted:
                    rows.append(number)
            words = [statistic] if statistic else []
            for metric, m in measure_by_metric.items():
                words.append(_name_among(alternatives[metric], m))
            ways.append((words, rows))
    if statistics:
        heads = ["statistic", *heads]
    return heads, ways


def _without_repetitions(numbers: list[PublishedNumber]) -> list[PublishedNumber]:
    """Return the first of the rows that measure one printed number by the same expression."""
    rows: dict[tuple[Any, ...], PublishedNumber] = {}
    for number in numbers:
        key = (number.printed_at, number.value, number.label, number.factor, number.expression)
        rows.setdefault(key, number)
    return [*rows.values()]


def _alternatives(numbers: list[PublishedNumber]) -> dict[str, list[Measure]]:
    """Return the expressions of each printed metric that has several, by the metric as printed."""
    measures_by_place: dict[tuple[str, ...], list[Measure]] = {}
    for number in numbers:
        assert number.expression is not None
        place = (number.paper, number.table, number.row, number.filter, number.metric)
        measures_by_place.setdefault(place, []).append(number.expression)
    alternatives: dict[str, list[Measure]] = {}
    for (*_, printed_metric), measures in measures_by_place.items():
        if len(set(measures)) > 1:
            alternatives[printed_metric] = list(dict.fromkeys(measures))
    return alternatives


def _name_among(alternatives: list[Measure], m: Measure) -> str:
    """Name an expression so that no other one of the ``alternatives`` has the same name.

    An average is named by its metric alone, as ``rmse`` for ``mean(rmse)``, unless another statistic of
    this metric is among the alternatives.
    """
    metrics = [other.name for other in alternatives]
    if _is_average(m) and metrics.count(m.name) == 1:
        return m.name
    return str(m)


def with_statistic(number: PublishedNumber, statistic: str) -> PublishedNumber:
    """Return the number with its expression's statistic replaced.

    A number stays as it is if ``statistic`` is empty, or if its expression is no average, such as a
    variance.
    """
    m = number.expression
    if not statistic or m is None or not _is_average(m):
        return number
    return replace(number, expression=m._replace(statistic=statistic))


def _is_average(m: Measure) -> bool:
    """Test whether the expression is a mean, rms or median of one filter's metric, and of no step."""
    # A variance has the unit squared, the power 2.
    averages = [TIME_MEAN, *(name for name, s in STATISTICS.items() if s.power == 1)]
    return m.statistic in averages and not m.steps and not m.relation
