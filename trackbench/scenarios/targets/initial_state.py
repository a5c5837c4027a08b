"""Initial state of a target: position and velocity, or polar coordinates about the origin."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.polar_conversions import position
from trackbench.field_types import Finite, Positive, Unit


@dataclass(frozen=True, kw_only=True)
class PolarLaunch:
    """The first state of a planar target in polar coordinates about the origin."""

    range_km: Positive
    """range"""
    azimuth_deg: Finite
    """azimuth"""
    velocity_radial: Annotated[Finite, Unit("m/s")] = 0.0
    """speed along the line of sight, m/s"""
    velocity_cross: Annotated[Finite, Unit("m/s")] = 0.0
    """speed across the line of sight, anticlockwise, m/s"""

    axes = 2

    @property
    def state(self) -> Array:
        """State (px, vx, py, vy), m and m/s."""
        azimuth = np.array(np.deg2rad(self.azimuth_deg))
        # Unit vectors along and across the line of sight.
        along = position(np.array(1.0), azimuth)
        across = position(np.array(1.0), azimuth + 0.5 * np.pi)
        state = np.empty(4)
        state[0::2] = 1e3 * self.range_km * along
        state[1::2] = self.velocity_radial * along + self.velocity_cross * across
        return state


@dataclass(frozen=True, kw_only=True)
class Launch:
    """Position and velocity at the first scan: of a planar target, unless z is given."""

    x: Finite = 0.0
    """m; of a scalar target its state"""
    y: Finite = 0.0
    """m"""
    z: Finite | None = None
    """height, m; default: the target moves in the plane"""
    vx: Finite = 0.0
    """m/s"""
    vy: Finite = 0.0
    """m/s"""
    vz: Finite = 0.0
    """m/s"""

    @property
    def axes(self) -> int:
        """Axes of the space the target moves in."""
        return 2 if self.z is None else 3

    @property
    def state(self) -> Array:
        """State (px, vx, py, vy[, pz, vz]), m and m/s."""
        state = [self.x, self.vx, self.y, self.vy]
        if self.z is not None:
            state += [self.z, self.vz]
        return np.array(state)
