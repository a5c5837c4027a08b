"""Starts from the first scans, which the filters then are not given again."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from trackbench.core import linalg
from trackbench.core.arrays import Array
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.core.random_streams import Streams
from trackbench.field_types import InvalidKeyError, Positive, Unit
from trackbench.models.component_names import position_velocity_names
from trackbench.models.sensors.range_azimuth import RangeAzimuth
from trackbench.models.sensors.stacked import Sensors
from trackbench.models.two_point_differencing import TwoPoint, two_point_difference
from trackbench.registry import register
from trackbench.scenarios.starts.base import InitialScans, Start, position_part


@dataclass(frozen=True, kw_only=True)
class _FromScans(Start):
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


def _position_by_one_scan(sensor: Sensors, x: Array, k: int) -> Gaussian:
    """Return the true position (axes, 1) of a state x (n,) at step k, as a scan would estimate it.

    The covariance (axes, axes) is the Cramer-Rao bound of the scan.
    """
    # Covariance of the position: inverse of its block of H' R^-1 H.
    information = sensor.information(x, k, certain=True)[0::2, 0::2]
    return Gaussian(x[0::2, None], linalg.inverse(information))


@register("starts", "two-scan")
@dataclass(frozen=True, kw_only=True)
class TwoScan(_FromScans):
    """Two-point differencing: the position of the second scan, and its distance from the first over T.

    Bar-Shalom, Li & Kirubarajan 2001, section 5.5.3. Of a radar at the origin every filter is given the
    two scans themselves, and takes from them what it needs: a converted position, or draws.
    """

    scans: ClassVar[int] = 2

    def prior_type(self, sensor: Sensors) -> type[Distribution]:
        """Return the class of two scans for a radar at the origin, else the class of a Gaussian."""
        return TwoPoint if gives_scans(sensor) else Gaussian

    def prior(
        self, opening: InitialScans, sensor: Sensors, nominal: Array | None, rng: Streams
    ) -> Distribution:
        """Return the distribution of the state at the second scan."""
        # Of a plain radar at the origin the prior keeps the two scans themselves: filters convert them
        # to positions in the way that they choose, or draw particles from their polar density.
        if gives_scans(sensor):
            assert isinstance(sensor, RangeAzimuth)
            first_scan = opening.scans[:, 0]
            second_scan = opening.scans[:, 1]
            # A recording whose runs differ in T has been rejected.
            assert isinstance(opening.T, float | int)
            return TwoPoint(sensor, first_scan, second_scan, opening.T, opening.diffusion)
        # Position of each scan; their difference over T is the velocity.
        first = self.located(opening, sensor, 0)
        second = self.located(opening, sensor, 1)
        return two_point_difference(first, second, opening.T, opening.diffusion)

    def bound(self, path: Array, k: int, sensor: Sensors, T: float, diffusion: float) -> Array:
        """Return two-point differencing at the truth, without prior knowledge of the velocity.

        ``path`` (n, K) has the true states from step k on, at which the first scan is taken.
        """
        first = _position_by_one_scan(sensor, path[:, 0], k)
        second = _position_by_one_scan(sensor, path[:, 1], k + 1)
        return two_point_difference(first, second, T, diffusion).cov


@register("starts", "one-scan")
@dataclass(frozen=True, kw_only=True)
class OneScan(_FromScans):
    """The position of the first scan, and a velocity of which only its usual size is known.

    Mallick & La Scala 2008.
    """

    sigma_velocity: Annotated[Positive, Unit("m/s")]
    """standard deviation of the velocity along each axis, m/s"""

    scans: ClassVar[int] = 1

    def prior(
        self, opening: InitialScans, sensor: Sensors, nominal: Array | None, rng: Streams
    ) -> Distribution:
        """Return the distribution of the state at the first scan."""
        position = self.located(opening, sensor, 0)
        axes, runs = position.mean.shape
        n = 2 * axes
        # Position by the scan; velocity zero, with sigma_velocity along each axis.
        mean = np.zeros((n, runs))
        mean[0::2] = position.mean
        cov = np.zeros((n, n, *position.cov.shape[2:]))
        cov[0::2, 0::2] = position.cov
        for i in range(1, n, 2):
            cov[i, i] = self.sigma_velocity * self.sigma_velocity
        return Gaussian(mean, cov)

    def bound(self, path: Array, k: int, sensor: Sensors, T: float, diffusion: float) -> Array:
        """Return the covariance of the first state: the scan's of the position, and the velocity's.

        ``path`` (n, K) has the true states from step k on, at which the scan is taken.
        """
        position = _position_by_one_scan(sensor, path[:, 0], k)
        variance = self.sigma_velocity * self.sigma_velocity
        cov = np.diag(np.full(len(path), variance))
        cov[0::2, 0::2] = position.cov
        return cov


def gives_scans(sensor: object) -> bool:
    """Test whether two scans are a prior of their own: a plain radar at the origin.

    `TwoPoint` converts scans to positions relative to the sensor, and a subclass may measure otherwise.
    """
    return type(sensor) is RangeAzimuth and sensor.at_origin
