"""Sensors that the compiled kernels measure with."""

from trackbench.core.compiled_steps import MeasuredByKernel
from trackbench.models.base import Sensor
from trackbench.models.sensors.base import SensorBase
from trackbench.models.sensors.position import LinearSensor
from trackbench.models.sensors.range_azimuth import RangeAzimuth


def measured_by_kernel(sensor: Sensor, n: int) -> MeasuredByKernel | None:
    """Return what the C kernels need of a sensor for states of n components.

    The kernels have a fixed radar of range and azimuth, and linear sensors that measure components of
    the state. The result is None for any other sensor.
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
