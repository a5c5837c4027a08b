"""Ways to measure a printed number: by which expression and statistic, and the name of each way."""

import itertools
from collections import Counter
from dataclasses import replace
from typing import Any, NamedTuple

from trackbench.config.published_numbers_and_claims import PublishedNumber
from trackbench.evaluation.metric_expression import TIME_MEAN, Measure
from trackbench.report.findings.phrases import named
from trackbench.statistics.sample_statistics import STATISTICS


class Place(NamedTuple):
    """Place where a number is printed, without its point of the grid."""

    paper: str
    table: str
    row: str
    filter: str
    metric: str

    @classmethod
    def of_number(cls, number: PublishedNumber) -> "Place":
        """Return the place of a number."""
        return cls(
            paper=number.paper,
            table=number.table,
            row=number.row,
            filter=number.filter,
            metric=number.metric,
        )


class Choice(NamedTuple):
    """A printed metric that is measured by several expressions, of which a way takes one."""

    heading: str
    measures: list[Measure]
    places: set[Place]
    """places of the numbers that have these expressions"""


def ways_to_measure(
    numbers: list[PublishedNumber], statistics: tuple[str, ...] = ()
) -> tuple[list[str], list[tuple[list[str], list[PublishedNumber]]]]:
    """List the ways to measure all printed numbers together.

    A printed metric may have rows of several expressions. A way takes one of them for all numbers that
    have these expressions, and one of ``statistics`` for all errors if there are any. A number with one
    expression is in every way.

    Returns
    -------
    tuple[list[str], list[tuple[list[str], list[PublishedNumber]]]]
        headings of the columns that name a way, and the ways. A way is its texts under these headings,
        and the printed numbers, each with the expression that measures it this way.
    """
    heads: list[str] = []
    ways = []
    for statistic in statistics or ("",):
        # Step 1: rows that differ in their statistic alone are one row after it is replaced.
        rows_of_statistic = _without_repetitions([with_statistic(n, statistic) for n in numbers])
        # Step 2: printed metrics that are measured by several expressions, and these expressions. The
        # metrics, and so the headings, are the same for every statistic.
        choices = _choices(rows_of_statistic)
        heads = [choice.heading for choice in choices]
        # Step 3: every combination of one expression for each of these metrics.
        for measures_of_way in itertools.product(*(choice.measures for choice in choices)):
            measure_by_place: dict[Place, Measure] = {}
            words = [statistic] if statistic else []
            for choice, m in zip(choices, measures_of_way, strict=True):
                measure_by_place |= dict.fromkeys(choice.places, m)
                words.append(_name_among(choice.measures, m))
            rows = []
            for number in rows_of_statistic:
                wanted = measure_by_place.get(Place.of_number(number), number.expression)
                if number.expression == wanted:
                    rows.append(number)
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


def _choices(numbers: list[PublishedNumber]) -> list[Choice]:
    """Return the printed metrics that have several expressions.

    A metric may be printed at several places, such as for several filters. Places with equal expressions
    are one choice.
    """
    # Step 1: the expressions at each place.
    measures_by_place: dict[Place, list[Measure]] = {}
    for number in numbers:
        assert number.expression is not None
        measures_by_place.setdefault(Place.of_number(number), []).append(number.expression)
    # Step 2: the places of each metric that have equal expressions.
    groups: dict[tuple[str, frozenset[Measure]], list[Place]] = {}
    for place, measures in measures_by_place.items():
        if len(set(measures)) > 1:
            groups.setdefault((place.metric, frozenset(measures)), []).append(place)
    # Step 3: a choice for each of these groups, under a heading of its own.
    headings = _headings(list(groups.values()))
    choices = []
    for heading, places in zip(headings, groups.values(), strict=True):
        measures = list(dict.fromkeys(measures_by_place[places[0]]))
        choices.append(Choice(heading=heading, measures=measures, places=set(places)))
    return choices


def _headings(choices: list[list[Place]]) -> list[str]:
    """Return a heading for each choice, which no other one has; a choice is given by its places.

    A heading is the metric. Equal ones name the filters, too. Headings that are still equal name the
    tables of these filters, and in the end the rows and the papers.
    """
    headings = [places[0].metric for places in choices]
    for detail in ("filter", "table", "row", "paper"):
        number = Counter(headings)
        for i, places in enumerate(choices):
            if number[headings[i]] > 1:
                texts = dict.fromkeys(_place_in_words(place, detail) for place in places)
                headings[i] = f"{places[0].metric} of {', '.join(texts)}"
    return headings


def _place_in_words(place: Place, detail: str) -> str:
    """Write the filter of a place, and what the ``detail`` adds: its table, row or paper.

    The paper has the table and the row before it, and the row has the table.
    """
    words = [named(place.filter)]
    if detail != "filter":
        words.append(place.table)
    if detail in ("row", "paper") and place.row:
        words.append(place.row)
    if detail == "paper":
        words.append(place.paper)
    return " / ".join(words)


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
