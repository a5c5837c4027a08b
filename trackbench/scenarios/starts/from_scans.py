"""Start from the first scans, which the filters then are not given again."""

from dataclasses import dataclass

from trackbench.core import linalg
from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.field_types import InvalidKeyError
from trackbench.models.base import LocatingSensor
from trackbench.models.component_names import position_velocity_names
from trackbench.models.sensors.stacked import Sensors, rows_of, sensors_of
from trackbench.scenarios.starts.base import InitialScans, Start


@dataclass(frozen=True, kw_only=True)
class FromScans(Start):
    """Base of the starts from scans, which tell a position in one scan."""

    def check(self, components: tuple[str, ...], sensor: Sensors) -> None:
        """Check that a sensor measures the position along every axis of the target."""
        if components not in (position_velocity_names(2), position_velocity_names(3)):
            raise InvalidKeyError("scans start a target in the plane or in space only", "start")
        sensor_and_rows = position_part(sensor)
        if sensor_and_rows is None:
            raise InvalidKeyError("no sensor here tells a position in one scan", "start")
        locating_sensor, _ = sensor_and_rows
        if 2 * locating_sensor.axes != len(components):
            message = (
                f"the sensor sees {locating_sensor.axes} axes of a target in {len(components) // 2}"
            )
            raise InvalidKeyError(message, "start")

    def located(self, opening: InitialScans, sensor: Sensors, scan: int) -> Gaussian:
        """Return the position (axes, M) measured by scan ``scan``, counted from 0, with covariance."""
        sensor_and_rows = position_part(sensor)
        assert sensor_and_rows is not None
        locating_sensor, rows = sensor_and_rows
        return locating_sensor.located(opening.scans[rows, scan], opening.first_step + scan)


def position_by_one_scan(sensor: Sensors, x: Array, k: int) -> Gaussian:
    """Return the true position (axes, 1) of a state x (n,) at step k, as a scan would estimate it.

    The covariance (axes, axes) is the Cramer-Rao bound of a scan that detects the target for certain:
    a start from scans has scans without a miss. The state is position and velocity along each axis, one
    after the other, as `FromScans.check` has made sure.
    """
    # Covariance of the position: inverse of its block of H' R^-1 H. Positions are the even rows.
    information = sensor.information(x, k, certain=True)[0::2, 0::2]
    return Gaussian(x[0::2, None], linalg.inverse(information))


def position_part(sensor: Sensors) -> tuple[LocatingSensor, slice] | None:
    """Return the first sensor that measures a position, and its rows of the stacked measurement.

    None if no sensor does.
    """
    for each, rows in zip(sensors_of(sensor), rows_of(sensor), strict=True):
        if isinstance(each, LocatingSensor):
            return each, rows
    return None
