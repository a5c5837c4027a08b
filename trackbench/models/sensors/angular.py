"""Base of the sensors that measure from a place of their own, with angles that wrap."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from trackbench.core.angles import wrap_angle
from trackbench.core.arrays import Array, with_trailing
from trackbench.field_types import Finite
from trackbench.models.sensors.base import SensorBase
from trackbench.models.sensors.platform import Platform, check_place


@dataclass(frozen=True, kw_only=True)
class AngularSensor(SensorBase):
    """Base of the sensors that measure from a position of their own."""

    at: tuple[Finite, ...] = ()
    """position of the sensor, m; default: the origin"""
    platform: Platform | None = None
    """path of a moving sensor, instead of a position"""

    angles: ClassVar[tuple[int, ...]]
    """indices of the components that are angles"""
    any_state: ClassVar[bool] = False
    axes: ClassVar[int] = 2
    """number of axes of the space"""
    standing: ClassVar[str] = ""
    """the sensor in words, if it cannot move"""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_place(self.at, self.platform, self.axes, self.standing)

    @property
    def at_origin(self) -> bool:
        """True if the sensor stands at the origin of the state's coordinates."""
        return self.platform is None and not any(self.at)

    def relative_position(self, x: Array, k: int) -> list[Array]:
        """Return the positions of states relative to the sensor's.

        Parameters
        ----------
        x : array (n_x, *batch)
            States, with the positions at even rows.
        k : int
            Step, on which the place of a moving sensor depends.

        Returns
        -------
        list of array (*batch)
            Coordinate along each axis, m.
        """
        positions = [x[2 * i] for i in range(self.axes)]
        if self.at_origin:
            return positions
        return [p - place for p, place in zip(positions, self.place(k), strict=True)]

    def absolute_position(self, position: Array, k: int) -> Array:
        """Return positions relative to the sensor plus the sensor's position at step k.

        Parameters
        ----------
        position : array (axes, M)
            Positions relative to the sensor, m.
        k : int
            Step, on which the place of a moving sensor depends.

        Returns
        -------
        array (axes, M)
            Positions in the coordinates of the state, m.
        """
        if self.at_origin:
            return position
        return position + with_trailing(np.array(self.place(k)), 1)

    def place(self, k: int) -> tuple[float, ...]:
        """Return the position of the sensor at step k.

        Parameters
        ----------
        k : int
            Step.

        Returns
        -------
        tuple of float (axes,)
            Position, m. It is empty for a sensor with neither `at` nor `platform`, which stands at the
            origin.
        """
        return self.platform.place(k) if self.platform is not None else self.at

    def innovation(self, z: Array, z_pred: Array) -> Array:
        """Compute ``z - z_pred`` (n_z, *batch) with angles wrapped to (-pi, pi]."""
        nu = z - z_pred
        for i in self.angles:  # rows of the measurement
            nu[i] = wrap_angle(nu[i])
        return nu
