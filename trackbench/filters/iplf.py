"""Iterated posterior linearization filter: linearizes by regression over the last posterior."""

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
from annotated_types import Interval

from trackbench.core import kalman, linalg
from trackbench.core.arrays import Array, with_trailing
from trackbench.core.distributions import Gaussian
from trackbench.core.gauss_hermite_points import gauss_hermite
from trackbench.core.kalman import Innovation, Updated
from trackbench.core.rts_smoother import Transition
from trackbench.core.sigma_points import PointRule, Unscented
from trackbench.field_types import Count
from trackbench.filters.assumed_noise import AssumedNoise
from trackbench.filters.gauss_hermite_filter import MAX_ORDER
from trackbench.filters.gaussian_base import NonlinearFilter
from trackbench.filters.sigma_point_steps import (
    is_cancelled,
    point_prediction,
    point_transition,
    relative_measurements,
)
from trackbench.models.base import Model
from trackbench.registry import register

_CUBATURE = Unscented(1.0, 0.0, 0.0)
_LEAST_SPREAD = 1e-10  # standard deviation, as a share of the state, that a regression resolves
_WIDENING = 1e-8  # share of the predicted covariance


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
            # nu = z - E h(x) - A (m - m_i), with the predicted mean m.
            # The line is z = mean + A (x - m_i) + N(0, cov), about its estimate m_i.
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
