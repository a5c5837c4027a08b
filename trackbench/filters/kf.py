"""The Kalman filter."""

from dataclasses import dataclass
from typing import ClassVar

from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.core.kalman import Updated
from trackbench.filters.gaussian_base import GaussianFilter
from trackbench.models.base import Model
from trackbench.models.gaussian_steps import MODEL_NOISE, extended_step
from trackbench.registry import register


@register("filters", "kf")
@dataclass(frozen=True, kw_only=True)
class KF(GaussianFilter):
    """Kalman filter for a linear motion and a linear sensor (adaptive-kf paper, eqs. 8-12).

    The covariance does not depend on the data: it and the gain are computed once for all runs.
    """

    requires: ClassVar[tuple[str, ...]] = ("motion.F|linear", "sensor.H")
    is_linear: ClassVar[bool] = True

    def update(self, model: Model, state: Gaussian, z: Array, k: int) -> Updated:
        """Predict and update: for a linear model the extended step is the Kalman filter's."""
        return extended_step(model, state, z, k, MODEL_NOISE)
