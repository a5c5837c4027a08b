"""Step of a filter by sigma points: prediction, moments of the measurement, and the update.

`augmented_step` has sigma points of state and noise together, `additive_step` those of the state, with
the noise added. Both serve a filter of M runs (mean (n, M)) and a proposal per particle (mean
(n, M, N)). Points and weights are in `core/sigma_points.py`.
"""

from typing import NamedTuple

import numpy as np

from trackbench.core import kalman, linalg, missing_components
from trackbench.core.arrays import Array, Mask, any_nan, with_trailing
from trackbench.core.compiled_scalar_ukf import scalar_points
from trackbench.core.counted_operations import count_operations
from trackbench.core.distributions import Factored, Gaussian, per_run_moments
from trackbench.core.kalman import Innovation, Updated
from trackbench.core.rts_smoother import Transition
from trackbench.core.sigma_points import PointRule, SigmaPoints, Unscented, augmented_state
from trackbench.filters.assumed_noise import MODEL_NOISE, AssumedNoise
from trackbench.models.base import Model, angle_rows
from trackbench.models.sensors.base import SensorBase

_QUARTER_TURN = 0.5 * np.pi  # rad


_MOST_PARTS = 64  # of a line between two points: beyond, an angle is unknown anyway


_CANCELLED = 1e-10  # share of a variance that a difference leaves with fewer than six digits


_UNRESOLVED = 1e-12  # share of a variance that a pivot of a difference may owe to rounding


def augmented_step(
    model: Model, state: Gaussian, z: Array, k: int, assumed: AssumedNoise, rule: PointRule
) -> Updated:
    """Predict to k and update with z by one set of points of the augmented state (x, v, n).

    The points of state, process noise and measurement noise pass through the motion f and then the
    sensor h (van der Merwe et al. 2000, section 3.2).

    Parameters
    ----------
    model : Model
        Motion and sensor.
    state : Gaussian
        Posterior of step k - 1: m (n_x, *batch), P (n_x, n_x, *batch). The batch is the runs (M,), or
        runs and particles (M, N).
    z : array (n_z, M)
        Measurements of step k; NaN where one is missing.
    k : int
        Number of the step.
    assumed : AssumedNoise
        Noise that the filter assumes.
    rule : PointRule
        Points and weights.

    Returns
    -------
    Updated
        Posterior, and the innovation with S.
    """
    # A scalar state has a faster way to the same result, if it applies.
    scalar_result = _scalar_step(model, state, z, k, assumed, rule)
    if scalar_result is not None:
        return scalar_result
    # Step 1: points of (x, v, n), of mean (m, 0, 0) and covariance diag(P, Q, R).
    n_x = len(state.mean)
    transition = assumed.transition(model, state.mean, k)
    R = assumed.measurement(model, transition.mean, k).cov
    points = rule.points(augmented_state(state, transition.cov, R))
    x = points.x[:n_x]
    v = points.x[n_x : 2 * n_x]
    n = points.x[2 * n_x :]
    # Step 2: predict each point, f(x) + v; m^- and P^- are their weighted moments.
    moved = assumed.transition(model, x, k).mean + v
    predicted = points.moments(moved, roots=isinstance(state, Factored))
    # Step 3: measure each point, h(f(x) + v) + n; z^-, S and C = cov(x, z) are weighted moments.
    measured = _measure_points(model, points, moved, predicted, z, k, noise=n)
    # Step 4: K = C S^-1, m = m^- + K nu, P = P^- - K S K'.
    # The points carry the measurement noise, so that no R is added.
    return _condition(points, moved, predicted, measured, R=None)


def additive_step(
    model: Model, state: Gaussian, z: Array, k: int, assumed: AssumedNoise, rule: PointRule
) -> Updated:
    """Predict to k by points of the state, and update with z by new points of the prediction.

    The noise covariances are added to those of the points (Arasaratnam & Haykin 2009, section 5).

    Parameters
    ----------
    model : Model
        Motion and sensor.
    state : Gaussian
        Posterior of step k - 1: m (n_x, *batch), P (n_x, n_x, *batch). The batch is the runs (M,), or
        runs and particles (M, N).
    z : array (n_z, M)
        Measurements of step k; NaN where one is missing.
    k : int
        Number of the step.
    assumed : AssumedNoise
        Noise that the filter assumes.
    rule : PointRule
        Points and weights.

    Returns
    -------
    Updated
        Posterior, and the innovation with S.
    """
    # Step 1: points of N(m, P), predicted by f(x); m^- and P^- are their moments, Q added.
    predicted = point_prediction(model, state, k, assumed, rule)
    # Step 2: points of N(m^-, P^-), measured by h(x); z^-, S and C are their moments, R added to S.
    points, R, measured = _measure_new_points(model, predicted, z, k, assumed, rule)
    # Step 3: K = C S^-1, m = m^- + K nu, P = P^- - K S K'. The points have no rows but those of the
    # state.
    return _condition(points, points.x, predicted, measured, R)


def point_prediction(
    model: Model, state: Gaussian, k: int, assumed: AssumedNoise, rule: PointRule
) -> Gaussian:
    """Predict x_k by points of the state, plus the covariance Q of the noise.

    Parameters
    ----------
    model : Model
        Motion and sensor.
    state : Gaussian
        Posterior of step k - 1: m (n_x, *batch), P (n_x, n_x, *batch).
    k : int
        Number of the step.
    assumed : AssumedNoise
        Noise that the filter assumes.
    rule : PointRule
        Points and weights.

    Returns
    -------
    Gaussian
        Prediction. It is a `Factored`, with a triangular factor of its covariance, if the state is one.
    """
    points = rule.points(state)
    Q = assumed.transition(model, state.mean, k).cov
    moved = assumed.transition(model, points.x, k).mean
    return points.moments(moved, Q, roots=isinstance(state, Factored))


class _Measured(NamedTuple):
    """Measurements of points, their moments, and the innovation of z."""

    relative: Array
    """measurements of the points (n_z, points, *batch), relative to that of the first, the center"""
    mean: Array
    """their weighted mean (n_z, *batch), relative to the center's, too"""
    S: Array
    """covariance (n_z, n_z, *batch) of the measurement"""
    C: Array
    """covariance (n_x, n_z, *batch) of state and measurement"""
    nu: Array
    """innovation (n_z, *batch); NaN where a component is missing"""
    missing: Mask | None
    """missing components (n_z, *batch), if any is"""


def _measure_points(
    model: Model,
    points: SigmaPoints,
    x: Array,
    predicted: Gaussian,
    z: Array,
    k: int,
    noise: Array | None = None,
    R: Array | None = None,
) -> _Measured:
    """Compute the moments of the measurements of states x (n_x, points, *batch), and the innovation.

    The measurement noise is in the points (``noise``), or its covariance R is added. ``points`` has the
    weights, and ``predicted`` the moments of x.
    """
    # Step 1: measurements of the points, relative to that of the mean, so that angles do not wrap.
    z_of_points = model.sensor.measurement(x, k).mean
    z_of_center = z_of_points[:, 0]
    relative = relative_measurements(model, x, z_of_points, k)
    if noise is not None:
        relative = relative + noise
    # Step 2: their mean, covariance S, and covariance C with the state.
    relative_mean = points.mean(relative)
    S = points.cross(relative, relative_mean, relative, relative_mean)
    C = points.cross(x, predicted.mean, relative, relative_mean)
    if R is not None:
        S = S + R
    # Step 3: the innovation; a missing component (NaN) loses its row and column of S and C.
    batch = predicted.mean.shape[1:]
    if z.shape[1:] != batch:  # the particles of a run share its measurement
        z = np.broadcast_to(with_trailing(z, len(batch)), (len(z), *batch))
    nu = model.sensor.innovation(z, z_of_center + relative_mean)
    missing = None
    if any_nan(nu):
        # NaN of a run that has diverged is no missing component.
        is_missing = np.isnan(nu) & np.isfinite(predicted.mean).all(axis=0)
        if is_missing.any():
            missing = is_missing
            rows, S = missing_components.drop_missing(linalg.transpose(C), S, missing)
            C = linalg.transpose(rows)
    return _Measured(relative=relative, mean=relative_mean, S=S, C=C, nu=nu, missing=missing)


def _measure_new_points(
    model: Model, predicted: Gaussian, z: Array, k: int, assumed: AssumedNoise, rule: PointRule
) -> tuple[SigmaPoints, Array, _Measured]:
    """Return the measurements of new points of the prediction: points, R, and moments with R added."""
    points = rule.points(predicted)
    R = assumed.measurement(model, predicted.mean, k).cov
    R = with_trailing(R, predicted.mean.ndim - 1, leading=2)
    return points, R, _measure_points(model, points, points.x, predicted, z, k, R=R)


def _condition(
    points: SigmaPoints, x: Array, predicted: Gaussian, measured: _Measured, R: Array | None
) -> Updated:
    """Condition the prediction, moments of points x (n_x, points, *batch), on their measurements.

    ``points`` has the weights. R is the covariance that was added to S; None if the measurement noise is
    in the points. Rows and columns of a missing component are zero in C, and those of a unit matrix in
    S.
    """
    if isinstance(predicted, Factored):
        return _condition_roots(points, x, predicted, measured, R)
    nu = measured.nu
    known = nu if measured.missing is None else np.where(measured.missing, 0.0, nu)
    # For the number of operations in the tables: an update of a covariance for each batch element.
    count_operations("covariances", measured.S, component_axes=2)
    posterior = kalman.condition(predicted, known, measured.C, measured.S)
    cancelled = is_cancelled(posterior.cov, predicted.cov)
    # A direction that an exact measurement, such as of a sum, leaves without spread has a pivot that is
    # only rounding.
    pivots = np.square(linalg.diagonal(linalg.root(posterior.cov)))
    cancelled |= ~(pivots >= _UNRESOLVED * linalg.diagonal(predicted.cov)).all(axis=0)
    if cancelled.any():
        cov = _cov_by_points(points, x, predicted, measured, R)
        posterior = Gaussian(posterior.mean, np.where(cancelled, cov, posterior.cov))
    return posterior, Innovation(nu, measured.S, predicted=predicted)


def is_cancelled(difference: Array, minuend: Array) -> Mask:
    """Return where (*batch) a difference of covariances, ``minuend - ...``, has lost its digits."""
    left = difference.diagonal() < _CANCELLED * minuend.diagonal()
    return np.asarray(left.any(axis=-1))


def _cov_by_points(
    points: SigmaPoints, x: Array, predicted: Gaussian, measured: _Measured, R: Array | None
) -> Array:
    """Compute P as the sum of the squares of ``x - K z`` over the points, plus ``K R K'``.

    ``x`` are the points (n_x, points, *batch), and z the measurements of these, less that of the center
    so that angles do not wrap (``measured.relative``). R is None if the points carry the measurement
    noise. The difference P^- - K S K' has lost its digits where the measurement is exact.
    """
    K = linalg.matmul(measured.C, linalg.inverse(measured.S))
    explained = linalg.matvec(K[:, :, None], measured.relative - measured.mean[:, None])
    rest = x - predicted.mean[:, None] - explained
    zero = np.zeros_like(predicted.mean)
    cov = points.cross(rest, zero, rest, zero)
    return cov if R is None else cov + linalg.sandwich(K, R)


def _condition_roots(
    points: SigmaPoints, x: Array, predicted: Factored, measured: _Measured, R: Array | None
) -> Updated:
    """Return what `_condition` does, by triangular factors (Arasaratnam & Haykin 2009, appendix).

    ``x`` (n_x, points, *batch) are the points, whose measurements ``measured.relative`` are less that of
    the center, so that angles do not wrap. R is the covariance of the measurement noise; None if the
    points carry the noise.
    """
    nu = measured.nu
    missing = np.zeros(nu.shape, dtype=np.bool_) if measured.missing is None else measured.missing
    added = np.zeros(measured.S.shape[:2]) if R is None else R
    added = missing_components.drop_missing_cov(added, missing)
    x_deviations = x - predicted.mean[:, None]
    z_deviations = measured.relative - measured.mean[:, None]
    posterior, root = kalman.update_roots(
        predicted.mean,
        nu if measured.missing is None else np.where(missing, 0.0, nu),
        points.columns(x_deviations),
        points.columns(np.where(missing[:, None], 0.0, z_deviations)),
        added,
    )
    return posterior, Innovation(nu, measured.S, root=root)


def _scalar_step(
    model: Model, state: Gaussian, z: Array, k: int, assumed: AssumedNoise, rule: PointRule
) -> Updated | None:
    """Return what `augmented_step` does, by points of the three scalars x, v and n.

    None if state or measurement has several components, an angle is measured, the noise depends on the
    state, a measurement is missing, the variance would lose its digits, or there are no C kernels. Rules
    other than `Unscented` and square roots of the covariance are left to `augmented_step`, too.
    """
    if not isinstance(rule, Unscented) or isinstance(state, Factored):
        return None
    if type(model.sensor).innovation is not SensorBase.innovation:  # such as one of angles
        return None
    points = scalar_points(rule, state)
    if points is None:
        return None
    # Predict: f(x) and f(mean) +- v. None if Q depends on the state, and so has a value per point.
    moved = assumed.transition(model, points.x, k)
    predicted = points.add_noise(moved.mean, moved.cov)
    if predicted is None:
        return None
    # Measure the predicted points, and condition on z; None if a component is missing.
    measured = assumed.measurement(model, predicted, k)
    conditioned = points.condition(predicted, measured.mean, measured.cov, z)
    if conditioned is None:
        return None
    mean, cov, nu, S = conditioned
    # A variance that is only rounding beside the spread of the points is left to `augmented_step`.
    spread = np.ptp(predicted, axis=1)
    if (cov[0] < _CANCELLED * np.square(spread)).any():
        return None
    # For the number of operations in the tables, as the other ways count them.
    count_operations("covariances", S, component_axes=2)
    return Gaussian(mean, cov), Innovation(nu, S)


def relative_measurements(model: Model, x: Array, z: Array, k: int) -> Array:
    """Subtract the first point's measurement from the measurements of all points.

    Where an angle of the state reaches beyond a quarter of a turn, the differences are summed along the
    line from the first point, so that a measured angle grows with it beyond half a turn.

    Parameters
    ----------
    model : Model
        Motion and sensor.
    x : array (n_x, P, *batch)
        P points of each run, or of each particle of a run.
    z : array (n_z, P, *batch)
        Measurements h(x) of the points.
    k : int
        Number of the step.

    Returns
    -------
    array (n_z, P, *batch)
        Differences, zero for the first point.
    """
    first_x = x[:, :1]
    first_z = z[:, :1]
    angles = list(angle_rows(model.motion))
    if not angles:
        return model.sensor.innovation(z, first_z)
    reach = np.abs(x[angles] - x[angles, :1])
    farthest = float(np.max(reach, initial=0.0, where=np.isfinite(reach)))
    parts = min(int(np.ceil(farthest / _QUARTER_TURN)), _MOST_PARTS)
    if parts <= 1:
        return model.sensor.innovation(z, first_z)
    relative = np.zeros_like(z)
    z_before = np.broadcast_to(first_z, z.shape)
    for part in range(1, parts + 1):
        x_between = first_x + (part / parts) * (x - first_x)
        z_between = z if part == parts else model.sensor.measurement(x_between, k).mean
        relative += model.sensor.innovation(z_between, z_before)
        z_before = z_between
    return relative


def point_transition(
    model: Model, state: Gaussian, k: int, assumed: AssumedNoise, rule: PointRule, augmented: bool
) -> Transition:
    """Predict x_k by points, with its covariance with x_{k-1}.

    Parameters
    ----------
    model : Model
        Motion and sensor.
    state : Gaussian
        Posterior of step k - 1: m (n_x, M), P (n_x, n_x, M).
    k : int
        Number of the step.
    assumed : AssumedNoise
        Noise that the filter assumes.
    rule : PointRule
        Points and weights.
    augmented : bool
        Take the points of `augmented_step`; otherwise those of the state alone, as in `additive_step`.

    Returns
    -------
    Transition
        Prediction of x_k, and cov(x_{k-1}, x_k) (n_x, n_x, M).
    """
    n_x = state.mean.shape[0]
    Q = assumed.transition(model, state.mean, k).cov
    if augmented:
        R = assumed.measurement(model, state.mean, k).cov
        # Points of state and noises (x, v, n): the process noise moves the points.
        points = rule.points(augmented_state(state, Q, R))
        x = points.x[:n_x]
        v = points.x[n_x : 2 * n_x]
        moved = assumed.transition(model, x, k).mean + v
        predicted = points.moments(moved)
    else:
        # Points of the state alone: Q is added to their covariance.
        points = rule.points(state)
        x = points.x
        moved = assumed.transition(model, x, k).mean
        predicted = points.moments(moved, Q)
    # C = sum w (x - m)(f(x) - m^-)'
    cross = points.cross(x, state.mean, moved, predicted.mean)
    return Transition(predicted, cross)


def predicted_innovation(model: Model, predicted: Gaussian, z: Array, k: int) -> Innovation:
    """Compare measurements with predicted states, whose measurement is computed by cubature.

    Parameters
    ----------
    model : Model
        Motion and sensor.
    predicted : Gaussian
        Prediction of x_k: mean (n_x, M), covariance (n_x, n_x[, M]).
    z : array (n_z, M)
        Measurements of step k; NaN where one is missing.
    k : int
        Number of the step.

    Returns
    -------
    Innovation
        Innovation ``nu`` (n_z, M), NaN where a component is missing, and its covariance S (n_z, n_z, M).
        S has the row and column of a unit matrix for a missing component.
    """
    predicted = per_run_moments(predicted)
    rule = Unscented(1.0, 0.0, 0.0)  # alpha = 1, beta = kappa = 0: cubature points
    _, _, measured = _measure_new_points(model, predicted, z, k, MODEL_NOISE, rule)
    return Innovation(measured.nu, measured.S)
