"""Iterated posterior linearisation: sigma points where the state is now believed to be."""

from dataclasses import dataclass

import numpy as np

from trackbench.core import kalman, linalg
from trackbench.core.arrays import Array, with_trailing
from trackbench.core.distributions import Gaussian
from trackbench.core.kalman import Updated
from trackbench.core.unscented import Unscented
from trackbench.field_types import Count
from trackbench.filters.gaussian_base import NonlinearFilter
from trackbench.models.base import Model
from trackbench.models.gaussian_steps import AssumedNoise, point_prediction
from trackbench.registry import register

_CUBATURE = Unscented(1.0, 0.0, 0.0)


@register("filters", "iplf")
@dataclass(frozen=True, kw_only=True)
class IPLF(NonlinearFilter):
    """Iterated posterior linearisation filter: regression lines over cubature points of the posterior.

    Garcia-Fernandez, Svensson, Morelande & Sarkka 2015. The first line is that of the cubature filter;
    each further one is drawn over the last posterior, so that a sharp measurement is linearised where it
    leaves the state and not over all that was predicted.
    """

    iterations: Count = 5
    """lines per update; 1 is the cubature Kalman filter"""

    def updated(self, model: Model, state: Gaussian, z: Array, k: int) -> Updated:
        """Predict by points; draw the line of the measurement anew over each posterior."""
        predicted = point_prediction(model, state, k, self.assumed, _CUBATURE)
        posterior, first = predicted, None
        for _ in range(self.iterations):
            line = _regression(model, posterior, k, self.assumed)
            nu = model.sensor.innovation(z, line.at)
            nu = nu - linalg.matvec(line.slope, predicted.mean - posterior.mean)
            posterior, innovation = kalman.update(predicted, nu, line.slope, line.cov)
            first = first or innovation
        assert first is not None
        return posterior, first


@dataclass(frozen=True)
class _Line:
    """``z = at + slope (x - m) + N(0, cov)``: at (n_z, M), slope (n_z, n, M), cov (n_z, n_z, M)."""

    at: Array
    slope: Array
    cov: Array


def _regression(model: Model, over: Gaussian, k: int, assumed: AssumedNoise) -> _Line:
    """The statistical linear regression of the measurement over N(m, P), eqs. 5-9."""
    points = _CUBATURE.points(over.mean, over.cov)
    z = model.sensor.measurement(points.x, k).mean
    centre = z[:, :1]  # deviations from it keep angles away from the cut
    seen = model.sensor.innovation(z, centre)
    mean = points.mean(seen)
    dz, dx = seen - mean[:, None], points.x - over.mean[:, None]
    slope = linalg.transpose(_without_spread_none(over.cov, points.cross(dx, dz)))
    R = with_trailing(assumed.measurement(model, over.mean, k).cov, 1, leading=2)
    unexplained = points.cross(dz, dz) - linalg.sandwich(slope, over.cov)
    return _Line(centre[:, 0] + mean, slope, R + linalg.symmetrize(unexplained))


def _without_spread_none(P: Array, C: Array) -> Array:
    """``P^-1 C`` for C (n, m, M); nothing along a direction in which P (n, n, M) has no spread."""
    L = linalg.root(P)
    with np.errstate(divide="ignore"):
        scale = [np.where(L[i, i] > 0.0, 1.0 / L[i, i], 0.0) for i in range(len(L))]
    rows: list[Array] = []
    for i in range(len(L)):
        rest = C[i]
        for j in range(i):
            rest = rest - L[i, j] * rows[j]
        rows.append(rest * scale[i])
    for i in reversed(range(len(L))):
        for j in range(i + 1, len(L)):
            rows[i] = rows[i] - L[j, i] * rows[j]
        rows[i] = rows[i] * scale[i]
    return np.array(rows)
