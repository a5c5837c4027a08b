"""Ways to measure a printed number: by which expression and statistic, and the name of each way."""

import itertools
from dataclasses import replace
from typing import Any

from trackbench.config.published_csv import PublishedNumber
from trackbench.evaluation.metric_expression import TIME_MEAN, Measure
from trackbench.statistics.sample_statistics import STATISTICS


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
        # Step 2: printed metrics that are measured by several expressions, and these expressions. The
        # metrics, and so the headings, are the same for every statistic.
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
    """Return the expressions of each printed metric that has several, by the metric as printed.

    If a metric is printed at several places, such as for several filters, the expressions are those of
    the last place that has several.
    """
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
