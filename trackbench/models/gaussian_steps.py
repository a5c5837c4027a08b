"""Steps of the extended Kalman filter and of sigma-point filters, on any model.

They serve a filter of M runs (mean (n, M)) and a proposal per particle (mean (n, M, N)).
"""

from collections.abc import Sequence
from typing import NamedTuple, cast

import numpy as np

from trackbench.core import kalman, linalg
from trackbench.core.arrays import Array, Mask, any_nan, note, with_axes_of, with_trailing
from trackbench.core.distributions import Factored, Gaussian, from_root, per_run_moments, root_of
from trackbench.core.kalman import Innovation, Updated
from trackbench.core.smoothing import Transition
from trackbench.core.unscented import PointRule, SigmaPoints, Unscented
from trackbench.models.base import (
    DifferentiableMotion,
    DifferentiableSensor,
    Model,
    NormalMotion,
    Scene,
    Sensor,
    angle_rows,
    jacobian_at,
)
from trackbench.models.sensors.base import SensorBase
from trackbench.models.sensors.position import LinearSensor


class AssumedNoise(NamedTuple):
    """Noise that a Gaussian filter assumes: variances Q and R of every component, None for the model's.

    ``noise_mean`` adds the mean of the process noise to the prediction. Without it the prediction of the
    gamma-driven model is 1.5 too low, an interpretation of a paper.
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
        return Gaussian(mean, _assumed_cov(self.Q, exact.cov))

    def measurement(self, model: Model, x: Array, k: int) -> Gaussian:
        """Return the mean and covariance of z_k given x_k = x."""
        exact = model.sensor.measurement(x, k)
        return exact if self.R is None else Gaussian(exact.mean, _assumed_cov(self.R, exact.cov))


def idle_noise_mean(scene: Scene) -> dict[str, str]:
    """Return a reason by key if ``noise_mean`` has no effect: the process noise has mean zero."""
    if isinstance(scene.model.motion, NormalMotion):
        return {"noise_mean": "as the process noise has mean zero"}
    return {}


_QUARTER_TURN = 0.5 * np.pi
_MOST_PARTS = 64  # of a line between two points: beyond, an angle is unknown anyway
_CANCELLED = 1e-10  # share of a variance that a difference leaves with fewer than six digits
_UNRESOLVED = 1e-12  # share of a variance that a pivot of a difference may owe to rounding
MODEL_NOISE = AssumedNoise()
"""The noise of the model."""


def _assumed_cov(variance: float | None, cov: Array) -> Array:
    return cov if variance is None else variance * np.eye(cov.shape[0])


def _with_curvature(
    linear: Gaussian, part: DifferentiableMotion | DifferentiableSensor, at: Gaussian, k: int
) -> Gaussian:
    """Add the second-order terms of a function of ``at`` to mean and noise covariance.

    They are ``tr(H_i P) / 2`` and ``tr(H_i P H_j P) / 2`` (Bar-Shalom, Li & Kirubarajan 2001, section
    10.3.2), with the Hessian H_i of component i.
    """
    hessians = jacobian_at(part, at, k, order=2)
    if not hessians.any():
        return linear
    HP = [linalg.matmul(H_i, at.cov) for H_i in hessians]
    bias = 0.5 * np.stack([linalg.trace(A) for A in HP])
    cov = 0.5 * linalg.traces_of_products(np.stack(HP))
    cov = linalg.symmetrize(cov)
    return Gaussian(
        linear.mean + with_axes_of(linear.mean, bias),
        with_axes_of(cov, linear.cov) + with_axes_of(linear.cov, cov),
    )


def extended_prediction(
    model: Model, state: Gaussian, k: int, assumed: AssumedNoise, order: int = 1
) -> Gaussian:
    """Predict x_k, with the motion expanded at the mean to first or second order."""
    # A cast, because isinstance of a Protocol at every step takes as long as the step.
    motion = cast(DifferentiableMotion, model.motion)
    transition = assumed.transition(model, state.mean, k)
    if order == 2:
        transition = _with_curvature(transition, motion, state, k)
    return kalman.predict(state, jacobian_at(motion, state, k), transition.cov, transition.mean)


def extended_transition(
    model: Model, state: Gaussian, k: int, assumed: AssumedNoise, order: int = 1
) -> Transition:
    """Predict x_k by derivatives at the mean, with its covariance with x_{k-1}, P F'."""
    F = jacobian_at(cast(DifferentiableMotion, model.motion), state, k)
    # cov(x_{k-1}, x_k) = P F'
    cross = linalg.matmul(state.cov, linalg.transpose(F))
    return Transition(extended_prediction(model, state, k, assumed, order), cross)


def extended_step(
    model: Model, state: Gaussian, z: Array, k: int, assumed: AssumedNoise, order: int = 1
) -> Updated:
    """Predict to k and update with z (n_z, M), expanded at the mean and at the prediction."""
    sensor = cast(DifferentiableSensor, model.sensor)
    predicted = extended_prediction(model, state, k, assumed, order)
    measurement = assumed.measurement(model, predicted.mean, k)
    if order == 2:
        measurement = _with_curvature(measurement, sensor, predicted, k)
    # nu = z - h(m^-)
    nu = sensor.innovation(with_trailing(z, measurement.mean.ndim - 1), measurement.mean)
    return kalman.update(predicted, nu, jacobian_at(sensor, predicted, k), measurement.cov)


def augmented_size(model: Model) -> int:
    """Count the components of the augmented state (x, v, n) of `augmented_step`."""
    return 2 * len(model.motion.components) + len(model.sensor.components)


def spread_conflicts(
    alpha: float, kappa: float, model: Model, augmented: bool = True
) -> dict[str, str]:
    """Reject sigma points that coincide, by key: alpha^2 (n + kappa) must be positive."""
    # n + lambda = alpha^2 (n + kappa) scales the points: it must be positive and finite.
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

    The points pass through the motion and then the sensor (van der Merwe et al. 2000, section 3.2).
    """
    if step := _scalar_step(model, state, z, k, assumed, rule):
        return step
    # Step 1: points of state, process noise and measurement noise.
    n_x = state.mean.shape[0]
    transition = assumed.transition(model, state.mean, k)
    R = assumed.measurement(model, transition.mean, k).cov
    points = rule.points(_augment(state, transition.cov, R))
    x, v, n = points.x[:n_x], points.x[n_x : 2 * n_x], points.x[2 * n_x :]
    # Step 2: predict each point, f(x) + v; condition on z = h(f(x) + v) + n.
    predicted = assumed.transition(model, x, k).mean + v
    moments = points.moments(predicted, roots=isinstance(state, Factored))
    measured = _measured(model, points, predicted, moments, z, k, n, None)
    return _condition(points, predicted, moments, measured, None)


def _scalar_step(
    model: Model, state: Gaussian, z: Array, k: int, assumed: AssumedNoise, rule: PointRule
) -> Updated | None:
    """Make the step of `augmented_step` by the points of three scalars; None if it must do it."""
    if not isinstance(rule, Unscented) or isinstance(state, Factored):
        return None
    if type(model.sensor).innovation is not SensorBase.innovation:  # such as one of angles
        return None
    points = rule.scalar_points(state)
    if points is None:
        return None
    # f(x) and f(mean) +- v, then their measurements; noises of the state have a variance per point.
    moved = assumed.transition(model, points.x, k)
    predicted = points.add_noise(moved.mean, moved.cov)
    if predicted is None:
        return None
    measured = assumed.measurement(model, predicted, k)
    step = points.condition(predicted, measured.mean, measured.cov, z)
    if step is None:
        return None
    mean, cov, nu, S = step
    if (cov[0] < _CANCELLED * np.square(np.ptp(predicted, axis=1))).any():
        return None
    note("covariances", S, components=2)
    return Gaussian(mean, cov), Innovation(nu, S)


def point_prediction(
    model: Model, state: Gaussian, k: int, assumed: AssumedNoise, rule: PointRule
) -> Gaussian:
    """Predict x_k by points of the state, plus the covariance Q of the noise."""
    points = rule.points(state)
    Q = assumed.transition(model, state.mean, k).cov
    moved = assumed.transition(model, points.x, k).mean
    return points.moments(moved, Q, isinstance(state, Factored))


def point_transition(
    model: Model, state: Gaussian, k: int, assumed: AssumedNoise, rule: PointRule, augmented: bool
) -> Transition:
    """Predict x_k by points, with its covariance with x_{k-1}.

    The points are those of `augmented_step`, or of the state alone as in `additive_step`.
    """
    n_x = state.mean.shape[0]
    Q = assumed.transition(model, state.mean, k).cov
    if augmented:
        R = assumed.measurement(model, state.mean, k).cov
        # Points of state and noises (x, v, n): the process noise moves the points.
        joint = _augment(state, Q, R)
        points = rule.points(joint)
        x = points.x[:n_x]
        moved = assumed.transition(model, x, k).mean + points.x[n_x : 2 * n_x]
        predicted = points.moments(moved)
    else:
        # Points of the state alone: Q is added to their covariance.
        points = rule.points(state)
        x = points.x
        moved = assumed.transition(model, x, k).mean
        predicted = points.moments(moved, Q)
    # C = sum w (x - m)(f(x) - m_pred)'
    cross = points.cross(x, state.mean, moved, predicted.mean)
    return Transition(predicted, cross)


def additive_step(
    model: Model, state: Gaussian, z: Array, k: int, assumed: AssumedNoise, rule: PointRule
) -> Updated:
    """Predict to k by points of the state, and update with z by new points of the prediction.

    The noise covariances are added to those of the points (Arasaratnam & Haykin 2009, section 5).
    """
    predicted = point_prediction(model, state, k, assumed, rule)
    points, R, measured = _measured_anew(model, predicted, z, k, assumed, rule)
    return _condition(points, points.x, predicted, measured, R)


def predicted_innovation(model: Model, predicted: Gaussian, z: Array, k: int) -> Innovation:
    """Compare z (n_z, M) with N(mean, cov) of x_k by cubature: the innovation and its covariance."""
    predicted, rule = per_run_moments(predicted), Unscented(1.0, 0.0, 0.0)
    _, _, measured = _measured_anew(model, predicted, z, k, MODEL_NOISE, rule)
    return Innovation(measured.nu, measured.S)


def _measured_anew(
    model: Model, predicted: Gaussian, z: Array, k: int, assumed: AssumedNoise, rule: PointRule
) -> tuple[SigmaPoints, Array, "_Measured"]:
    """Measure new points of the prediction: points, R, and the moments with R added."""
    points = rule.points(predicted)
    R = assumed.measurement(model, predicted.mean, k).cov
    R = with_trailing(R, predicted.mean.ndim - 1, leading=2)
    return points, R, _measured(model, points, points.x, predicted, z, k, None, R)


class SensorOfSteps:
    """Sensor of many steps at once: the batch (T M,) is the runs of each step in turn."""

    def __init__(self, sensor: Sensor, steps: Sequence[int]) -> None:
        self.components, self.innovation = sensor.components, sensor.innovation
        self._sensor, self._steps = sensor, steps

    def measurement(self, x: Array, k: int) -> Gaussian:
        """Return the distribution of the measurements of states x (n_x, *points, T M)."""
        if type(self._sensor).measurement is LinearSensor.measurement:
            return self._sensor.measurement(x, k)  # which is equal at every step
        means, covs = [], []
        for part, step in zip(np.split(x, len(self._steps), axis=-1), self._steps, strict=True):
            measured = self._sensor.measurement(np.ascontiguousarray(part), step)
            cov = with_trailing(measured.cov, 1, leading=2)
            means.append(measured.mean)
            covs.append(np.broadcast_to(cov, (*cov.shape[:-1], part.shape[-1])))
        return Gaussian(np.concatenate(means, axis=-1), np.concatenate(covs, axis=-1))


class _Measured(NamedTuple):
    """Measurements of points about the center's, their moments, and the innovation of z."""

    relative: Array
    """measurements of the points (n_z, points, M), relative to the center's"""
    mean: Array
    S: Array
    C: Array
    """covariance (n_x, n_z, M) of state and measurement"""
    nu: Array
    """innovation; NaN where a component is missing"""
    missing: Mask | None
    """missing components, if any is"""


def relative_measurements(model: Model, x: Array, z: Array, k: int) -> Array:
    """Subtract the first point's measurement from those of points x (n, P, M): z (n_z, P, M).

    Where an angle of the state reaches beyond a quarter of a turn, the differences are summed along the
    line from the first point, so that a measured angle grows with it beyond half a turn.
    """
    angles = list(angle_rows(model.motion))
    if not angles:
        return model.sensor.innovation(z, z[:, :1])
    reach = np.abs(x[angles] - x[angles, :1])
    farthest = float(np.max(reach, initial=0.0, where=np.isfinite(reach)))
    parts = min(int(np.ceil(farthest / _QUARTER_TURN)), _MOST_PARTS)
    if parts <= 1:
        return model.sensor.innovation(z, z[:, :1])
    before = np.broadcast_to(z[:, :1], z.shape)
    out = np.zeros_like(z)
    for part in range(1, parts + 1):
        between = x[:, :1] + (part / parts) * (x - x[:, :1])
        reached = z if part == parts else model.sensor.measurement(between, k).mean
        out += model.sensor.innovation(reached, before)
        before = reached
    return out


def _measured(
    model: Model,
    points: SigmaPoints,
    x: Array,
    predicted: Gaussian,
    z: Array,
    k: int,
    noise: Array | None,
    R: Array | None,
) -> _Measured:
    """Compute the moments of the points' measurements; the noise is in the points, or added as R."""
    # Step 1: measurements of the points, relative to that of the mean, so that angles do not wrap.
    z_pred = model.sensor.measurement(x, k).mean
    center = z_pred[:, :1]
    relative = relative_measurements(model, x, z_pred, k)
    relative = relative if noise is None else relative + noise
    # Step 2: their mean, covariance S and covariance C with the state.
    z_mean = points.mean(relative)
    S = points.cross(relative, z_mean, relative, z_mean)
    C = points.cross(x, predicted.mean, relative, z_mean)
    S = S if R is None else S + R
    # Step 3: the innovation; a missing component (NaN) loses its row and column of S and C.
    batch, missing = predicted.mean.shape[1:], None
    if z.shape[1:] != batch:
        z = np.broadcast_to(with_trailing(z, len(batch)), (len(z), *batch))
    nu = model.sensor.innovation(z, center[:, 0] + z_mean)
    if any_nan(nu) and (lacks := np.isnan(nu) & np.isfinite(predicted.mean).all(axis=0)).any():
        missing = lacks
        rows, S = kalman.drop_missing(linalg.transpose(C), S, missing)
        C = linalg.transpose(rows)
    return _Measured(relative, z_mean, S, C, nu, missing)


def _condition(
    points: SigmaPoints, x: Array, predicted: Gaussian, measured: _Measured, R: Array | None
) -> Updated:
    """Condition the prediction on the measurements of its points x (steps 1 to 3: `_measured`)."""
    relative, z_mean, S, C, nu, missing = measured
    known = nu if missing is None else np.where(missing, 0.0, nu)
    if isinstance(predicted, Factored):
        added = np.zeros(S.shape[:2]) if R is None else R
        missing = np.zeros(nu.shape, dtype=np.bool_) if missing is None else missing
        added, dx = kalman.drop_missing_cov(added, missing), x - predicted.mean[:, None]
        dz = np.where(missing[:, None], 0.0, relative - z_mean[:, None])
        D = points.columns(dx), points.columns(dz)
        factored, root = kalman.update_roots(predicted.mean, known, *D, added)
        return factored, Innovation(nu, S, root=root)
    # Step 4: K = C S^-1, m + K nu, P - K S K'.
    note("covariances", S, components=2)
    posterior = kalman.condition(predicted, known, C, S)
    cancelled = is_cancelled(posterior.cov, predicted.cov)
    # A direction without spread, such as of an exact measurement of a sum, is left with rounding.
    pivots = np.square(linalg.diagonal(linalg.root(posterior.cov)))
    cancelled |= ~(pivots >= _UNRESOLVED * linalg.diagonal(predicted.cov)).all(axis=0)
    if cancelled.any():
        # The difference has lost its digits: sum the squares of x - K z over the points, plus K R K'.
        K = linalg.matmul(C, linalg.inverse(S))
        moved = linalg.matvec(K[:, :, None], relative - z_mean[:, None])
        rest, zero = x - predicted.mean[:, None] - moved, np.zeros_like(predicted.mean)
        cov = points.cross(rest, zero, rest, zero)
        cov = cov if R is None else cov + linalg.sandwich(K, R)
        posterior = Gaussian(posterior.mean, np.where(cancelled, cov, posterior.cov))
    return posterior, Innovation(nu, S, predicted=predicted)


def is_cancelled(difference: Array, of: Array) -> Mask:
    """Return where (*batch) a difference of covariances ``of - ...`` has lost its digits."""
    left = difference.diagonal() < _CANCELLED * of.diagonal()
    return np.asarray(left.any(axis=-1))


def _augment(state: Gaussian, Q: Array, R: Array) -> Gaussian:
    roots = isinstance(state, Factored)
    blocks = (root_of(state), linalg.root(Q), linalg.root(R)) if roots else (state.cov, Q, R)
    n, batch = sum(map(len, blocks)), state.mean.shape[1:]
    mean = np.zeros((n, *batch))
    cov = np.zeros((n, n, *batch))
    mean[: len(state.mean)] = state.mean
    # P = [P 0 0; 0 Q 0; 0 0 R], or its root
    end = 0
    for block in blocks:
        part = slice(end, end := end + len(block))
        cov[part, part] = with_trailing(block, len(batch), leading=2)
    return from_root(mean, cov) if roots else Gaussian(mean, cov)
