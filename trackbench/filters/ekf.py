"""Kalman filters that linearize the model by Jacobians: EKF and iterated EKF.

The EKF's step reads on from `GaussianFilter.step` to `extended_step` to `core/kalman.py`.
"""

from dataclasses import dataclass
from typing import ClassVar, Literal, cast

import numpy as np

from trackbench.core import kalman, linalg
from trackbench.core.arrays import Array, with_trailing
from trackbench.core.distributions import Gaussian
from trackbench.core.kalman import Innovation, Updated
from trackbench.core.rts_smoother import Transition
from trackbench.field_types import Count
from trackbench.filters.all_steps_at_once import is_plain, linear_steps, nonlinear_steps
from trackbench.filters.assumed_noise import AssumedNoise
from trackbench.filters.base import Steps
from trackbench.filters.ekf_linearization import (
    extended_prediction,
    extended_transition,
    with_curvature,
)
from trackbench.filters.gaussian_base import NonlinearFilter, Tracked
from trackbench.filters.merwe_demo import MERWE_DEMO
from trackbench.models.base import Differentiable, DifferentiableSensor, Model, Scene
from trackbench.models.numerical_derivatives import jacobian_at
from trackbench.models.sensors.position import LinearSensor
from trackbench.registry import register


def extended_step(
    model: Model, state: Gaussian, z: Array, k: int, assumed: AssumedNoise, order: int = 1
) -> Updated:
    """Predict to k and update with z, with motion f and sensor h expanded at the means.

    Parameters
    ----------
    model : Model
        Motion and sensor.
    state : Gaussian
        Posterior of step k - 1: m (n_x, *batch), P (n_x, n_x[, *batch]). The batch is the runs (M,), or
        runs and particles (M, N).
    z : array (n_z, M)
        Measurements of step k; NaN where one is missing.
    k : int
        Number of the step.
    assumed : AssumedNoise
        Noise that the filter assumes.
    order : {1, 2}
        Order of the expansion.

    Returns
    -------
    Updated
        Posterior, and the innovation with S.
    """
    sensor = cast(DifferentiableSensor, model.sensor)
    # Step 1: m^- = f(m), P^- = F P F' + Q with the Jacobian F of f at m.
    predicted = extended_prediction(model, state, k, assumed, order)
    # Step 2: the innovation nu = z - h(m^-).
    measurement = assumed.measurement(model, predicted.mean, k)
    if order == 2:
        measurement = with_curvature(measurement, sensor, predicted, k)
    z_of_batch = with_trailing(z, measurement.mean.ndim - 1)  # the particles of a run share its z
    nu = sensor.innovation(z_of_batch, measurement.mean)
    # Step 3: S = H P^- H' + R, K = P^- H' S^-1 with the Jacobian H of h at m^-;
    # m = m^- + K nu, P = (I - K H) P^- (I - K H)' + K R K'.
    H = jacobian_at(sensor, predicted, k)
    return kalman.update(predicted, nu, H, measurement.cov)


@register("filters", "ekf")
@dataclass(frozen=True, kw_only=True)
class EKF(NonlinearFilter):
    """Extended Kalman filter: first-order linearization at the mean (Anderson & Moore 1979).

    The second-order filter (Athans, Wishner & Bertolini 1968) adds the bias and the covariance of the
    second derivatives. They are expressions for the motion ``map`` and the sensor ``function``, else
    differences of the Jacobian.
    """

    order: Literal[1, 2] = 1
    """order of the expansion; 2 has the exact moments of a quadratic function"""
    requires: ClassVar[tuple[str, ...]] = ("motion.jacobian", "sensor.jacobian")
    presets: ClassVar[dict[str, dict[str, object]]] = {"merwe-demo": MERWE_DEMO}

    def idle_keys(self, scenario: Scene) -> dict[str, str]:
        """Report also ``order`` as idle if the Jacobians are constant."""
        idle = super().idle_keys(scenario)
        motion, sensor = cast(Differentiable, scenario.model)
        x = np.ones((len(motion.components), 1))
        # Any step with a measurement will do, such as the last.
        k = int(scenario.steps[-1])
        # A constant Jacobian is a matrix without batch axes.
        if motion.jacobian(x, k).ndim == 2 and sensor.jacobian(x, k).ndim == 2:
            idle["order"] = "as motion and sensor are linear"
        return idle

    def all_steps(self, model: Model, state: Tracked, z: Array, k: int) -> Steps | None:
        """Filter all measurements z (n_z, T, M) in one call, with the results of `step` bit for bit.

        A linear model is filtered as by a Kalman filter. None unless this is a plain EKF, and motion and
        sensor are linear and all runs have one covariance, or `nonlinear_steps` can filter with them.
        """
        # These keys may have any value, as they change no step; all others must have their defaults.
        if not is_plain(self, EKF, "smooth", "start", "P0"):
            return None
        if not isinstance(model.sensor, LinearSensor):
            return nonlinear_steps(model, state, z, k, keeps_predictions=not self.smooths)
        cov = with_trailing(state.posterior.cov, 1, leading=2)
        if (cov != cov[..., :1]).any():  # the runs have different covariances
            return None
        with_one_covariance = Gaussian(state.posterior.mean, cov[..., 0])
        # None if the motion is not linear.
        return linear_steps(model, state._replace(posterior=with_one_covariance), z, k)

    def update(self, model: Model, state: Gaussian, z: Array, k: int) -> Updated:
        """Predict and update by the derivatives."""
        return extended_step(model, state, z, k, self.assumed, self.order)

    def transition(self, model: Model, state: Gaussian, k: int) -> Transition:
        """Predict to step k by the derivatives, with the covariance with x_{k-1}."""
        return extended_transition(model, state, k, self.assumed, self.order)


@register("filters", "iekf")
@dataclass(frozen=True, kw_only=True)
class IEKF(NonlinearFilter):
    """Iterated extended Kalman filter: Gauss-Newton steps to the posterior's mode.

    Bell & Cathey 1993; Bar-Shalom, Li & Kirubarajan 2001, section 10.5.2.
    """

    iterations: Count = 5
    """linearizations per update; 1 is the EKF"""
    requires: ClassVar[tuple[str, ...]] = ("motion.jacobian", "sensor.jacobian")

    def update(self, model: Model, state: Gaussian, z: Array, k: int) -> Updated:
        """Predict; linearize the measurement again at each new estimate."""
        sensor = cast(DifferentiableSensor, model.sensor)
        predicted = extended_prediction(model, state, k, self.assumed)
        posterior = predicted
        innovations: list[Innovation] = []
        for _ in range(self.iterations):
            # nu = z - h(x_i) - H_i (m - x_i), about the estimate x_i of the iteration before
            H = jacobian_at(sensor, posterior, k)
            expected = self.assumed.measurement(model, posterior.mean, k)
            residual = sensor.innovation(z, expected.mean)
            nu = residual - linalg.matvec(H, predicted.mean - posterior.mean)
            posterior, innovation = kalman.update(predicted, nu, H, expected.cov)
            innovations.append(innovation)
        # The NIS is that of the first iteration, about the prediction.
        return posterior, innovations[0]
