"""Overlap of the periods of two files, and the unit of time that would give them some."""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.durations import time_text
from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.parse_tables import header
from trackbench.scenarios.recordings.quantity_keys import KEYS
from trackbench.scenarios.recordings.rows_and_reading_context import (
    TICK,
    ReadingContext,
    Rows,
    usual_interval,
)
from trackbench.scenarios.recordings.unit_names_and_sizes import UNITS
from trackbench.scenarios.recordings.yaml_values import mapping_in_braces, missing_in_yaml

_FACTORS = (1e3, 1e6, 1e9, 1e-3, 1e-6, 1e-9)
"""ratios of the units s, ms, us and ns"""
_ALIKE = 0.5
"""share of the time of both files that is common to them, if their units are right"""
_UNLIKE = 0.01
"""share of it below which a unit may be wrong"""


class _Span(NamedTuple):
    """Times of a file, s or steps."""

    first: float
    last: float
    interval: float
    """usual interval from row to row"""

    def scaled(self, factor: float) -> "_Span":
        """Return the span in another unit."""
        return _Span(self.first * factor, self.last * factor, self.interval * factor)


def check_common_time(
    measured: ReadingContext, measured_rows: Sequence[Rows], other: ReadingContext, rows: Rows
) -> None:
    """Raise DataError if a file has no common time with the measurements, or times in another unit.

    ``measured`` is the context of the measurements, ``measured_rows`` are the rows of each sensor.
    ``other`` and ``rows`` are those of the other file, which has the truth or inputs and its own keys in
    the config.
    """
    all_times = np.concatenate([each.time for each in measured_rows])
    if not len(all_times) or not len(rows.time):
        return
    span = _span_of(all_times)
    other_span = _span_of(rows.time)
    unit = "" if measured.counts_steps else " s"
    other_period = f"{time_text(other_span.first)} to {time_text(other_span.last)}{unit}"
    period = f"{time_text(span.first)} to {time_text(span.last)}{unit}"
    periods = f"its times are from {other_period}, and those of {measured.files[0]} from {period}"
    is_apart = _share_in_common(span, other_span) == 0.0
    remedy = ""
    # Numbers of steps and dates have no unit that could be wrong.
    if not measured.counts_steps and not measured.dated:
        remedy = _remedy_of_units(measured, other, span, other_span)
    if remedy:
        raise DataError(
            Place(other.files[0], 1, 1, f"{periods}: one of their units differs; {remedy}")
        )
    if is_apart:
        remedy = "give both files times of one clock"
        raise DataError(
            Place(other.files[0], 1, 1, f"{periods}: they have no time in common; {remedy}")
        )


def note_files_apart(context: ReadingContext, measured_rows: Sequence[Rows]) -> None:
    """Add a note to ``context`` on two sensors' files further apart in time than either is long.

    ``measured_rows`` are the rows of each sensor. A sensor may follow another, so this is no mistake.
    """
    spans = [(rows, _span_of(rows.time)) for rows in measured_rows if len(rows.time)]
    spans.sort(key=lambda pair: pair[1].first)
    for (rows, span), (next_rows, next_span) in pairwise(spans):
        longest = max(span.last - span.first, next_span.last - next_span.first)
        if next_span.first - span.last > max(longest, TICK):
            unit = "" if context.counts_steps else " s"
            context.notices.append(
                f"{context.files[next_rows.file[0]]} begins at {time_text(next_span.first)}{unit}, and "
                f"{context.files[rows.file[0]]} ends at {time_text(span.last)}{unit}: they have no "
                "time in common; check their clocks, `zone` and `units`"
            )


def _span_of(times: Array) -> _Span:
    """Return the first and last of times (R,), and their usual interval."""
    return _Span(float(times.min()), float(times.max()), usual_interval(times))


def _share_in_common(span: _Span, other: _Span) -> float:
    """Return the common part of two spans as a share of the time from the first to the last row of both.

    It is 0 if they have no common part, and more than 0 if they touch.
    """
    common = min(span.last, other.last) - max(span.first, other.first)
    whole = max(span.last, other.last) - min(span.first, other.first)
    if common < -TICK:
        return 0.0
    if whole <= TICK:
        return 1.0
    return max(common, TICK) / whole


def _remedy_of_units(
    measured: ReadingContext, other: ReadingContext, span: _Span, other_span: _Span
) -> str:
    """Return the advice to read one of two files in another unit of time; empty if none is better.

    ``measured`` is the context of the measurements and ``span`` that of their times; ``other`` and
    ``other_span`` are those of the other file.
    """
    if _share_in_common(span, other_span) >= _UNLIKE:
        return ""
    if min(span.last - span.first, other_span.last - other_span.first) <= 0.0:
        return ""
    for factor in _FACTORS:
        scaled = other_span.scaled(factor)
        # In the right unit both files have most of their time in common, and the usual intervals from
        # row to row are not less alike than before.
        log_ratio = abs(np.log(other_span.interval / span.interval))
        new_log_ratio = abs(np.log(scaled.interval / span.interval))
        if _share_in_common(span, scaled) < _ALIKE or new_log_ratio > log_ratio:
            continue
        unit = _unit_of_size(other.naming.scale("time") * factor)
        if unit:
            return _advice_on_unit(other, unit)
        # No unit is so small or large: then the unit of the measurements may be the wrong one.
        unit = _unit_of_size(measured.naming.scale("time") / factor)
        if unit:
            return f"say `units: {{time: {unit}}}`, the unit of {measured.files[0]}"
    return ""


def _unit_of_size(size: float) -> str:
    """Return the unit of time that has this ``size`` in s: ms of 0.001; empty if there is none."""
    for unit in ("s", "ms", "us", "ns"):
        # Sizes are as small as 1e-12, so that only a relative tolerance tells them apart.
        if np.isclose(UNITS[unit], size, rtol=1e-6, atol=0.0):
            return unit
    return ""


def _advice_on_unit(other: ReadingContext, unit: str) -> str:
    """Return the advice to give the times of the ``other`` file this unit.

    If the config has keys for this file alone, one of them changes. Otherwise the advice has all keys,
    as in ``truth_naming: {columns: {time: t}, units: {time: ms}}``: the file shares those of the
    measurements no longer.
    """
    # `keys` has names of keys in the config: `own` is truth_naming or input_naming, which may be set.
    # `clock` is the key that names the column of the time, and `quantities` those of the quantities.
    # Both are `columns` if the file shares the keys of the measurements.
    keys = other.keys
    if keys.clock != "columns":
        return f"say `time: {unit}` under `units` of `{keys.own}`"
    naming = other.naming
    names = header(other.files[0], naming.format)
    columns = {}
    for name, column in naming.columns.items():
        # Inputs have their columns in a key of their own.
        if column in names and (keys.quantities != "input" or name in KEYS):
            columns[name] = column
    # The key of the time comes last.
    units = {}
    for name, unit_of_name in naming.units.items():
        if name != "time" and naming.column_of(name, names) is not None:
            units[name] = unit_of_name
    units["time"] = unit
    entries = []
    if columns:
        entries.append(f"columns: {{{mapping_in_braces(columns)}}}")
    entries.append(f"units: {{{mapping_in_braces(units)}}}")
    if naming.missing is not None:
        entries.append(f"missing: {missing_in_yaml(naming)}")
    if naming.clockwise and keys.quantities != "input":
        entries.append(f"clockwise: [{', '.join(naming.clockwise)}]")
    if naming.same_time is not None:
        entries.append(f"same_time: {naming.same_time}")
    return f"say `{keys.own}: {{{', '.join(entries)}}}`"
