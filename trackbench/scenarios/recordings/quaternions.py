"""Quaternions: their columns, checks, and the heading, which is the turn about the vertical axis."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array, Mask
from trackbench.core.elementary import arctan2
from trackbench.errors import counted_with_verb, in_line
from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.parse_tables import Table
from trackbench.scenarios.recordings.quantity_keys import QUATERNION
from trackbench.scenarios.recordings.recognize_column_names import FILLERS, words_of
from trackbench.scenarios.recordings.yaml_values import in_option

_ROUNDING = 0.05
"""difference from 1 that the norm of a written unit quaternion may have"""
_UPRIGHT = 0.8660254037844387  # cos(30 deg)
_MOST_TILTED = 0.1
"""share of the rows that may tilt far, beyond which the turn about the vertical is hardly a heading"""

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

_LEAST_ROTATIONS = 0.5
"""share of the rows whose quaternion must have the norm 1"""


class Quaternions(NamedTuple):
    """Components of quaternions, (R,) each, NaN where one is missing."""

    x: Array
    y: Array
    z: Array
    w: Array

    @property
    def is_known(self) -> Mask:
        """Mask (R,) of the rows with all components."""
        return np.asarray(np.isfinite(np.stack(self)).all(axis=0))

    @property
    def is_unit(self) -> Mask:
        """Mask (R,) of the rows whose norm is 1 but for rounding, which those of rotations have."""
        squared_norm = self.x**2 + self.y**2 + self.z**2 + self.w**2
        return np.asarray(np.abs(np.sqrt(squared_norm) - 1.0) < _ROUNDING)

    @property
    def heading(self) -> Array:
        """Turn (R,) about the axis z, rad, from x to y; NaN where a component is missing."""
        known = self.is_known
        x, y, z, w = (np.where(known, component, 0.0) for component in self)
        # yaw = atan2(2 (w z + x y), 1 - 2 (y^2 + z^2)); the norm w^2 + x^2 + y^2 + z^2 stands for 1, so
        # that rounding has no effect.
        yaw = arctan2(2.0 * (w * z + x * y), w**2 + x**2 - y**2 - z**2)
        return np.where(known, yaw, np.nan)

    @property
    def tilts_far(self) -> bool:
        """True if the axis z of the body is often more than 30 deg from the vertical."""
        unit = self.is_unit
        if not unit.any():
            return False
        # The body's axis z has this component along the vertical, which is the cosine of the tilt.
        upright = 1.0 - 2.0 * (self.x[unit] ** 2 + self.y[unit] ** 2)
        return bool((upright < _UPRIGHT).mean() > _MOST_TILTED)


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


def check_meaning_of_quaternions(
    path: str, quaternions: Quaternions, columns: Mapping[str, str]
) -> None:
    """Raise DataError, a question, if quaternions are hardly rotations about the vertical axis.

    ``columns`` are their columns in the file at ``path``, by component.
    """
    known = quaternions.is_known
    reason = ""
    if known.any() and quaternions.is_unit[known].mean() < _LEAST_ROTATIONS:
        reason = "most have not the norm 1"
    elif quaternions.tilts_far:
        reason = "its axis z is often more than 30 deg from the vertical"
    if not reason:
        return
    shown = ", ".join(in_line(column) for column in columns.values())
    question = f"{shown}: is the heading the turn of this quaternion about z, though {reason}?"
    name = in_option(columns["qx"])
    yes = Place(path, 1, 1, f"{question} Say --set 'columns.qx={name}'")
    no = Place(path, 1, 1, "or is there no heading? Say --set 'columns.heading=\"\"'")
    raise DataError(yes, no)


def empty_non_rotations(
    path: str, table: Table, columns: Sequence[str], quaternions: Quaternions
) -> list[str]:
    """Empty the cells of rows whose quaternion is no rotation, in place; return notes on them.

    A further note is on a far tilt. ``columns`` are those of the ``quaternions`` in the table of the
    file ``path``. Raises DataError if no row has a rotation.
    """
    shown = ", ".join(columns)
    notes = []
    is_wrong = quaternions.is_known & ~quaternions.is_unit
    if is_wrong.any() and not quaternions.is_unit.any():
        message = f"{shown}: no quaternion has the norm 1: they are no rotations"
        raise DataError(Place(path, 1, 1, message))
    if is_wrong.any():
        for column in columns:
            table.columns[column][is_wrong] = np.nan
        rows = counted_with_verb(int(is_wrong.sum()), "row", "has", "have")
        message = f"{rows} no heading, as the quaternion ({shown}) has not the norm 1"
        notes.append(f"{path}: {message}")
    if quaternions.tilts_far:
        message = f"the axis z of the quaternion ({shown}) is often more than 30 deg from the"
        message += " vertical, so that the heading about the vertical may mean little"
        notes.append(f"{path}: {message}")
    return notes
