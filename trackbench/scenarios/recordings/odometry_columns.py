"""Names of columns with the speed, turn rate and heading of a robot, or with its quaternion."""

from collections.abc import Sequence

from trackbench.scenarios.recordings.quantity_column_names import (
    FILLERS,
    NamedColumn,
    unit_of,
    words_of,
    words_without_units,
)
from trackbench.scenarios.recordings.quantity_keys import QUATERNION

_ODOMETRY = {
    "v": "v speed velocity vel linearvelocity linearx linear forwardvelocity forwardspeed "
    "linearvelocityx",
    "w": "w omega yawrate turnrate angularvelocity angularz angular wz gyroz angularvelocityz",
}
"""Names of the columns of a robot's speed and turn rate, the surest first."""
_FILLERS_OF_ODOMETRY = frozenset(("twist", "cmd", "imu", "vel", "velocity"))
"""Further words that may stand beside a speed or a turn rate: field.twist.twist.linear.x of ROS."""
_HEADINGS = ("heading", "theta", "yaw", "psi", "phi", "orientation", "hdg")
_QUATERNIONS = frozenset(
    (
        "q",
        "quat",
        "quaternion",
        "orientation",
        "orient",
        "ori",
        "rot",
        "rotation",
        "attitude",
        "att",
    )
)
"""Words before the x, y, z and w of a quaternion."""


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


def quaternion_of(names: Sequence[str]) -> dict[str, str]:
    """Return the columns of a quaternion by their names, by component (qx); empty without all four.

    The names end in x, y, z and w after the same words, as quat_x, qx or field.pose.orientation.x do.
    """
    fillers = FILLERS.split()
    # Columns by component, of each group of columns with the same words before it.
    groups: dict[tuple[str, ...], dict[str, str]] = {}
    for name in names:
        words = words_of(name)
        # qx is one word, and quat_x has two.
        before = (*words[:-1], words[-1][:-1])
        component = f"q{words[-1][-1:]}"
        stem = "".join(word for word in before if word not in fillers)
        if component in QUATERNION and stem in _QUATERNIONS:
            groups.setdefault(before, {}).setdefault(component, name)
    for columns in groups.values():
        if len(columns) == len(QUATERNION):
            return {component: columns[component] for component in QUATERNION}
    return {}
