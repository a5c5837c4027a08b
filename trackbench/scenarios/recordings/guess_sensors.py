"""Guess of the sensors of a table and of the kind of each."""

import numpy as np

from trackbench.core.arrays import Mask
from trackbench.errors import in_line
from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.columns_of_ranges_to_places import ranges_of
from trackbench.scenarios.recordings.explain_failed_guess import explain_missing_quantities
from trackbench.scenarios.recordings.guess_columns import measured_columns
from trackbench.scenarios.recordings.guess_record import (
    ColumnByQuantity,
    ReasonByKey,
    SensorGuess,
    UnitByQuantity,
)
from trackbench.scenarios.recordings.guess_table_sample import TableSample
from trackbench.scenarios.recordings.naming_of_columns import Naming
from trackbench.scenarios.recordings.quantity_keys import GEODETIC, MEASURED, ODOMETRY, PLACE
from trackbench.scenarios.recordings.recognize_column_names import shown_names
from trackbench.scenarios.recordings.yaml_values import in_option

SENSORS = {
    "landmark": ("range", "bearing"),
    "landmark-bearing": ("bearing",),
    "position": ("x", "y"),
    "range-azimuth": ("range", "azimuth"),
    "range": ("range",),
    "bearing": ("azimuth",),
}
"""Types of sensors that a table may hold, the most telling first, and what they measure.

A ``bearing`` counts from the heading of what moves, an ``azimuth`` from the axis x or from north.
"""
ANGLES = ("azimuth", "bearing")


def guess_sensors(
    sample: TableSample,
    columns: ColumnByQuantity,
    units: UnitByQuantity,
    user_naming: Naming,
    reasons: ReasonByKey,
) -> list[SensorGuess]:
    """Return the guessed sensors of a table, those first whose columns ``user_naming`` has.

    ``columns`` and ``units`` are by quantity. Columns of ranges to several places are added to them in
    place. Raises DataError if a sensor measures no known quantity. There are two exceptions. If the user
    named the column of sensors, the rows of this sensor are left out, and ``reasons`` has the comment on
    it. If the user said by an empty name that no column splits the rows into runs, the guessed column of
    sensors is removed from ``columns``: its words name no sensors, such as types of messages.
    """
    # Step 1: the rows in which each quantity is a number. A position is x and y, or longitude and
    # latitude.
    # Of sensors that begin to measure after the first rows there are later ones.
    cells = sample.cells(columns.get("sensor", ""))
    measuring_words: list[str] = []
    samples = [sample]
    if columns.get("sensor"):
        measured = measured_columns(columns)
        measuring_words = sample.measuring_words(columns["sensor"], measured)
        samples.append(sample.further(columns["sensor"], measured))
        cells = cells + samples[1].cells(columns["sensor"])
    is_number = {}
    for name, column in columns.items():
        if name in MEASURED:
            is_number[name] = np.isfinite(np.concatenate([s.numbers(column) for s in samples]))
    if not is_number.keys() >= {*PLACE} and is_number.keys() >= {*GEODETIC[:2]}:
        is_number["x"] = is_number["longitude"]
        is_number["y"] = is_number["latitude"]
    # Step 2: find what each sensor measures. A table without names of sensors has one sensor.
    words = [""]
    if columns.get("sensor"):
        words = [word for word in dict.fromkeys(cells) if word]
        # Sensors that measure in the first rows come first, as these rows show the units.
        words.sort(key=lambda word: word not in measuring_words)
    # Of several types of sensors that fit, the first one of `SENSORS` counts. But a type whose columns
    # the user named comes first.
    answered = {*user_naming.columns}
    if answered & {*GEODETIC[:2]}:
        answered |= {*PLACE}
    kinds = sorted(SENSORS.items(), key=lambda kind: -len(answered.intersection(kind[1])))
    sensors = []
    for word in words:
        rows = np.array([cell == word or not word for cell in cells], dtype=np.bool_)
        # Rows with a position as well as a range and an azimuth raise a question, which a user who named
        # a column of one of them has answered.
        if answered.isdisjoint((*PLACE, "range", "azimuth", "bearing")):
            _check_one_kind(sample.path, columns, is_number, rows)
        for kind, quantities in kinds:
            if all(name in is_number and (is_number[name] & rows).any() for name in quantities):
                sensors.append(SensorGuess(name=word, kind=kind, quantities=quantities))
                break
    # Step 3: ranges to several places, one in each column, are a sensor each.
    has_position = {"x", "y"} <= is_number.keys() or {"range", "azimuth"} <= is_number.keys()
    ranges = {}
    if not has_position and "range" not in user_naming.columns:
        ranges = ranges_of(sample.names)
    if ranges and words == [""]:
        columns.pop("range", None)
        units.pop("range", None)
        sensors = []
        for number, (name, named) in enumerate(ranges.items(), 1):
            quantity = f"{number}.range"
            columns[quantity] = named.column
            sensors.append(SensorGuess(name=name.upper(), kind="range", quantities=(quantity,)))
            # The user's unit of the range is that of all of them.
            unit = user_naming.units.get(quantity) or user_naming.units.get("range")
            unit = unit or sample.unit(named.column, "range") or named.unit
            if unit is not None:
                units[quantity] = unit
    # Step 4: report the sensors without a known quantity.
    if len(sensors) < len(words):
        measuring = {sensor.name for sensor in sensors}
        idle = [word for word in words if word not in measuring]
        if columns.keys() >= {"sensor", "bearing", *ODOMETRY} and sensors:
            message = (
                f"{columns['sensor']}: rows of {', '.join(idle)[:80]} have no range and no bearing"
            )
            remedy = "leave this cell of theirs empty, as rows of odometry alone see no landmark"
            raise DataError(Place(sample.path, 1, 1, f"{message}; {remedy}"))
        is_guessed = bool(columns.get("sensor")) and "sensor" not in user_naming.columns
        if is_guessed and user_naming.columns.get("run") == "":
            columns.pop("sensor")
            return guess_sensors(sample, columns, units, user_naming, reasons)
        # If the user named the column of sensors, rows of sensors without a known quantity are left out.
        if not sensors or "sensor" not in user_naming.columns:
            raise DataError(explain_missing_quantities(columns, sample, idle if sensors else []))
        reasons["sensor"] = f"rows of {in_line(shown_names(idle))} have nothing that is measured"
    return sensors


def _check_one_kind(
    path: str, columns: ColumnByQuantity, is_number: dict[str, Mask], rows: Mask
) -> None:
    """Raise DataError if rows have a position as well as a range and an azimuth.

    One of them may be the truth of the other. ``is_number`` has the rows (R,) in which each quantity is
    a number, and the mask ``rows`` (R,) selects those of one sensor.
    """
    radar = ("range", "azimuth")
    for names in (PLACE, radar):
        if not all(name in is_number and (is_number[name] & rows).any() for name in names):
            return
    positions = ("x", "y") if columns.keys() >= {*PLACE} else GEODETIC[:2]
    options_of_kinds = []
    for names in (radar, positions):
        options = (f"--set 'columns.{n}={in_option(columns[n])}'" for n in names)
        options_of_kinds.append(" ".join(options))
    message = f"the rows have {columns['range']} and {columns['azimuth']}, and also"
    message += f" {columns[positions[0]]} and {columns[positions[1]]}: which ones were measured?"
    raise DataError(
        Place(path, 1, 1, f"{message} Say {options_of_kinds[0]}"),
        Place(
            path,
            1,
            1,
            f"or say {options_of_kinds[1]}; the others may be a truth in a file of their own",
        ),
    )
