"""Start `one-scan`: the position of the first scan, and a velocity of usual size."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.core.random_streams import Streams
from trackbench.field_types import Positive, Unit
from trackbench.models.sensors.stacked import Sensors
from trackbench.registry import register
from trackbench.scenarios.position_from_one_scan import position_by_one_scan
from trackbench.scenarios.starts.base import InitialScans
from trackbench.scenarios.starts.from_scans import FromScans


@register("starts", "one-scan")
@dataclass(frozen=True, kw_only=True)
class OneScan(FromScans):
    """The position of the first scan, and a velocity of which only its usual size is known.

    Mallick & La Scala 2008.
    """

    sigma_velocity: Annotated[Positive, Unit("m/s")]
    """standard deviation of the velocity along each axis, m/s"""

    scans: ClassVar[int] = 1

    def prior(
        self, opening: InitialScans, sensor: Sensors, nominal: Array | None, rng: Streams
    ) -> Distribution:
        """Return the distribution of the state at the first scan, the only one in ``opening``.

        ``nominal`` and ``rng`` are for starts that depend on the configured state, or that draw.
        """
        position = self.located(opening, sensor, scan=0)
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

        ``path`` (n, K) has the true states from step k on, at which the scan is taken. ``T`` and
        ``diffusion`` are for starts from several scans.
        """
        position = position_by_one_scan(sensor, path[:, 0], k)
        variance = self.sigma_velocity * self.sigma_velocity
        cov = np.diag(np.full(len(path), variance))
        cov[0::2, 0::2] = position.cov
        return cov
