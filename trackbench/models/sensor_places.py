"""Places from which the sensors of a model measure, as a dry run prints them."""

from trackbench.models.base import Model
from trackbench.models.model_for_programs import description_of
from trackbench.models.sensors.angular import AngularSensor
from trackbench.models.sensors.base import SensorBase
from trackbench.models.sensors.stacked import StackedSensor, sensors_of


def sensor_places(model: Model) -> list[tuple[float, ...]]:
    """List the positions from which the sensors of a model measure.

    Parameters
    ----------
    model : Model
        Filter model.

    Returns
    -------
    list of tuple of float
        Positions, m, in the sensors' order. Sensors on a moving platform, and those that measure from no
        position of their own, are left out.
    """
    # The description of a model from a config has the sensor that the config names. That of the model
    # may be wrapped, as one whose noise faults scale.
    description = description_of(model)
    sensor = model.sensor
    if description is not None:
        sensor = description.sensor
    if not isinstance(sensor, SensorBase | StackedSensor):
        return []
    places = []
    for single in sensors_of(sensor):
        if isinstance(single, AngularSensor) and single.platform is None:
            places.append(single.at or (0.0,) * single.axes)
    return places
