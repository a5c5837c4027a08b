"""Kalman filters that linearize the model: EKF, IEKF, MCAEKF by Jacobians, IPLF by regression."""

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal, cast

import numpy as np
from annotated_types import Interval

from trackbench.core import kalman, linalg
from trackbench.core.arrays import Array, with_trailing
from trackbench.core.conversions import Polar
from trackbench.core.distributions import Gaussian
from trackbench.core.elementary import cos_sin
from trackbench.core.kalman import Updated
from trackbench.core.smoothing import Transition
from trackbench.core.unscented import PointRule, Unscented, gauss_hermite
from trackbench.field_types import Count, NonNegative, Positive
from trackbench.filters.base import Steps
from trackbench.filters.cmkf import polar_moments
from trackbench.filters.kf import MAX_ORDER, MERWE_DEMO, NonlinearFilter, Tracked, constant_steps
from trackbench.models.base import Differentiable, DifferentiableSensor, Model, Scene, jacobian_at
from trackbench.models.gaussian_steps import (
    AssumedNoise,
    extended_prediction,
    extended_step,
    extended_transition,
    is_cancelled,
    point_prediction,
    point_transition,
    relative_measurements,
)
from trackbench.models.sensors.range_azimuth import RangeAzimuth
from trackbench.registry import register

_CUBATURE = Unscented(1.0, 0.0, 0.0)
_LEAST_SPREAD = 1e-10  # standard deviation, as a share of the state, that a regression resolves
_WIDENING = 1e-8  # share of the predicted covariance


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
        motion, sensor = cast(Differentiable, scenario.model)
        x, k = np.ones((len(motion.components), 1)), int(scenario.steps[-1])
        linear = all(part.jacobian(x, k).ndim == 2 for part in (motion, sensor))
        why = "as motion and sensor are linear"
        return super().idle_keys(scenario) | ({"order": why} if linear else {})

    def all_steps(self, model: Model, state: Tracked, z: Array, k: int) -> Steps | None:
        """Return the Kalman filter's steps, bit for bit, where it is that with one covariance."""
        mean, cov = state.posterior.mean, with_trailing(state.posterior.cov, 1, leading=2)
        if type(self) is not EKF or self != EKF(smooth=self.smooth) or (cov != cov[..., :1]).any():
            return None
        return constant_steps(model, state._replace(posterior=Gaussian(mean, cov[..., 0])), z)

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
        predicted = extended_prediction(model, state, k, self.assumed)
        posterior, first = predicted, None
        sensor = cast(DifferentiableSensor, model.sensor)
        for _ in range(self.iterations):
            # nu = z - h(x_i) - H_i (m - x_i), about the estimate x_i of the iteration before
            H = jacobian_at(sensor, posterior, k)
            expected = self.assumed.measurement(model, posterior.mean, k)
            nu = sensor.innovation(z, expected.mean)
            nu = nu - linalg.matvec(H, predicted.mean - posterior.mean)
            posterior, innovation = kalman.update(predicted, nu, H, expected.cov)
            # The NIS is that of the first iteration, about the prediction.
            first = first or innovation
        assert first is not None
        return posterior, first


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
        # R11 <- R11 + (D / kappa)^2 with the sagitta D (eq. 11)
        D = self._sagitta(polar_moments(sensor, predicted, k), nu[1], expected.cov[1, 1])
        R = np.broadcast_to(with_trailing(expected.cov, 1, leading=2), (2, 2, len(D))).copy()
        R[0, 0] += np.where(np.isnan(D), 0.0, np.square(D / self.kappa))
        H = jacobian_at(sensor, predicted, k)
        return kalman.update(predicted, nu, H, R)

    def _sagitta(self, predicted: Polar, nu: Array, variance: float) -> Array:
        """Return D = r (1 / cos d - 1), d the largest likely change of azimuth (eq. 11)."""
        gain = predicted.azimuth_variance / (predicted.azimuth_variance + variance)
        spread = np.sqrt(predicted.azimuth_variance * (1.0 - gain))
        turn = np.abs(gain * nu) + self.n_sigma * spread
        return predicted.r * (1.0 / cos_sin(np.minimum(turn, 1.5))[0] - 1.0)


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
        over, first = predicted, None
        for _ in range(self.iterations):
            # nu = z - E h(x) - A (m - m_i): A is the slope of the regression about estimate m_i.
            at, slope, cov = _regression(model, over, k, self.assumed, self.rule)
            nu = model.sensor.innovation(z, at)
            nu = nu - linalg.matvec(slope, predicted.mean - over.mean)
            posterior, innovation = kalman.update(predicted, nu, slope, cov)
            over = _spread(posterior, predicted)
            first = first or innovation
        assert first is not None
        return posterior, first


def _spread(posterior: Gaussian, predicted: Gaussian) -> Gaussian:
    """Widen a posterior that an exact measurement leaves without spread, so that it has a slope."""
    least = _LEAST_SPREAD * np.abs(posterior.mean)
    known = ~(linalg.diagonal(linalg.root(posterior.cov)) > least).all(axis=0)
    if not known.any():
        return posterior
    wide = posterior.cov + _WIDENING * predicted.cov
    return Gaussian(posterior.mean, np.where(known, wide, posterior.cov))


def _regression(
    model: Model, over: Gaussian, k: int, assumed: AssumedNoise, rule: PointRule
) -> tuple[Array, Array, Array]:
    """Regress the measurement on the state over N(m, P) (eqs. 5-9).

    Returns ``at`` (n_z, M), ``slope`` (n_z, n, M) and ``cov`` (n_z, n_z, M) of the line
    ``z = at + slope (x - m) + N(0, cov)``.
    """
    # Measured points, as innovations about the mean's: angles are averaged away from their cut.
    points = rule.points(over)
    z = model.sensor.measurement(points.x, k).mean
    center = z[:, :1]
    offsets = relative_measurements(model, points.x, z, k)
    mean = points.mean(offsets)
    # slope = C' P^-1, C = cov(x, z);  cov = R + cov(z, z) - slope P slope'
    cross = points.cross(points.x, over.mean, offsets, mean)
    slope = linalg.transpose(linalg.solve_singular(over.cov, cross))
    R = with_trailing(assumed.measurement(model, over.mean, k).cov, 1, leading=2)
    spread = points.cross(offsets, mean, offsets, mean)
    unexplained = spread - linalg.sandwich(slope, over.cov)
    if (cancelled := is_cancelled(unexplained, spread)).any():
        # As of a linear sensor: sum the squares of z - slope x over the points.
        moved = linalg.matvec(slope[:, :, None], points.x - over.mean[:, None])
        rest, zero = offsets - mean[:, None] - moved, np.zeros_like(mean)
        unexplained = np.where(cancelled, points.cross(rest, zero, rest, zero), unexplained)
    return center[:, 0] + mean, slope, R + linalg.symmetrize(unexplained)
