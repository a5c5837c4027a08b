"""The scaled unscented transform (Julier & Uhlmann 1997; van der Merwe et al. 2000, section 3).

``lambda = alpha^2 (n + kappa) - n``; points ``m`` and ``m +- sqrt((n + lambda) P)`` columns; weights
``lambda / (n + lambda)`` for the centre (plus ``1 - alpha^2 + beta`` in the covariance) and
``1 / (2 (n + lambda))`` for the others.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from trackbench.core import linalg
from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian


@dataclass(frozen=True)
class Unscented:
    """The transform's three parameters."""

    alpha: float
    beta: float
    kappa: float

    def points(self, mean: Array, cov: Array) -> "SigmaPoints":
        """Sigma points of N(mean, cov): mean (n, *batch), cov (n, n, *batch)."""
        n = mean.shape[0]
        spread = self.alpha * self.alpha * (n + self.kappa)  # n + lambda
        centre = 1.0 - n / spread  # lambda / (n + lambda)
        columns = np.sqrt(spread) * linalg.transpose(linalg.root(cov))
        x = np.empty((n, 2 * n + 1, *mean.shape[1:]))
        x[:, 0] = mean
        for i in range(n):
            column = _vector_like(columns[i], mean)
            x[:, 1 + i] = mean + column
            x[:, 1 + n + i] = mean - column
        weights = np.full(2 * n + 1, 0.5 / spread)
        cov_weights = weights.copy()
        weights[0] = centre
        cov_weights[0] = centre + 1.0 - self.alpha * self.alpha + self.beta
        return SigmaPoints(x, weights, cov_weights)


class SigmaPoints(NamedTuple):
    """Points (n, 2 n + 1, *batch), weights of the mean and of the covariance (2 n + 1,)."""

    x: Array
    weights: Array
    cov_weights: Array

    def mean(self, values: Array) -> Array:
        """Weighted mean of transformed points (m, 2 n + 1, *batch); shape (m, *batch)."""
        return _weighted(self.weights, values)

    def cross(self, a: Array, b: Array) -> Array:
        """Weighted sum of ``a b'`` over the points, for deviations a and b from their means."""
        return np.stack([_weighted(self.cov_weights, row * b) for row in a])

    def moments(self, values: Array) -> Gaussian:
        """Mean and covariance of transformed points."""
        mean = self.mean(values)
        deviation = values - mean[:, None]
        return Gaussian(mean, self.cross(deviation, deviation))


def _weighted(weights: Array, values: Array) -> Array:
    total = weights[0] * values[:, 0]
    for i in range(1, len(weights)):
        total = total + weights[i] * values[:, i]
    return total


def _vector_like(v: Array, like: Array) -> Array:
    return v.reshape(v.shape + (1,) * (like.ndim - v.ndim))
