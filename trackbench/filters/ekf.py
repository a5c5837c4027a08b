"""Kalman filters that linearize the model: EKF, IEKF, MCAEKF by Jacobians, IPLF by regression.

The EKF's step reads on from `GaussianFilter.step` to `extended_step` to `core/kalman.py`.
"""

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal, NamedTuple, cast

import numpy as np
from annotated_types import Interval

from trackbench.core import kalman, linalg
from trackbench.core.arrays import Array, with_trailing
from trackbench.core.distributions import Gaussian
from trackbench.core.elementary import cos_sin
from trackbench.core.gauss_hermite import gauss_hermite
from trackbench.core.kalman import Innovation, Updated
from trackbench.core.polar_conversions import Polar
from trackbench.core.sigma_points import PointRule, Unscented
from trackbench.core.smoothing import Transition
from trackbench.field_types import Count, NonNegative, Positive
from trackbench.filters.base import Steps
from trackbench.filters.cmkf import polar_moments
from trackbench.filters.gaussian_base import (
    MERWE_DEMO,
    AssumedNoise,
    NonlinearFilter,
    Tracked,
    extended_prediction,
    extended_transition,
    nonlinear_steps,
    with_curvature,
)
from trackbench.filters.kf import linear_steps
from trackbench.filters.ukf import (
    MAX_ORDER,
    is_cancelled,
    point_prediction,
    point_transition,
    relative_measurements,
)
from trackbench.models.base import Differentiable, DifferentiableSensor, Model, Scene
from trackbench.models.derivatives import jacobian_at
from trackbench.models.sensors.position import LinearSensor
from trackbench.models.sensors.range_azimuth import RangeAzimuth
from trackbench.registry import register

_CUBATURE = Unscented(1.0, 0.0, 0.0)
_LEAST_SPREAD = 1e-10  # standard deviation, as a share of the state, that a regression resolves
_WIDENING = 1e-8  # share of the predicted covariance


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
        # A plain EKF has all other keys at their defaults.
        plain = EKF(smooth=self.smooth, start=self.start, P0=self.P0)
        if type(self) is not EKF or self != plain:
            return None
        if not isinstance(model.sensor, LinearSensor):
            return nonlinear_steps(model, state, z, k, keeps_predictions=not self.smooths)
        cov = with_trailing(state.posterior.cov, 1, leading=2)
        if (cov != cov[..., :1]).any():  # the runs have different covariances
            return None
        with_one_covariance = Gaussian(state.posterior.mean, cov[..., 0])
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


@register("filters", "mcaekf")
@dataclass(frozen=True, kw_only=True)
class MCAEKF(NonlinearFilter):
    """Measurement covariance adaptive EKF: inflates the range variance for a curved measurement.

    The added variance is the square of the sagitta within the azimuth's uncertainty (banana paper,
    section IV, eq. 11; Tian & Bar-Shalom 2009).
    """

    n_sigma: NonNegative = 2.0
    """standard deviations of the updated azimuth at which the sagitta is taken"""
    kappa: Positive = 1.0
    """the sagitta divided by the standard deviation of the added range noise"""
    requires: ClassVar[tuple[str, ...]] = ("motion.jacobian", "sensor.jacobian", "sensor.reading")

    def update(self, model: Model, state: Gaussian, z: Array, k: int) -> Updated:
        """Predict, inflate the range's variance, update."""
        predicted = extended_prediction(model, state, k, self.assumed)
        sensor = cast(RangeAzimuth, model.sensor)
        expected = self.assumed.measurement(model, predicted.mean, k)
        nu = sensor.innovation(z, expected.mean)
        # R11 <- R11 + (D / kappa)^2 with the sagitta D, which is NaN where the azimuth is missing
        D = self._sagitta(polar_moments(sensor, predicted, k), nu[1], expected.cov[1, 1])
        R = np.broadcast_to(with_trailing(expected.cov, 1, leading=2), (2, 2, len(D))).copy()
        R[0, 0] += np.where(np.isnan(D), 0.0, np.square(D / self.kappa))
        H = jacobian_at(sensor, predicted, k)
        return kalman.update(predicted, nu, H, R)

    def _sagitta(self, predicted: Polar, nu: Array, variance: float) -> Array:
        """Return the sagitta D = r (1 / cos d - 1) for the largest likely change d of azimuth, m.

        Banana paper, eq. 11; Tian & Bar-Shalom 2009.
        ``predicted`` are range and azimuth of the prediction, ``nu`` (M,) is the innovation of the
        azimuth, and ``variance`` that of the azimuth's noise.
        """
        gain = predicted.azimuth_variance / (predicted.azimuth_variance + variance)
        spread = np.sqrt(predicted.azimuth_variance * (1.0 - gain))
        turn = np.abs(gain * nu) + self.n_sigma * spread
        less_than_right_angle = np.minimum(turn, 1.5)
        return predicted.r * (1.0 / cos_sin(less_than_right_angle)[0] - 1.0)


@register("filters", "iplf")
@dataclass(frozen=True, kw_only=True)
class IPLF(NonlinearFilter):
    """Iterated posterior linearization filter: statistical linear regression over the posterior.

    Garcia-Fernandez, Svensson, Morelande & Sarkka 2015. The first regression is the cubature
    filter's, over the prediction. Each further one is over the last posterior: an accurate
    measurement is linearized where the state can still be.
    """

    iterations: Count = 5
    """regressions per update; 1 is the cubature Kalman filter"""
    order: Annotated[int, Interval(ge=2, le=MAX_ORDER)] | None = None
    """points along each axis of a Gauss-Hermite rule; default: cubature points"""

    @property
    def rule(self) -> PointRule:
        """Points and weights of the regressions."""
        return _CUBATURE if self.order is None else gauss_hermite(self.order)

    def transition(self, model: Model, state: Gaussian, k: int) -> Transition:
        """Predict to step k by the rule's points, with the covariance with x_{k-1}."""
        return point_transition(model, state, k, self.assumed, self.rule, augmented=False)

    def update(self, model: Model, state: Gaussian, z: Array, k: int) -> Updated:
        """Predict by the rule's points; regress the measurement again over each posterior."""
        predicted = point_prediction(model, state, k, self.assumed, self.rule)
        linearized_at = predicted
        innovations: list[Innovation] = []
        for _ in range(self.iterations):
            # nu = z - E h(x) - A (m - m_i): A is the slope of the regression about estimate m_i.
            line = _regress_measurement(model, linearized_at, k, self.assumed, self.rule)
            residual = model.sensor.innovation(z, line.mean)
            nu = residual - linalg.matvec(line.slope, predicted.mean - linearized_at.mean)
            posterior, innovation = kalman.update(predicted, nu, line.slope, line.cov)
            # A posterior without spread has no regression.
            linearized_at = _widen_exact_posterior(posterior, predicted)
            innovations.append(innovation)
        # The first regression is over the prediction: its innovation is that of the prediction.
        return posterior, innovations[0]


def _widen_exact_posterior(posterior: Gaussian, predicted: Gaussian) -> Gaussian:
    """Widen the posteriors of runs that an exact measurement leaves without spread.

    A regression over points that are all equal has no slope. A small share of the ``predicted``
    covariance is added. The covariances are (n, n, M), one for each run.
    """
    # Below this standard deviation the regression's points agree with the mean in some ten digits.
    least = _LEAST_SPREAD * np.abs(posterior.mean)
    is_exact = ~(linalg.diagonal(linalg.root(posterior.cov)) > least).all(axis=0)
    if not is_exact.any():
        return posterior
    wide = posterior.cov + _WIDENING * predicted.cov
    return Gaussian(posterior.mean, np.where(is_exact, wide, posterior.cov))


class _Line(NamedTuple):
    """Regression ``z = mean + slope (x - m) + N(0, cov)`` of a measurement on the state."""

    mean: Array
    """mean measurement (n_z, M)"""
    slope: Array
    """slope (n_z, n_x, M)"""
    cov: Array
    """covariance (n_z, n_z, M) of the noise and of the deviations from the line"""


def _regress_measurement(
    model: Model, state: Gaussian, k: int, assumed: AssumedNoise, rule: PointRule
) -> _Line:
    """Return the linear regression of the measurement on the state over the Gaussian ``state``, N(m, P).

    ``rule`` has the points over which it is computed (Garcia-Fernandez et al. 2015, eqs. 5-9).
    """
    # Step 1: measurements of the points relative to that of the mean, which is the first point, so that
    # angles are averaged away from their jump by 2 pi.
    points = rule.points(state)
    z = model.sensor.measurement(points.x, k).mean
    z_of_mean = z[:, 0]
    offsets = relative_measurements(model, points.x, z, k)
    offset_mean = points.mean(offsets)
    # Step 2: slope = C' P^-1 with C = cov(x, z).
    C = points.cross(points.x, state.mean, offsets, offset_mean)
    slope = linalg.transpose(linalg.solve_singular(state.cov, C))
    # Step 3: cov = R + cov(z, z) - slope P slope'.
    R = with_trailing(assumed.measurement(model, state.mean, k).cov, 1, leading=2)
    z_cov = points.cross(offsets, offset_mean, offsets, offset_mean)
    unexplained = z_cov - linalg.sandwich(slope, state.cov)
    cancelled = is_cancelled(unexplained, z_cov)
    if cancelled.any():
        # The difference is only rounding, as for a linear sensor: sum the squares of the deviations
        # z - slope x over the points instead.
        explained = linalg.matvec(slope[:, :, None], points.x - state.mean[:, None])
        rest = offsets - offset_mean[:, None] - explained
        zero = np.zeros_like(offset_mean)
        unexplained = np.where(cancelled, points.cross(rest, zero, rest, zero), unexplained)
    return _Line(mean=z_of_mean + offset_mean, slope=slope, cov=R + linalg.symmetrize(unexplained))
