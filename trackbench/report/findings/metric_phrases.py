"""Names of metrics in sentences, headings and on axes, and their units: ``Position RMSE (m)``."""

import re

from trackbench.evaluation.metric_expression import Measure
from trackbench.metrics import unit_of
from trackbench.units_of_components import without_unit

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

    Step and window stand behind the name: ``Position RMSE at step 20 (m)``. Log scores have words, and
    ANEES, NEES, ANIS and NIS have capitals. The label of any other metric is its expression.
    """
    definition = metric.definition
    quantity = metric.quantity
    # A relation is one of two filters, as ratio(rmse, PF). `is_many` is a range of steps, as 3..last.
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
