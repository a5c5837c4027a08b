"""The Kalman filter."""

from dataclasses import dataclass
from typing import ClassVar

from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.core.kalman import Updated
from trackbench.filters.gaussian import GaussianFilter
from trackbench.models.base import Model
from trackbench.models.gaussian import AS_IT_IS, extended_step
from trackbench.registry import register


@register("filters", "kf")
@dataclass(frozen=True, kw_only=True)
class KF(GaussianFilter):
    """Kalman filter of a linear motion and a linear sensor (adaptive-kf paper, eqs. 8-12).

    The covariance does not depend on the data, so it and the gain are computed once for all runs.
    """

    needs: ClassVar[tuple[str, ...]] = ("motion.F|linear", "sensor.H")

    def updated(self, model: Model, state: Gaussian, z: Array, k: int) -> Updated:
        """Predict and update: of a linear model the extended step is the Kalman filter's."""
        return extended_step(model, state, z, k, AS_IT_IS)
