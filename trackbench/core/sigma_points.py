"""Moments of a function of a Gaussian by weighted points: unscented and cubature transform."""

from dataclasses import dataclass
from functools import cache
from math import sqrt
from typing import NamedTuple, Protocol

import numpy as np

from trackbench.core import compiled, linalg
from trackbench.core.arrays import Array, with_axes_of, with_trailing
from trackbench.core.distributions import Gaussian, from_root, root_of
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

    def scalar_points(self, state: Gaussian) -> "ScalarPoints | None":
        """Place the state's sigma points of (x, v, n): a scalar, and noises v ~ N(0, Q), n ~ N(0, R).

        They are those of `points` for the covariance diag(P, Q, R), found without its root. x has the
        three states among the seven points: the center, and those on both sides of it. The points of the
        noises have the center's state, so that the C kernels use one value for them all.

        Returns None if the state has several components, or without C kernels. It also returns None if a
        mean is -0.0: `points` computes the state of a noise's point as -0.0 + 0.0, which is +0.0 and has
        other bits than the center's.
        """
        if len(state.mean) > 1 or not compiled.kernels:
            return None
        x = np.empty((1, 3, *state.mean.shape[1:]))
        scale = sqrt(self.spread(3))
        if not compiled.kernels.scalar_points(state.mean, state.cov, x, scale):
            return None
        return ScalarPoints(x, scale, *_weights(self, 3))

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


class ScalarPoints(NamedTuple):
    """The distinct ones of the seven sigma points of (x, v, n), for the C kernels.

    x (1, 3, *batch) are the mean and the points on both sides of it. The points of the noises are
    ``scale`` standard deviations from the mean, and each method adds those of one noise.
    """

    x: Array
    scale: float
    weights: Array
    cov_weights: Array

    def add_noise(self, moved: Array, Q: Array) -> Array | None:
        """Return the predicted points (1, 5, *batch) by the motion f with noise of the variance Q.

        Three are ``moved`` (1, 3, *batch), which is f at the points x. The other two are f(mean) +- v, v
        being ``scale`` standard deviations of the noise. The result is None if ``moved`` or Q (1, 1) has
        another shape or a type other than float64, or without C kernels.
        """
        if compiled.kernels is None or not (
            _is_float(moved, self.x.shape) and _is_float(Q, (1, 1))
        ):
            return None
        predicted = np.empty((1, 5, *moved.shape[2:]))
        compiled.kernels.scalar_noise(np.ascontiguousarray(moved), Q, predicted, self.scale)
        return predicted

    def condition(
        self, predicted: Array, h: Array, R: Array, z: Array
    ) -> tuple[Array, Array, Array, Array] | None:
        """Condition on a scalar measurement, with the result of all seven points of (x, v, n).

        The two points of the measurement noise n are added here.

        Parameters
        ----------
        predicted : array (1, 5, *batch)
            Points from `add_noise`.
        h : array (1, 5, *batch)
            Their measurements without noise.
        R : array (1, 1)
            Variance of the measurement noise.
        z : array (1, M)
            Measurements.

        Returns
        -------
        mean, cov, nu, S : arrays (1, *batch), (1, 1, *batch), (1, *batch), (1, 1, *batch)
            Posterior, innovation and its variance. The result is None if any innovation is NaN, if h, R
            or z has another shape or a type other than float64, or without C kernels.
        """
        batch = predicted.shape[2:]
        alike = (
            _is_float(h, predicted.shape) and _is_float(R, (1, 1)) and _is_float(z, (1, *batch[:1]))
        )
        if compiled.kernels is None or not alike:
            return None
        mean = np.empty((1, *batch))
        nu = np.empty((1, *batch))
        cov = np.empty((1, 1, *batch))
        S = np.empty((1, 1, *batch))
        h = np.ascontiguousarray(h)
        z = np.ascontiguousarray(z)
        arrays = (self.weights, self.cov_weights, predicted, h, R, z, mean, cov, nu, S)
        if not compiled.kernels.scalar_update(*arrays, self.scale):
            return None
        return mean, cov, nu, S


def _is_float(a: Array, shape: tuple[int, ...]) -> bool:
    return a.shape == shape and a.dtype == np.float64


def _weighted(weights: Array, values: Array) -> Array:
    """Return the sum (m, *batch) over the P points of values (m, P, *batch) times weights (P,)."""
    if compiled.kernels and _is_float(values, (len(values), len(weights), *values.shape[2:])):
        out = np.empty((len(values), *values.shape[2:]))
        values = np.ascontiguousarray(values)
        compiled.kernels.weighted(np.ascontiguousarray(weights), values, out, len(values))
        return out
    total = weights[0] * values[:, 0]
    for i in range(1, len(weights)):
        total = total + weights[i] * values[:, i]
    return total
