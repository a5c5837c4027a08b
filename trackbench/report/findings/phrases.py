"""Numbers and names as they stand in a sentence."""

import re
from ast import literal_eval
from collections.abc import Iterable, Mapping, Sequence
from math import ceil, inf, log10
from types import MappingProxyType
from typing import Any

from trackbench.config.grid import single_paths, values_of
from trackbench.evaluation.metric_expression import Measure
from trackbench.field_types import is_number
from trackbench.metrics import unit_of
from trackbench.results.points_json import GridPoint
from trackbench.units_of_components import without_unit

MOST_NAMES = 4
"""Names that a list in a sentence has at most; longer lists are cut."""
_CAPITALS = ("anees", "nees", "anis", "nis")
"""Metrics whose names are abbreviations."""
_SCORES = {"log_score": "log score", "held_log_score": "held-out log score"}


def metric_words(metric: Measure) -> str:
    """Return a metric's name for a sentence: ``position RMSE``, ``log score``."""
    definition = metric.definition
    if definition.name in _SCORES:
        return _SCORES[definition.name]
    quantity, _ = without_unit(metric.quantity)
    return f"{quantity.replace('_', ' ')} {definition.name.upper()}".strip()


def statistic_words(statistic: str, metric: Measure) -> str:
    """Name a metric with its statistic over the runs: ``mean position RMSE per run``.

    The ``statistic`` is that by which filters are compared, ``mean`` or ``rms``. If it is ``rms``, the
    name is ``position RMSE`` alone.
    """
    words = metric_words(metric)
    if statistic == "rms":
        return words
    return f"mean {words} per run"


def with_unit(text: str, metric: Measure) -> str:
    """Return a number, and the unit of the metric if it has one."""
    return f"{text} {with_raised_powers(_unit(metric))}".rstrip()


def head_of(statistic: str, metric: Measure) -> str:
    """Return the heading of a column: ``Mean position RMSE (m)``.

    The ``statistic`` over the runs is that by which filters are compared, ``mean`` or ``rms``. If it is
    ``rms``, the heading is ``Position RMSE (m)``.
    """
    words = in_unit(metric_words(metric), _unit(metric))
    if statistic == "rms":
        return _capitalized(words)
    return f"Mean {words}"


def axis_of(metric: Measure) -> str:
    """Return the label of an axis: ``Position RMSE (m)`` for an error and its mean or RMS over runs.

    Step and window stand behind the name: ``Position RMSE at step 20 (m)``. Scores and metrics such as
    ``ANEES`` have words, too. The label of any other metric is its expression.
    """
    definition = metric.definition
    quantity = metric.quantity
    if metric.relation or metric.is_many:
        return str(metric)
    # With ``steps`` but without a ``step`` it is the last one: a range of steps, `is_many`, is above.
    where = ""
    if metric.step is not None:
        where = f" at step {metric.step}"
    elif metric.steps is not None:
        where = " at the last step"
    elif metric.window:
        where = f" in {metric.window}"
    if metric.is_error and metric.statistic in ("", "mean", "rms"):
        return in_unit(f"{_capitalized(metric_words(metric))}{where}", _unit(metric))
    if definition.name in _SCORES and metric.statistic in ("", "mean"):
        return in_unit(f"{_capitalized(metric_words(metric))}{where}", _unit(metric))
    if definition.name in _CAPITALS and not metric.statistic:
        return f"{definition.name.upper()} {quantity.replace('_', ' ')}".rstrip() + where
    return str(metric)


def time_of_programs(labels: Sequence[str]) -> str:
    """Return what the CPU time of programs in other languages includes."""
    return (
        f"The time of {', '.join(labels)} includes the exchange of lines with the program, some "
        "microseconds a step."
    )


def _capitalized(words: str) -> str:
    """Return words that begin with a capital letter."""
    return f"{words[0].upper()}{words[1:]}"


def in_unit(words: str, unit: str) -> str:
    """Add a unit, if there is one: ``position RMSE (m)``."""
    if not unit:
        return words
    return f"{words} ({with_raised_powers(unit)})"


_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def with_raised_powers(unit: str) -> str:
    """Return a unit with raised exponents: ``m²/s³`` for ``m^2/s^3``, ``m²/s⁴`` for ``(m/s^2)^2``."""
    power_of_all = re.fullmatch(r"\(([^()]+)\)\^([0-9]+)", unit)
    if power_of_all is None:
        return re.sub(r"\^(-?[0-9]+)", lambda power: power[1].translate(_RAISED), unit)
    inner, outer_power = power_of_all.groups()

    def raise_factor(factor: re.Match[str]) -> str:
        power = int(factor[2] or 1) * int(outer_power)
        return f"{factor[1]}{str(power).translate(_RAISED)}"

    return re.sub(r"([A-Za-z]+)(?:\^([0-9]+))?", raise_factor, inner)


def _unit(metric: Measure) -> str:
    """Return the unit of a metric: ``m``, ``m^2``, nats of a log score; empty if none is known."""
    if metric.definition.is_score:
        return "nats"
    return unit_of(metric.metric)


def percent(share: float) -> str:
    """Write a share in percent with two digits: ``2.3 %``, ``350 %``."""
    return f"{rounded(100 * share, 2)} %"


def rounded(x: float, digits: int) -> str:
    """Write a number with so many digits: ``1.6``, ``13``, ``5800``."""
    return f"{float(f'{x:.{digits}g}'):g}"


def multiple(ratio: float, width: float) -> str:
    """Write a ratio with the digits that its interval allows, three decimals at most: ``3.2``.

    ``width`` is that of the interval; if it is unknown or infinite, the ratio has three digits. A ratio
    of a million or more has two digits and an exponent.
    """
    if abs(ratio) >= 1e6:
        return f"{ratio:.1e}"
    if not 0.0 < width < inf:
        return rounded(ratio, 3)
    # The interval is at least three units of the last decimal wide.
    decimals = ceil(log10(3.0 / width))
    return f"{ratio:.{min(3, max(0, decimals))}f}"


_MOST_RUNS = 1e6
"""Estimated number of runs from which on it is not written as a number."""


def run_count(runs: float) -> str:
    """Write an estimated number of runs with two digits: ``5800``, ``more than 1000000``."""
    if runs < _MOST_RUNS:
        return f"{float(f'{runs:.2g}'):.0f}"
    return f"more than {_MOST_RUNS:.0f}"


def named(label: str) -> str:
    """Return a label as it stands in a sentence: one with a comma in quotes."""
    if "," in label:
        return f"\u201c{label}\u201d"
    return label


def listed(names: Sequence[str]) -> str:
    """Return ``A, B and C``; of many names the first ``MOST_NAMES``: ``A, B, C, D and 3 more``."""
    more = len(names) - MOST_NAMES
    if more > 1:  # one more name is no longer than "1 more"
        return joined([*names[:MOST_NAMES], f"{more} more"])
    return joined(names)


def joined(names: Iterable[str]) -> str:
    """Return ``A, B and C``; there must be a name."""
    *first, last = names
    if not first:
        return last
    return f"{', '.join(first)} and {last}"


def verb(names: Sequence[str]) -> str:
    """Return "is" for one name and "are" for several."""
    return "is" if len(names) == 1 else "are"


def heading(point: GridPoint, units: Mapping[str, str] = MappingProxyType({})) -> str:
    """Return a grid point as the title of its panel: ``R = 0.1``, ``sigma azimuth = 2 mrad``.

    Each of several paths that vary together has its own value: ``q = 1469.1, R = 15099``. ``units`` are
    the units, by single path, of paths whose names end in none.
    """
    parts: list[str] = []
    for path, value in point.items():
        values = values_of_paths(path, value)
        for single_path, single_value in zip(single_paths(path), values, strict=True):
            words, unit_in_name = quantity(single_path)
            unit = with_raised_powers(unit_in_name or units.get(single_path, ""))
            part = f"{words} = {_value_words(single_value)} {unit}".rstrip()
            if part not in parts:  # the same key of several filters
                parts.append(part)
    return ", ".join(parts)


def distinct_headings(
    points: Sequence[GridPoint], units: Mapping[str, str] = MappingProxyType({})
) -> list[str]:
    """Return the titles of grid points, as `heading` writes them, with no more keys than they need.

    Of paths that vary together a title has the first ones: as many as make the titles differ.
    """
    shortened, _ = distinct_points(points)
    return [heading(point, units) for point in shortened]


def distinct_points(points: Sequence[GridPoint]) -> tuple[list[GridPoint], int]:
    """Shorten grid points to the first of the paths that vary together.

    Returns
    -------
    points : list
        Points by single path.
    number : int
        How many of the paths that vary together they have: as many as make the points differ.
    """
    most = max((len(single_paths(path)) for point in points for path in point), default=1)
    shortened: list[GridPoint] = []
    number = 0
    while number < most:
        number += 1
        shortened = [_first_paths(point, number) for point in points]
        if len({heading(point) for point in shortened}) == len(points):
            break
    return shortened, number


def _first_paths(point: GridPoint, number: int) -> GridPoint:
    """Return a grid point with the first ``number`` of paths that vary together, each by itself."""
    first: GridPoint = {}
    for path, value in point.items():
        values = values_of_paths(path, value)
        first |= dict(list(zip(single_paths(path), values, strict=True))[:number])
    return first


def values_of_paths(path: str, value: Any) -> list[Any]:
    """Return the value of each of the paths that vary together, also if they are read from a text."""
    return list(values_of(path, _parse_list(value)))


def _parse_list(value: Any) -> Any:
    """Return a grid's value; parse it if it is a list written as a text, such as ``[1, 2]``.

    A list is a text if it was read from a CSV file. Any other value, and a text that cannot be parsed,
    is returned as it is.
    """
    is_list = isinstance(value, str) and value.startswith("[")
    if not is_list:
        return value
    try:
        return literal_eval(value)
    except (SyntaxError, ValueError):
        return value


def _value_words(value: Any) -> str:
    """Return a grid's value for a title: ``2``; ``b2`` for ``[b2]``; ``[0, 1]`` as it is."""
    if isinstance(value, list):
        if len(value) == 1:
            return _value_words(value[0])
        if all(isinstance(item, str) for item in value):
            return ", ".join(value)
    return number(value)


def at_point(point: GridPoint) -> str:
    """Return where a sentence's numbers are from: `` at R = 0.1``; empty without a grid."""
    if not point:
        return ""
    return f" at {heading(point)}"


def axis(path: str, units: Mapping[str, str] = MappingProxyType({})) -> str:
    """Label an axis with a grid's path: ``sigma azimuth (mrad)``; ``units`` as `heading` has them."""
    words, unit = quantity(path)
    return in_unit(words, unit or units.get(single_paths(path)[0], ""))


def quantity(path: str) -> tuple[str, str]:
    """Return a grid's path as words, and the unit that its name ends in; empty if in none.

    They are ``sigma azimuth`` and ``mrad`` of ``scenario.sensor.sigma_azimuth_mrad``.
    """
    # The last word of the path, of the first of several that vary together.
    key, unit = without_unit(single_paths(path)[0].rpartition(".")[2])
    return key.replace("_", " "), unit


def number(value: Any) -> str:
    """Return a grid's value: six digits of a number, words and truth values as they are."""
    if is_number(value):
        return f"{value:g}"
    return str(value)
