"""Guess whether a table is the log of a robot: its landmarks, bearings, and their units."""

from collections.abc import Collection

import numpy as np

from trackbench.errors import first_names
from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.guess_record import (
    ColumnByQuantity,
    ReasonByKey,
    RobotTables,
    UnitByQuantity,
)
from trackbench.scenarios.recordings.guess_table_sample import TableSample
from trackbench.scenarios.recordings.guess_targets_or_sensors import is_word_column
from trackbench.scenarios.recordings.label_column_names import (
    LANDMARK_WORDS,
    joined_and_single_words,
    role_of,
)
from trackbench.scenarios.recordings.label_spelling import plain_label
from trackbench.scenarios.recordings.naming_of_columns import Naming
from trackbench.scenarios.recordings.odometry_columns import explain_missing_odometry, odometry_of
from trackbench.scenarios.recordings.quantity_keys import COURSE, ODOMETRY, PLACE, VELOCITY
from trackbench.scenarios.recordings.yaml_values import in_option

_LARGEST_OF_ROBOT = {"v": 20.0, "w": 3.5, "range": 100.0}
"""m/s, rad/s and m that nearly all of a robot's measurements are below, if no unit is named"""
UNITS_OF_ROBOT = {
    "v": ("m/s", "km/h", "cm/s", "mm/s"),
    "w": ("rad/s", "deg/s"),
    "range": ("m", "cm", "mm", "ft"),
}
_MOST_IDS = 6  # that are shown
_LEAST_KNOWN = 0.5
"""share of a column's words that are known landmarks, if it names these"""


def settle_robot_columns(
    sample: TableSample, columns: ColumnByQuantity, user_naming: Naming, tables: RobotTables
) -> bool:
    """Return whether the table is the log of a robot, whose bearings count from its heading.

    The ``columns`` of such a log are changed in place: they get the bearing, the landmarks as
    ``sensor``, and the odometry. ``tables`` are those of odometry and landmarks beside this table.
    Raises DataError with the possible answers if the user must say in ``user_naming`` from where angles
    count, as the numbers do not show it.
    """
    # Step 1: find the column that names landmarks, and the odometry.
    odometry = odometry_of(sample.names)
    has_odometry = odometry.keys() >= {*ODOMETRY} or tables.odometry is not None
    is_like_robot = "bearing" in columns or has_odometry or bool(tables.landmarks)
    landmark_column = _landmark_column(
        sample, columns, user_naming, is_like_robot, tables.landmarks
    )
    # Rows are split by landmark unless the user has named another column of sensors.
    is_split = False
    if landmark_column is not None:
        is_split = user_naming.columns.get("sensor", landmark_column) == landmark_column
    # Step 2: decide whether angles are bearings of a robot, or ask.
    angle = columns.get("azimuth")
    has_polar = not {"range", "azimuth", "bearing"}.isdisjoint(columns)
    if tables.landmarks and is_split and not has_polar and columns.keys() >= {*PLACE}:
        x = columns["x"]
        y = columns["y"]
        message = (
            f"{x} and {y} in rows of the landmarks ({landmark_column}): are they seen from the"
        )
        message += " robot?"
        remedy = (
            f"Write range = sqrt({x}^2 + {y}^2) and bearing = atan2({y}, {x}) into two columns, if"
        )
        remedy += (
            f" {x} points ahead and {y} to the left; if they are the robot's own positions, leave"
        )
        raise DataError(Place(sample.path, 1, 1, f"{message} {remedy} out --landmarks"))
    # Angles in a table beside one of landmarks are a robot's bearings, unless columns.azimuth is set.
    if tables.landmarks and angle is not None and "azimuth" not in user_naming.columns:
        columns.setdefault("bearing", angle)
    if "bearing" not in columns and (angle is not None or tables.is_empty):
        if angle is None:
            return False
        if "azimuth" in user_naming.columns or not (is_split or has_odometry):
            # Report a column such as id, which may name landmarks; otherwise the angles are azimuths.
            _check_meaning_of_ids(sample, columns, user_naming)
            if tables.is_empty:
                return False
            message = (
                "columns.azimuth: is of fixed sensors, and --input and --landmarks are of a robot"
            )
            raise DataError(Place(sample.path, 1, 1, f"{message}: leave out one of them"))
        column = in_option(angle)
        landmarks = f" of the landmarks ({landmark_column})" if is_split else ""
        message = f"{angle}: do the bearings{landmarks} count from the robot's heading?"
        other = "or do fixed sensors, such as radars, measure the direction to what moves, "
        other += "from the axis x or from north?"
        raise DataError(
            Place(sample.path, 1, 1, f"{message} Say --set 'columns.bearing={column}'"),
            Place(sample.path, 1, 1, f"{other} Say --set 'columns.azimuth={column}'"),
        )
    # Step 3: this is a robot's log. Without an angle it is one, too, beside tables of odometry or
    # landmarks: it then has ranges alone. Landmarks are its sensors, and its motion comes from odometry.
    if landmark_column is not None and is_split:
        columns["sensor"] = landmark_column
        if columns.get("run") == landmark_column:
            columns.pop("run")
    for name in ("azimuth", *COURSE, *VELOCITY):
        columns.pop(name, None)
    if tables.odometry is not None:
        named = [name for name in ODOMETRY if name in user_naming.columns]
        if named:
            message = f"columns.{named[0]}: the inputs are those of the file --input"
            remedy = f"say --set 'input_naming.columns.{named[0]}=ITS NAME'"
            raise DataError(Place(sample.path, 1, 1, f"{message}: {remedy}"))
        return True
    for name, named_column in odometry.items():
        columns.setdefault(name, named_column.column)
    if not columns.keys() >= {*ODOMETRY}:
        remedy = "of odometry in another file, name that, --input FILE (docs/your-robot.md)"
        message = explain_missing_odometry(sample, columns)
        raise DataError(Place(sample.path, 1, 1, f"{message}; {remedy}"))
    return True


def _landmark_column(
    sample: TableSample,
    columns: ColumnByQuantity,
    user_naming: Naming,
    is_like_robot: bool,
    landmarks: Collection[str],
) -> str | None:
    """Return the column that names landmarks; None without one.

    Its name says so, or its words are those of known ``landmarks``. In the log of a robot
    (``is_like_robot``) it may also have another name, such as tag or id, if its cells are empty just
    where nothing was measured.
    """
    # Case 1: most words of the column are names of known landmarks.
    if landmarks and "sensor" not in user_naming.columns:
        shares = {}
        for name in sample.names:
            words = {plain_label(word) for word in sample.words(name)}
            shares[name] = len(words.intersection(landmarks)) / max(len(words), 1)
        best = max(sample.names, key=shares.__getitem__)
        if shares[best] >= _LEAST_KNOWN:
            return best
    # Case 2: the column's name is a word for something at a fixed place, such as beacon.
    for name in sample.names:
        if role_of(name) == "place":
            return name
    if not is_like_robot or "sensor" in user_naming.columns:
        return None
    # Case 3: a column of words that has a cell in exactly those rows that measure something.
    measured = np.zeros(len(sample), dtype=np.bool_)
    for quantity in ("range", "azimuth", "bearing"):
        if quantity in columns:
            measured |= np.isfinite(sample.numbers(columns[quantity]))
    quantities = {name: c for name, c in columns.items() if name not in ("run", "sensor")}
    free = [name for name in sample.names if name not in quantities.values()]
    fitting = []
    for name in free:
        cells = sample.cells(name)
        is_named = np.array([cell != "" for cell in cells], dtype=np.bool_)
        if np.array_equal(is_named, measured) and is_word_column(cells):
            fitting.append(name)
    for name in fitting:
        is_id = not LANDMARK_WORDS.isdisjoint(joined_and_single_words(name))
        if is_id and name not in user_naming.columns.values():
            return name
    # If no name has a word such as tag or id, there must be empty cells, and only one such column.
    if len(fitting) == 1 and not measured.all() and fitting[0] not in user_naming.columns.values():
        return fitting[0]
    return None


def _check_meaning_of_ids(
    sample: TableSample, columns: ColumnByQuantity, user_naming: Naming
) -> None:
    """Raise DataError if a column such as id or tag may name targets, sensors or landmarks.

    The numbers do not show which of these the azimuths are of. There is no error if ``user_naming`` has
    the column of runs or sensors.
    """
    if not {"run", "sensor"}.isdisjoint(user_naming.columns):
        return
    angle = in_option(columns["azimuth"])
    for name in sample.names:
        if name in columns.values() and name not in (columns.get("run"), columns.get("sensor")):
            continue
        words = sample.words(name)
        # Words of landmarks, such as id, tag and code, may as well name targets or sensors.
        is_id = not LANDMARK_WORDS.isdisjoint(joined_and_single_words(name))
        if not is_id or len(words) < 2 or not is_word_column(sample.cells(name)):
            continue
        column = in_option(name)
        azimuth = f"--set 'columns.azimuth={angle}'"
        shown = first_names(words, _MOST_IDS)
        lines = [
            f"{name}: are {shown} landmarks that a robot sees? Say --set 'columns.bearing={angle}',"
            " and name its odometry, --input FILE",
            f"or targets, of a radar? Say {azimuth} --set 'columns.run={column}'",
            f"or sensors, which see one target? Say {azimuth} --set 'columns.sensor={column}'",
        ]
        raise DataError(*(Place(sample.path, 1, 1, line) for line in lines))


def guess_units_of_robot(
    sample: TableSample, columns: ColumnByQuantity, units: UnitByQuantity, reasons: ReasonByKey
) -> None:
    """Add, in place, the units of a robot's measurements that are not known yet, which are SI.

    ``columns`` and ``units`` are by quantity. Reasons are added to ``reasons``. Raises DataError if the
    numbers are too large for SI units.
    """
    for name, (si, *others) in UNITS_OF_ROBOT.items():
        if name in units or name not in columns:
            continue
        numbers = np.abs(sample.numbers(columns[name]))
        size = 0.0
        if np.isfinite(numbers).any():
            size = float(np.nanquantile(numbers, 0.9))
        if size > _LARGEST_OF_ROBOT[name]:
            options = " or ".join(f"--set units.{name}={unit}" for unit in (*others, si))
            message = (
                f"{columns[name]}: no unit is named, and {size:.3g} {si} is unusual for a robot"
            )
            raise DataError(Place(sample.path, 1, 1, f"{message}: say {options}"))
        units[name] = si
        reasons[name] = f"guess: nine of ten are below {size:.2g}"
