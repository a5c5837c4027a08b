"""Guess of the column and unit of each quantity of a table by its name."""

from collections.abc import Collection, Sequence
from typing import Literal, TypeAlias

import numpy as np

from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.compare_courses_with_movement import holds_courses
from trackbench.scenarios.recordings.guess_hemispheres import hemispheres_of
from trackbench.scenarios.recordings.guess_record import (
    ColumnByQuantity,
    ReasonByKey,
    RobotTables,
    UnitByQuantity,
)
from trackbench.scenarios.recordings.guess_robot import guess_units_of_robot, settle_robot_columns
from trackbench.scenarios.recordings.guess_table_sample import TableSample
from trackbench.scenarios.recordings.naming_of_columns import Naming
from trackbench.scenarios.recordings.odometry_columns import keep_odometry_columns
from trackbench.scenarios.recordings.quantity_keys import (
    COURSE,
    GEODETIC,
    KEYS,
    MEASURED,
    ODOMETRY,
    PLACE,
    VELOCITY,
)
from trackbench.scenarios.recordings.recognize_column_names import columns_of, unit_of, words_of
from trackbench.scenarios.recordings.unit_names_and_sizes import unit_in
from trackbench.scenarios.recordings.yaml_values import in_option

TableContent: TypeAlias = Literal["measurements", "odometry"]
_GIVEN_KEYS = tuple(
    dict.fromkeys((*KEYS, *GEODETIC, *COURSE, *MEASURED, *VELOCITY, *ODOMETRY)),
)
"""Keys of `columns` that a guess may be given."""
_WORDS_OF_WAYS = ("distance", "dist", "entfernung", "afstand", "distancia", "distanza")
"""Words of a range's column that may be the way travelled."""
_SENSOR_KEYS = ("landmark", "landmarks", "tag", "id", "marker", "station", "radar", "anchor")
"""Words that a user may take for the key `sensor`."""
_MOST_SENSORS = 50


def guess_columns(
    sample: TableSample,
    user_naming: Naming,
    reasons: ReasonByKey,
    tables: RobotTables,
    content: TableContent,
) -> tuple[ColumnByQuantity, UnitByQuantity]:
    """Return columns and units by quantity, guessed from the names of columns and a line of units.

    Columns and units in ``user_naming`` come first. But of several columns for one purpose one is kept,
    whoever named them: a speed and a course are dropped beside vx and vy, and steps beside a time.
    Reasons are added to ``reasons`` in place. ``content`` says whether the table has measurements, or a
    robot's odometry alone. ``tables`` are those of odometry and landmarks beside a table of
    measurements.
    """
    # Step 1: find columns by their names. Columns that the user named come first.
    user_columns = user_naming.columns
    named_columns = columns_of(sample.names, user_columns)
    # Exports of ROS messages have a column without cells for the name of each group of columns.
    if "time" in named_columns and not any(sample.cells(named_columns["time"].column)):
        filled = [name for name in sample.names if any(sample.cells(name))]
        named_columns.pop("time")
        columns_with_cells = columns_of(filled, user_columns)
        if "time" in columns_with_cells:
            named_columns["time"] = columns_with_cells["time"]
    columns = {name: named.column for name, named in named_columns.items()}
    columns = {
        name: column for name, column in columns.items() if column not in user_columns.values()
    }
    columns |= user_columns
    # An empty name means that no column is this quantity. For runs and sensors it stays in the result,
    # as it means that their rows are mixed.
    columns = {
        name: column for name, column in columns.items() if column or name in ("run", "sensor")
    }
    # A column with the letters N and S may have the name of another quantity, which it then is not.
    for key, hemisphere_column in hemispheres_of(sample, columns).items():
        columns = {name: column for name, column in columns.items() if column != hemisphere_column}
        columns[key] = hemisphere_column
    # Step 2: of several columns for one purpose keep one: two components of a velocity rather than speed
    # and course, a time rather than numbers of steps. A date alone is the time.
    if columns.keys() >= {*VELOCITY}:
        columns = {name: column for name, column in columns.items() if name not in COURSE}
    if "date" in columns and "time" not in columns:
        columns["time"] = columns.pop("date")
    if "time" in columns:
        columns.pop("step", None)
    _settle_twice_named(sample, columns, user_naming)
    if "range" not in user_columns and _is_way(sample, columns):
        columns.pop("range")
    # Step 3: recognize a robot. Its columns have other meanings: a direction is a bearing, and no
    # azimuth.
    is_robot = True
    if content == "odometry":
        keep_odometry_columns(sample, columns)
    else:
        is_robot = settle_robot_columns(sample, columns, user_naming, tables)
    # Step 4: drop columns of sensors and runs with empty cells, or with an unlikely number of names.
    _drop_unlikely_labels(
        sample,
        columns,
        measured_columns(columns),
        user_naming.columns,
        is_robot=is_robot,
        knows_landmarks=bool(tables.landmarks),
    )
    # Step 5: find units in the names of columns and in lines of units. Those of the user come first.
    units = {}
    for name, column in columns.items():
        unit = unit_of(column, name)
        if unit is not None:
            units[name] = unit
    reasons |= dict.fromkeys(units, "as the column's name says")
    if units.get("azimuth") == "acp":  # some radars have 16384 pulses
        reasons["azimuth"] = "guess: a turn has 4096 azimuth change pulses"
    for name, column in columns.items():
        unit = sample.unit(column, name)
        if unit is not None:
            units[name] = unit
            reasons[name] = "as the line of units says"
    unit = _unit_of_column(sample)
    if unit is not None and columns.keys() >= {*PLACE} and units.keys().isdisjoint(PLACE):
        units |= dict.fromkeys(PLACE, unit)
        reasons |= dict.fromkeys(PLACE, "as the column of units says")
    units |= user_naming.units
    if is_robot:
        guess_units_of_robot(sample, columns, units, reasons)
    return columns, units


def measured_columns(columns: ColumnByQuantity) -> list[str]:
    """Return the columns of the quantities that sensors measure."""
    return [column for name, column in columns.items() if name in MEASURED and column]


def check_given_keys(path: str, user_naming: Naming, further: Sequence[str] = ()) -> None:
    """Raise DataError if the user names a column for an unknown quantity, such as columns.tag.

    ``further`` are the keys that only this table may have.
    """
    known = (*_GIVEN_KEYS, *further)
    for key, column in user_naming.columns.items():
        # A quantity may have the number of its sensor before its name: 2.x.
        if key in known or key.rpartition(".")[2] in MEASURED:
            continue
        message = f"there is no columns.{key}; known: {', '.join(known)}"
        if key.lower() in _SENSOR_KEYS:
            name = in_option(column)
            message = f"there is no columns.{key}: a column that names landmarks or sensors is"
            message += f" `--set 'columns.sensor={name}'`"
        raise DataError(Place(path, 1, 1, message))


def _settle_twice_named(
    sample: TableSample, columns: ColumnByQuantity, user_naming: Naming
) -> None:
    """Remove one of two quantities from ``columns``, in place, if they have the same column.

    A column ``track`` may be a course or name runs, and a column ``sensor_id`` may name sensors, or runs
    as ``id`` does. There is nothing to settle if the user named the column of the runs.
    """
    run = columns.get("run")
    if run is None or "run" in user_naming.columns:
        return
    if run == columns.get("course"):
        # Beside a speed, or if the positions move in its directions, a track is a course; else it names
        # what moves.
        if "speed" in columns or holds_courses(sample, columns, run):
            columns.pop("run")
        else:
            columns.pop("course")
    elif run == columns.get("sensor"):
        # The whole name is one of sensors, and only without the word sensor it is one of runs. A column
        # that the user named for the sensors is not guessed as that of the runs in the first place.
        columns.pop("run")


def _is_way(sample: TableSample, columns: ColumnByQuantity) -> bool:
    """Test whether the column of the range has the way from the start of a path, beside its speed.

    Loggers of GPS write this distance, which begins at zero and never falls. ``columns`` are the columns
    by quantity.
    """
    has_position = columns.keys() >= {*PLACE} or columns.keys() >= {*GEODETIC[:2]}
    if not has_position or not {"range", "speed"} <= columns.keys():
        return False
    words = words_of(columns["range"])
    if not words or words[0] not in _WORDS_OF_WAYS:
        return False
    numbers = sample.numbers(columns["range"])
    numbers = numbers[np.isfinite(numbers)]
    steps = np.diff(numbers)
    return bool(len(steps)) and bool((steps >= 0.0).all() and numbers[0] <= 2.0 * steps.max())


def _unit_of_column(sample: TableSample) -> str | None:
    """Return the unit of lengths that a column of units has in all rows; None without such a column."""
    for name in sample.names:
        if "".join(words_of(name)) in ("unit", "units", "einheit"):
            cells = set(sample.cells(name))
            if len(cells) == 1:
                return unit_in(words_of(f"({cells.pop()})"), "x")
    return None


def _drop_unlikely_labels(
    sample: TableSample,
    columns: ColumnByQuantity,
    measured: Sequence[str],
    user_columns: Collection[str],
    *,
    is_robot: bool,
    knows_landmarks: bool,
) -> None:
    """Drop, in place, columns of sensors and runs with empty cells, or an unlikely number of names.

    There are few sensors, and on average at least three rows of a run. ``measured`` are the columns of
    measured quantities. Those that the user named, by the quantities ``user_columns``, are kept. The
    rows of a robot (``is_robot``) may lack the name of a landmark. If its landmarks are known
    (``knows_landmarks``), one is enough.
    """
    most_runs = max(1, len(sample) // 3)
    for key, least, most in (("sensor", 2, _MOST_SENSORS), ("run", 1, most_runs)):
        words = set(sample.cells(columns.get(key, "")))
        if key == "sensor" and columns.get(key):
            # A sensor may begin later than the sample ends.
            words |= {*sample.further(columns[key], measured).words(columns[key])}
        if key == "sensor" and is_robot:
            words.discard("")  # of rows with odometry alone
            if knows_landmarks:
                least = 1
        if key not in user_columns and ("" in words or not least <= len(words) <= most):
            columns.pop(key, None)
