"""Start `gaussian`: the prior mean is the truth plus a normal error."""

from dataclasses import dataclass
from typing import ClassVar

from trackbench.core.arrays import Array
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.core.random_streams import Streams
from trackbench.models.sensors.stacked import Sensors
from trackbench.registry import register
from trackbench.scenarios.starts.base import InitialScans
from trackbench.scenarios.starts.normal_distribution import NormalStart


@register("starts", "gaussian")
@dataclass(frozen=True, kw_only=True)
class GaussianStart(NormalStart):
    """The prior mean is the truth plus a normal error, whose covariance every filter has.

    The truth of a driven target is drawn about its configured state; about a path that is flown in every
    run the prior's mean is.
    """

    of_truth: ClassVar[bool] = True

    def truth(self, nominal: Array, rng: Streams) -> Array:
        """Draw the truth (n_x, M) about the configured state (n_x, M)."""
        return Gaussian(nominal, self._cov).sample(rng)

    def prior(
        self, opening: InitialScans, sensor: Sensors, nominal: Array | None, rng: Streams
    ) -> Distribution:
        """Return the distribution about ``nominal`` (n_x, M), from which the truth was drawn.

        If the truth was not drawn, ``nominal`` is None, and the prior's mean is drawn about the truth
        (n_x, M) in ``opening``.
        """
        if nominal is not None:
            return Gaussian(nominal, self._cov)
        mean = Gaussian(opening.truth, self._cov).sample(rng)
        return Gaussian(mean, self._cov)
