"""Start from the first scans, which the filters then are not given again."""

from dataclasses import dataclass

from trackbench.core.distributions import Gaussian
from trackbench.field_types import InvalidKeyError
from trackbench.models.component_names import position_velocity_names
from trackbench.models.sensors.stacked import Sensors
from trackbench.scenarios.position_from_one_scan import position_part
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
        """Return the position that a scan measures.

        Parameters
        ----------
        opening : InitialScans
            Scans that the start uses up.
        sensor : Sensors
            Sensor, or all sensors as one. The first one that measures a position is used.
        scan : int
            Number of the scan, counted from 0.

        Returns
        -------
        Gaussian
            Position (axes, M), m, and its covariance (axes, axes[, M]), m^2.
        """
        sensor_and_rows = position_part(sensor)
        assert sensor_and_rows is not None
        locating_sensor, rows = sensor_and_rows
        return locating_sensor.located(opening.scans[rows, scan], opening.first_step + scan)
