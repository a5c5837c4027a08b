"""One step of the extended Kalman filter, and of those by weighted points, on any model.

The same steps serve a filter of M runs (mean (n, M)) and a proposal per particle (mean (n, M, N)).
"""

from typing import NamedTuple, cast

import numpy as np

from trackbench.core import kalman, linalg
from trackbench.core.arrays import Array, with_trailing
from trackbench.core.counting import note
from trackbench.core.distributions import Gaussian, per_run_moments
from trackbench.core.kalman import Innovation, Updated
from trackbench.core.unscented import PointRule, SigmaPoints, Unscented
from trackbench.models.base import (
    DifferentiableMotion,
    DifferentiableSensor,
    Model,
    NormalMotion,
    Scene,
)


class AssumedNoise(NamedTuple):
    """The noise a Gaussian filter assumes: None takes the model's.

    Q and R are variances on every component. ``noise_mean`` adds the mean of the process noise to
    the prediction; without it a gamma-driven model is predicted 1.5 too low (a published reading).
    """

    Q: float | None = None
    R: float | None = None
    noise_mean: bool = True

    def transition(self, model: Model, x: Array, k: int) -> Gaussian:
        """Return the mean and covariance of x_k given x_{k-1} = x."""
        exact = model.motion.transition(x, k)
        if self.Q is None and self.noise_mean and isinstance(exact, Gaussian):
            return exact
        mean = exact.mean if self.noise_mean else exact.loc
        return Gaussian(mean, _either(self.Q, exact.cov))

    def measurement(self, model: Model, x: Array, k: int) -> Gaussian:
        """Return the mean and covariance of z_k given x_k = x."""
        exact = model.sensor.measurement(x, k)
        return exact if self.R is None else Gaussian(exact.mean, _either(self.R, exact.cov))


def idle_noise_mean(scene: Scene) -> dict[str, str]:
    """Return the reason, by key, why ``noise_mean`` changes nothing, if it does not."""
    if isinstance(scene.model.motion, NormalMotion):
        return {"noise_mean": "as the process noise has no mean here"}
    return {}


MODEL_NOISE = AssumedNoise()
"""The noise as it stands in the model."""


def _either(variance: float | None, cov: Array) -> Array:
    return cov if variance is None else variance * np.eye(cov.shape[0])


def extended_prediction(model: Model, state: Gaussian, k: int, assumed: AssumedNoise) -> Gaussian:
    """Return the prediction of x_k, the motion linearised at the mean."""
    # Cast, since to ask a Protocol at every step takes as long as the step.
    motion = cast(DifferentiableMotion, model.motion)
    moved = assumed.transition(model, state.mean, k)
    return kalman.predict(state, motion.jacobian(state.mean, k), moved.cov, moved.mean)


def extended_step(
    model: Model, state: Gaussian, z: Array, k: int, assumed: AssumedNoise
) -> Updated:
    """Predict to k and update with z: first-order linearisation at the mean and at the prediction."""
    sensor = cast(DifferentiableSensor, model.sensor)
    predicted = extended_prediction(model, state, k, assumed)
    seen = assumed.measurement(model, predicted.mean, k)
    nu = sensor.innovation(with_trailing(z, seen.mean.ndim - 1), seen.mean)
    return kalman.update(predicted, nu, sensor.jacobian(predicted.mean, k), seen.cov)


def augmented_size(model: Model) -> int:
    """Return the components of (x, v, n) that `augmented_step` draws sigma points of."""
    return 2 * len(model.motion.components) + len(model.sensor.components)


def spread_conflicts(
    alpha: float, kappa: float, model: Model, augmented: bool = True
) -> dict[str, str]:
    """Return mistakes by key if the sigma points coincide: alpha^2 (n + kappa) must be positive."""
    n = augmented_size(model) if augmented else len(model.motion.components)
    if n + kappa <= 0:
        parts = ", of state, noise and measurement" if augmented else ""
        return {"kappa": f"n + kappa must be greater than 0; n = {n}{parts}"}
    if not 0 < alpha * alpha * (n + kappa) < float("inf"):
        return {"alpha": f"alpha^2 (n + kappa) must be a finite number greater than 0; n = {n}"}
    return {}


def augmented_step(
    model: Model, state: Gaussian, z: Array, k: int, assumed: AssumedNoise, rule: PointRule
) -> Updated:
    """Predict to k and update with z by one set of points of the augmented state (x, v, n).

    The points go through the motion and then the sensor (van der Merwe et al. 2000, section 3.2).
    """
    n_x = state.mean.shape[0]
    probe = assumed.transition(model, state.mean, k)
    R = assumed.measurement(model, probe.mean, k).cov
    augmented = _augmented(state, probe.cov, R)
    points = rule.points(augmented.mean, augmented.cov)
    x, v, n = points.x[:n_x], points.x[n_x : 2 * n_x], points.x[2 * n_x :]
    moved = assumed.transition(model, x, k).mean + v
    return _conditioned(model, points, moved, points.moments(moved), z, k, n, None)


def point_prediction(
    model: Model, state: Gaussian, k: int, assumed: AssumedNoise, rule: PointRule
) -> Gaussian:
    """Return the prediction of x_k by points of the state, the noise's covariance added."""
    points = rule.points(state.mean, state.cov)
    Q = assumed.transition(model, state.mean, k).cov
    moved = points.moments(assumed.transition(model, points.x, k).mean)
    return Gaussian(moved.mean, moved.cov + with_trailing(Q, state.mean.ndim - 1, leading=2))


def additive_step(
    model: Model, state: Gaussian, z: Array, k: int, assumed: AssumedNoise, rule: PointRule
) -> Updated:
    """Predict to k by points of the state, and update with z by new points of the prediction.

    The noise of either is added to the covariance (Arasaratnam & Haykin 2009, section 5).
    """
    predicted = point_prediction(model, state, k, assumed, rule)
    return _additive_update(model, predicted, z, k, assumed, rule)


def _additive_update(
    model: Model, predicted: Gaussian, z: Array, k: int, assumed: AssumedNoise, rule: PointRule
) -> Updated:
    points = rule.points(predicted.mean, predicted.cov)
    R = assumed.measurement(model, predicted.mean, k).cov
    R = with_trailing(R, predicted.mean.ndim - 1, leading=2)
    return _conditioned(model, points, points.x, predicted, z, k, None, R)


def predicted_innovation(model: Model, predicted: Gaussian, z: Array, k: int) -> Innovation:
    """Return z (n_z, M) minus its mean given N(mean, cov) of x_k, and its covariance, by cubature."""
    cubature = Unscented(1.0, 0.0, 0.0)
    return _additive_update(model, per_run_moments(predicted), z, k, MODEL_NOISE, cubature)[1]


def _conditioned(
    model: Model,
    points: SigmaPoints,
    x: Array,
    predicted: Gaussian,
    z: Array,
    k: int,
    noise: Array | None,
    R: Array | None,
) -> Updated:
    """Return the prediction given z: moments over points x of what the sensor makes of them.

    Its noise is in the points, or its covariance is added.
    """
    z_pred = model.sensor.measurement(x, k).mean
    # Deviations from the first point keep angles away from the cut while they are averaged.
    centre = z_pred[:, :1]
    seen = model.sensor.innovation(z_pred, centre)
    seen = seen if noise is None else seen + noise
    z_mean = points.mean(seen)
    dz, dx = seen - z_mean[:, None], x - predicted.mean[:, None]
    S, C = points.cross(dz, dz), points.cross(dx, dz)
    S = S if R is None else S + R
    batch = predicted.mean.shape[1:]
    z = np.broadcast_to(with_trailing(z, len(batch)), (len(z), *batch))
    nu = model.sensor.innovation(z, centre[:, 0] + z_mean)
    missing = np.isnan(nu) & np.isfinite(predicted.mean).all(axis=0)
    if missing.any():
        rows, S = kalman.drop_missing(linalg.transpose(C), S, missing)
        C = linalg.transpose(rows)
    note("covariances", S, components=2)
    K = linalg.matmul(C, linalg.inverse(S))
    mean = predicted.mean + linalg.matvec(K, np.where(missing, 0.0, nu))
    return Gaussian(mean, predicted.cov - linalg.sandwich(K, S)), Innovation(nu, S)


def _augmented(state: Gaussian, Q: Array, R: Array) -> Gaussian:
    n_x, n_v, n_n = state.mean.shape[0], Q.shape[0], R.shape[0]
    n, batch = n_x + n_v + n_n, state.mean.shape[1:]
    mean = np.zeros((n, *batch))
    cov = np.zeros((n, n, *batch))
    mean[:n_x] = state.mean
    cov[:n_x, :n_x] = with_trailing(state.cov, len(batch), leading=2)
    cov[n_x : n_x + n_v, n_x : n_x + n_v] = with_trailing(Q, len(batch), leading=2)
    cov[n_x + n_v :, n_x + n_v :] = with_trailing(R, len(batch), leading=2)
    return Gaussian(mean, cov)
