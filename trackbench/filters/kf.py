"""The Kalman filter: a step reads on from `GaussianFilter.step` to `KF.update` to `core/kalman.py`."""

from dataclasses import dataclass
from typing import ClassVar, cast

from trackbench.core import kalman
from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.core.kalman import Updated
from trackbench.filters.all_steps_at_once import is_plain, linear_steps
from trackbench.filters.base import Steps
from trackbench.filters.gaussian_base import GaussianFilter, Tracked
from trackbench.models.base import Differentiable, Model
from trackbench.models.numerical_derivatives import jacobian_at
from trackbench.registry import register


@register("filters", "kf")
@dataclass(frozen=True, kw_only=True)
class KF(GaussianFilter):
    """Kalman filter for a linear motion and a linear sensor (adaptive-kf paper, eqs. 8-12).

    The covariance does not depend on the data: it and the gain are computed once for all runs.
    """

    requires: ClassVar[tuple[str, ...]] = ("motion.F|linear", "sensor.H|linear")
    is_linear: ClassVar[bool] = True

    def update(self, model: Model, state: Gaussian, z: Array, k: int) -> Updated:
        """Predict with F and Q, update with H and R."""
        # A cast, because isinstance of a Protocol at every step takes as long as the step.
        motion, sensor = cast(Differentiable, model)
        # Step 1: m^- = F m, P^- = F P F' + Q.
        transition = motion.transition(state.mean, k)
        F = jacobian_at(motion, state, k)
        predicted = kalman.predict(state, F, transition.cov, transition.mean)
        # Step 2: the innovation nu = z - H m^-.
        measurement = sensor.measurement(predicted.mean, k)
        nu = sensor.innovation(z, measurement.mean)
        # Step 3: S = H P^- H' + R, K = P^- H' S^-1;
        # m = m^- + K nu, P = (I - K H) P^- (I - K H)' + K R K'.
        H = jacobian_at(sensor, predicted, k)
        return kalman.update(predicted, nu, H, measurement.cov)

    def all_steps(self, model: Model, state: Tracked, z: Array, k: int) -> Steps | None:
        """Filter all measurements z (n_z, T, M) in one call; None unless this is a plain KF.

        The sensor must also be constant, and the model small.
        """
        if not is_plain(self, KF, "smooth"):
            return None
        return linear_steps(model, state, z, k)
