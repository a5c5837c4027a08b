"""Shaded times of sensor faults in figures over time: colors, and strips for faults that overlap."""

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any, TypeAlias

import numpy as np

from trackbench.report.plotting.style import Axes, LineStyle
from trackbench.results.rows_and_columns import Columns

_FAULTS = ("#f4cccc", "#c9daf8", "#d9ead3", "#fff2cc")
"""Colors of the times of sensors' faults."""

Span: TypeAlias = tuple[float, float]
"""First and last place of a fault on the horizontal axis."""


def shade_faults(ax: Axes, rows: Columns, faults: Sequence[Mapping[str, Any]], x: str) -> None:
    """Shade the parts of the axis in which faults of sensors last, each in its color.

    If some faults overlap in time, each is shaded in a strip of the axis, so that none covers another.

    Parameters
    ----------
    ax
        axes with steps or times as horizontal axis
    rows
        rows of per_step.csv with the steps and times that are drawn
    faults
        faults of the scenario, each with its ``name`` and its first and last step or time in s
    x
        column of ``rows`` that the axis shows, ``step`` or ``time``
    """
    spans = [_span_of_fault(rows, fault, x) for fault in faults]
    strips = len(faults) if _have_overlap(spans) else 1
    for number, (fault, span) in enumerate(zip(faults, spans, strict=True)):
        if span is None:
            continue
        first, last = span
        top = 1.0 - (number % strips) / strips  # as a share of the axis
        look = _fault_look(number)
        ax.axvspan(first, last, top - 1.0 / strips, top, label=fault["name"], **look)


def faults_overlap(rows: Columns, faults: Sequence[Mapping[str, Any]], x: str) -> bool:
    """Return whether `shade_faults` shades each of these faults in a strip of its own."""
    return _have_overlap([_span_of_fault(rows, fault, x) for fault in faults])


def _span_of_fault(rows: Columns, fault: Mapping[str, Any], x: str) -> Span | None:
    """Return the first and last place of a fault on the horizontal axis.

    It is None if the fault is at none of the steps in ``rows`` of per_step.csv. ``x`` is the column of
    the rows that the axis shows.
    """
    # A fault lasts from step to step, or from time to time; an end that is None is that of the run.
    if fault["steps"] is not None:
        first, last = fault["steps"]
        steps_or_times = rows["step"]
    else:
        first = fault["from"]
        last = fault["to"]
        steps_or_times = rows["time"]
    is_faulty = np.ones(len(rows), dtype=bool)
    if first is not None:
        is_faulty &= steps_or_times >= first
    if last is not None:
        is_faulty &= steps_or_times <= last
    if not is_faulty.any():
        return None
    places = rows[x][is_faulty]
    return float(places.min()), float(places.max())


def _fault_look(number: int) -> LineStyle:
    """Return the look of the time of a sensor's fault."""
    return {"color": _FAULTS[number % len(_FAULTS)], "alpha": 0.7, "lw": 1, "zorder": 0}


def _have_overlap(spans: Sequence[tuple[float, float] | None]) -> bool:
    """Return whether any two of the spans on an axis have more than an end in common."""
    return any(_overlap(first, second) for first, second in combinations(spans, 2))


def _overlap(span: tuple[float, float] | None, other: tuple[float, float] | None) -> bool:
    """Return whether two spans on an axis have more than an end in common; None is an empty span."""
    if span is None or other is None:
        return False
    return max(span[0], other[0]) < min(span[1], other[1])
