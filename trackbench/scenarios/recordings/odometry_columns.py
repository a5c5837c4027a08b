"""Columns of the speed, turn rate and heading of a robot, by their names."""

from collections.abc import Sequence

from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.guess_record import ColumnByQuantity
from trackbench.scenarios.recordings.guess_table_sample import TableSample
from trackbench.scenarios.recordings.quantity_keys import KEYS, ODOMETRY
from trackbench.scenarios.recordings.recognize_column_names import (
    FILLERS,
    NamedColumn,
    shown_names,
    unit_of,
    words_of,
    words_without_units,
)

_ODOMETRY = {
    "v": "v speed velocity vel linearvelocity linearx linear forwardvelocity forwardspeed "
    "linearvelocityx",
    "w": "w omega yawrate turnrate angularvelocity angularz angular wz gyroz angularvelocityz",
}
"""Names of the columns of a robot's speed and turn rate, the surest first."""
_FILLERS_OF_ODOMETRY = frozenset(("twist", "cmd", "imu", "vel", "velocity"))
"""Further words that may stand beside a speed or a turn rate: field.twist.twist.linear.x of ROS."""
_HEADINGS = ("heading", "theta", "yaw", "psi", "phi", "orientation", "hdg")


def keep_odometry_columns(sample: TableSample, columns: ColumnByQuantity) -> None:
    """Reduce ``columns``, in place, to those of times, runs, and a robot's speed (v) and turn rate (w).

    A speed or a turn rate that the user has not named is found by the names of the sample's columns.
    Raises DataError if one of them is missing.
    """
    named = {quantity: column.column for quantity, column in odometry_of(sample.names).items()}
    for name in [*columns]:
        if name not in (*KEYS, *ODOMETRY) or name == "sensor":
            columns.pop(name)
    for name in ODOMETRY:
        if name in named:
            columns.setdefault(name, named[name])
    if not columns.keys() >= {*ODOMETRY}:
        raise DataError(Place(sample.path, 1, 1, explain_missing_odometry(sample, columns)))


def explain_missing_odometry(sample: TableSample, columns: ColumnByQuantity) -> str:
    """Return the message and the advice for a table in which a speed or a turn rate is missing."""
    missing = [name for name in ODOMETRY if name not in columns]
    meaning = {"v": "the robot's speed (v)", "w": "its turn rate (w)"}
    words = " and ".join(meaning[name] for name in missing)
    options = " ".join(f"--set 'columns.{name}=ITS NAME'" for name in missing)
    known = shown_names(sample.names)
    message = (
        f"no column looks like {words}, by which the robot's heading moves on; there are {known}"
    )
    return f"{message}: say {options}"


def odometry_of(names: Sequence[str]) -> dict[str, NamedColumn]:
    """Return the columns of a robot's speed (v) and turn rate (w), by these quantities.

    If several columns may be one of them, it is the one with the surest name, and otherwise the first.
    """
    columns = {}
    fillers = _FILLERS_OF_ODOMETRY.union(FILLERS.split())
    for quantity, text in _ODOMETRY.items():
        candidates = []
        for index, name in enumerate(names):
            words = words_without_units(words_of(name))
            spellings = ("".join(words), "".join(word for word in words if word not in fillers))
            # The words of `_ODOMETRY` begin with the surest one, which has the rank 0.
            ranks = [text.split().index(word) for word in spellings if word in text.split()]
            if ranks:
                candidates.append((min(ranks), index, name))
        if candidates:
            *_, name = min(candidates)
            columns[quantity] = NamedColumn(column=name, unit=unit_of(name, quantity))
    return columns


def heading_of(names: Sequence[str]) -> NamedColumn | None:
    """Return the column of a robot's heading by its name, with the unit in it; None without one."""
    fillers = FILLERS.split()
    words_of_names = [words_of(name) for name in names]
    for name, all_words in zip(names, words_of_names, strict=True):
        # orientation.z beside orientation.w is the sine of half a heading, of a unit quaternion.
        if all_words[-1:] == ["z"] and [*all_words[:-1], "w"] in words_of_names:
            continue
        words = words_without_units(all_words)
        spellings = ("".join(words), "".join(word for word in words if word not in fillers))
        if any(spelling in _HEADINGS for spelling in spellings):
            # A heading may have any unit of an angle, as a course may.
            return NamedColumn(column=name, unit=unit_of(name, "course"))
    return None
