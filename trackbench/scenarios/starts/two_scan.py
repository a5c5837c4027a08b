"""Start `two-scan`: two-point differencing of the first two scans."""

from dataclasses import dataclass
from typing import ClassVar

from trackbench.core.arrays import Array
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.core.random_streams import Streams
from trackbench.models.sensors.range_azimuth import RangeAzimuth
from trackbench.models.sensors.stacked import Sensors
from trackbench.models.two_scan_prior import TwoPoint, two_point_difference
from trackbench.registry import register
from trackbench.scenarios.position_from_one_scan import position_by_one_scan
from trackbench.scenarios.starts.base import InitialScans
from trackbench.scenarios.starts.from_scans import FromScans


@register("starts", "two-scan")
@dataclass(frozen=True, kw_only=True)
class TwoScan(FromScans):
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
        """Return the distribution of the state at the second scan.

        ``opening`` has both scans, the time T between them, and the spectral density ``diffusion`` of
        the target's white acceleration, m^2/s^3. ``nominal`` and ``rng`` are for starts that depend on
        the configured state, or that draw.
        """
        # Of a plain radar at the origin (`gives_scans`) the prior keeps the two scans themselves:
        # filters convert them to positions in the way that they choose, or draw particles from their
        # polar density.
        if gives_scans(sensor):
            assert isinstance(sensor, RangeAzimuth)
            first_scan = opening.scans[:, 0]
            second_scan = opening.scans[:, 1]
            # A recording whose runs differ in T has been rejected.
            assert isinstance(opening.T, float | int)
            return TwoPoint(sensor, first_scan, second_scan, opening.T, opening.diffusion)
        # Position of each scan; their difference over T is the velocity.
        first = self.located(opening, sensor, scan=0)
        second = self.located(opening, sensor, scan=1)
        return two_point_difference(first, second, opening.T, opening.diffusion)

    def bound(self, path: Array, k: int, sensor: Sensors, T: float, diffusion: float) -> Array:
        """Return the covariance (n, n) of two-point differencing at the truth.

        Nothing is known about the velocity beforehand. ``path`` (n, K) has the true states from step k
        on, at which the first scan is taken; the second one follows ``T`` seconds later. ``diffusion``
        is the spectral density of the target's white acceleration, m^2/s^3.
        """
        first = position_by_one_scan(sensor, path[:, 0], k)
        second = position_by_one_scan(sensor, path[:, 1], k + 1)
        return two_point_difference(first, second, T, diffusion).cov


def gives_scans(sensor: object) -> bool:
    """Test whether two scans are a prior of their own: a plain radar at the origin.

    `TwoPoint` converts scans to positions relative to the sensor, and a subclass may measure otherwise.
    """
    return type(sensor) is RangeAzimuth and sensor.at_origin
