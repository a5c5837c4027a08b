"""Headings from quaternions: the turn about the vertical axis of a rotation in space."""

from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array, Mask
from trackbench.core.elementary import arctan2

_ROUNDING = 0.05
"""difference from 1 that the norm of a written unit quaternion may have"""
_UPRIGHT = 0.8660254037844387  # cos(30 deg)
_MOST_TILTED = 0.1
"""share of the rows that may tilt far, beyond which the turn about the vertical is hardly a heading"""


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
