"""Sensors that the compiled kernels measure with."""

from typing import NamedTuple

import numpy as np

from trackbench.core import elementary_tables
from trackbench.core.arrays import Array, Index
from trackbench.models.base import Sensor
from trackbench.models.sensors.base import SensorBase
from trackbench.models.sensors.position import LinearSensor
from trackbench.models.sensors.range_azimuth import RangeAzimuth


class MeasuredByKernel(NamedTuple):
    """Sensor of the C kernels, which measures components of the state, or is a radar.

    A radar measures range and azimuth of the positions, which are the components 0 and 2.
    """

    R: Array
    """noise covariance (n_z, n_z)"""
    rows: tuple[int, ...] = ()
    """measured components of the state, unless this is a radar"""
    place: tuple[float, ...] | None = None
    """position of the radar, m; None if the sensor is none"""

    @property
    def is_radar(self) -> bool:
        """True if the sensor is a radar."""
        return self.place is not None

    def arguments(self) -> tuple[Index, Array, Array, Array]:
        """Return the arrays that the kernels take: rows, place, table of the arctangent, and pi.

        The rows are the state's measured components, and the place (2,) is the position of a radar.
        """
        # The kernels read the place of a radar, or else the rows. The unused one gets any numbers.
        place = np.array(self.place if self.place is not None else (0.0, 0.0))
        rows = np.array(self.rows or (0, 2), dtype=np.intp)
        arctangents, pi = elementary_tables.arctangent_tables()
        return rows, place, arctangents, pi


def measured_by_kernel(sensor: Sensor, n: int) -> MeasuredByKernel | None:
    """Return what the C kernels need of a sensor.

    The kernels have a fixed radar of range and azimuth, and linear sensors that measure components of
    the state.

    Parameters
    ----------
    sensor : Sensor
        Sensor.
    n : int
        Number of the state's components.

    Returns
    -------
    MeasuredByKernel or None
        Sensor of the kernels. None for any other sensor.
    """
    if type(sensor) is RangeAzimuth and sensor.platform is None:
        # A sensor without the key `at` stands at the origin.
        return MeasuredByKernel(R=sensor.R, place=sensor.at or (0.0, 0.0))
    if not isinstance(sensor, LinearSensor):
        return None
    # A subclass, such as a plugin's, may measure in a way of its own. ``places`` is the slice of the
    # state that a linear sensor measures.
    cls = type(sensor)
    if cls.measurement is LinearSensor.measurement and cls.innovation is SensorBase.innovation:
        return MeasuredByKernel(R=sensor.R, rows=tuple(range(n)[sensor.places]))
    return None
