"""Moments of a function of a Gaussian by weighted points: unscented and cubature transform."""

from dataclasses import dataclass
from functools import cache
from typing import NamedTuple, Protocol

import numpy as np

from trackbench.core import compiled, linalg
from trackbench.core.arrays import Array, is_float64, with_axes_of, with_trailing
from trackbench.core.distributions import Factored, Gaussian, from_root, root_of
from trackbench.core.linalg import block_diagonal
from trackbench.core.read_only import fixed


class PointRule(Protocol):
    """Rule for the points and weights of a Gaussian; its first point is the mean."""

    def points(self, gaussian: Gaussian) -> "SigmaPoints":
        """Return points and weights of a Gaussian.

        Parameters
        ----------
        gaussian : Gaussian
            Mean (n, *batch), covariance (n, n[, *batch]).

        Returns
        -------
        SigmaPoints
            Points (n, P, *batch), and weights (P,) of the mean and of the covariance.
        """


@dataclass(frozen=True)
class Unscented:
    """Scaled unscented transform (Julier & Uhlmann 1997; van der Merwe et al. 2000, section 3).

    With ``lambda = alpha^2 (n + kappa) - n`` the points are ``m`` and ``m +- `` the columns of
    ``sqrt((n + lambda) P)``. Weights are ``lambda / (n + lambda)`` for the center, plus
    ``1 - alpha^2 + beta`` in the covariance, and ``1 / (2 (n + lambda))`` for the others.
    """

    alpha: float
    beta: float
    kappa: float

    def points(self, gaussian: Gaussian) -> "SigmaPoints":
        """Place the 2 n + 1 sigma points of N(m, P).

        Parameters
        ----------
        gaussian : Gaussian
            Mean m (n, *batch), covariance P (n, n[, *batch]), which may be singular.

        Returns
        -------
        SigmaPoints
            Points (n, 2 n + 1, *batch), weights of the mean and of the covariance (2 n + 1,).
        """
        mean = gaussian.mean
        n = len(mean)
        spread = self.spread(n)
        # Step 1: m, then m + columns of sqrt(n + lambda) L, then m - columns; P = L L', `spread` is
        # n + lambda.
        root = root_of(gaussian)
        x = np.empty((n, 2 * n + 1, *mean.shape[1:]))
        # The kernel fills x, or returns False for arrays that it leaves to the loop below.
        if compiled.kernels and compiled.kernels.sigma_points(
            mean, root, x, float(np.sqrt(spread))
        ):
            return SigmaPoints(x, *_weights(self, n))
        columns = np.sqrt(spread) * linalg.transpose(root)
        x[:, 0] = mean
        for i in range(n):
            column = with_axes_of(mean, columns[i])
            x[:, 1 + i] = mean + column
            x[:, 1 + n + i] = mean - column
        # Step 2: weights of the mean and of the covariance, which differ in the center.
        return SigmaPoints(x, *_weights(self, n))

    def weights(self, n: int) -> tuple[Array, Array]:
        """Return the weights (2 n + 1,) of the mean and of the covariance."""
        return _weights(self, n)

    def spread(self, n: int) -> float:
        """Return n + lambda = alpha^2 (n + kappa): the square of the points' distance in deviations."""
        return self.alpha * self.alpha * (n + self.kappa)


@cache
def _weights(rule: Unscented, n: int) -> tuple[Array, Array]:
    """Compute the weights (2 n + 1,) of the mean and of the covariance."""
    spread = rule.spread(n)
    center = 1.0 - n / spread  # lambda / (n + lambda)
    weights = np.full(2 * n + 1, 0.5 / spread)
    cov_weights = weights.copy()
    weights[0] = center
    cov_weights[0] = center + 1.0 - rule.alpha * rule.alpha + rule.beta
    return fixed(weights), fixed(cov_weights)


class SigmaPoints(NamedTuple):
    """Points (n, P, *batch), weights of the mean and of the covariance (P,)."""

    x: Array
    weights: Array
    cov_weights: Array

    def mean(self, values: Array) -> Array:
        """Average transformed points (m, P, *batch) by their weights; shape (m, *batch)."""
        return _weighted(self.weights, values)

    def cross(self, a: Array, a_mean: Array, b: Array, b_mean: Array) -> Array:
        """Sum the weighted ``(a - a_mean) (b - b_mean)'`` over the points.

        Parameters
        ----------
        a, b : array (n, P, *batch) and (m, P, *batch)
            Transformed points.
        a_mean, b_mean : array (n, *batch) and (m, *batch)
            Their means.

        Returns
        -------
        array (n, m, *batch)
            Covariance of a and b.
        """
        batch = a_mean.shape[1:]
        arrays = (self.cov_weights, a, a_mean, b, b_mean)
        has_points = a.shape[1:] == b.shape[1:] == (len(self.weights), *batch)
        is_alike = has_points and b_mean.shape[1:] == batch
        if compiled.kernels and is_alike and all(x.dtype == np.float64 for x in arrays):
            out = np.empty((len(a), len(b), *batch))
            contiguous = map(np.ascontiguousarray, arrays)
            compiled.kernels.cross(*contiguous, out, len(a), len(b))
            return out
        e_a = a - a_mean[:, None]
        e_b = b - b_mean[:, None]
        return np.stack([_weighted(self.cov_weights, row * e_b) for row in e_a])

    def moments(self, values: Array, noise: Array | None = None, roots: bool = False) -> Gaussian:
        """Compute the moments of transformed points.

        Parameters
        ----------
        values : array (m, P, *batch)
            Transformed points.
        noise : array (m, m[, *batch]), optional
            Covariance that is added.
        roots : bool
            Return a `Factored`, computed from roots.

        Returns
        -------
        Gaussian
            Mean (m, *batch), covariance (m, m, *batch).
        """
        mean = self.mean(values)
        if roots:
            columns = [self.columns(values - mean[:, None])]
            if noise is not None:
                columns.append(linalg.root(noise))
            return from_root(mean, linalg.triangular(linalg.beside(*columns)))
        cov = self.cross(values, mean, values, mean)
        if noise is not None:
            cov = cov + with_axes_of(cov, noise)
        return Gaussian(mean, cov)

    def columns(self, deviation: Array) -> Array:
        """Scale deviations (m, P, *batch) to D with ``D D'`` the weighted sum of their squares."""
        return deviation * with_trailing(np.sqrt(self.cov_weights), deviation.ndim - 2)


def _weighted(weights: Array, values: Array) -> Array:
    """Return the sum (m, *batch) over the P points of values (m, P, *batch) times weights (P,)."""
    if compiled.kernels and is_float64(values, (len(values), len(weights), *values.shape[2:])):
        out = np.empty((len(values), *values.shape[2:]))
        values = np.ascontiguousarray(values)
        compiled.kernels.weighted(np.ascontiguousarray(weights), values, out, len(values))
        return out
    total = weights[0] * values[:, 0]
    for i in range(1, len(weights)):
        total = total + weights[i] * values[:, i]
    return total


def augmented_state(state: Gaussian, Q: Array, R: Array) -> Gaussian:
    """Join state, process noise and measurement noise: mean (m, 0, 0), covariance diag(P, Q, R).

    Parameters
    ----------
    state : Gaussian
        State: m (n, *batch), P (n, n[, *batch]).
    Q : array (n_v, n_v[, *batch])
        Covariance of the process noise.
    R : array (n_z, n_z[, *batch])
        Covariance of the measurement noise.

    Returns
    -------
    Gaussian
        Mean (n + n_v + n_z, *batch), and covariance with two such axes and the batch. If the state is
        `Factored`, so is the result.
    """
    n_x = len(state.mean)
    batch = state.mean.shape[1:]
    mean = np.zeros((n_x + len(Q) + len(R), *batch))
    mean[:n_x] = state.mean
    if isinstance(state, Factored):
        roots = (state.root, linalg.root(Q), linalg.root(R))
        return from_root(mean, block_diagonal(roots, batch))
    return Gaussian(mean, block_diagonal((state.cov, Q, R), batch))
