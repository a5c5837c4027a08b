"""Sigma points of a scalar state and its noises by the C kernels, without the augmented covariance."""

from math import sqrt
from typing import NamedTuple

import numpy as np

from trackbench.core import compiled
from trackbench.core.arrays import Array, is_float64
from trackbench.core.distributions import Gaussian
from trackbench.core.sigma_points import Unscented


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
        """Return the predicted points by the motion f with noise of the variance Q.

        Three of them are f at the points x. The other two are f(mean) +- v, v being ``scale`` standard
        deviations of the noise.

        Parameters
        ----------
        moved : array (1, 3, *batch)
            Motion f at the points x, without noise.
        Q : array (1, 1)
            Variance of the motion's noise.

        Returns
        -------
        array (1, 5, *batch) or None
            Predicted points. The result is None if ``moved`` or Q has another shape or a type other than
            float64, or without C kernels.
        """
        if compiled.kernels is None or not (
            is_float64(moved, self.x.shape) and is_float64(Q, (1, 1))
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
            is_float64(h, predicted.shape)
            and is_float64(R, (1, 1))
            and is_float64(z, (1, *batch[:1]))
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


def scalar_points(rule: Unscented, state: Gaussian) -> ScalarPoints | None:
    """Place the state's sigma points of (x, v, n): a scalar, and noises v ~ N(0, Q), n ~ N(0, R).

    They are those of `rule.points` for the covariance diag(P, Q, R), found without its root. The points
    of the noises have the center's state, so that the C kernels use one value for them all.

    Parameters
    ----------
    rule : Unscented
        Spread of the points and their weights.
    state : Gaussian
        Mean (1, *batch) and covariance (1, 1[, *batch]) of the scalar.

    Returns
    -------
    ScalarPoints or None
        The three states x (1, 3, *batch) among the seven points: the center, and those on both sides of
        it. Weights (7,) of the mean and of the covariance are those of all seven points.

        The result is None if the state has several components, or without C kernels. It is also None if
        a mean is -0.0: `rule.points` computes the state of a noise's point as -0.0 + 0.0, which is +0.0
        and has other bits than the center's.
    """
    if len(state.mean) > 1 or not compiled.kernels:
        return None
    x = np.empty((1, 3, *state.mean.shape[1:]))
    scale = sqrt(rule.spread(3))
    if not compiled.kernels.scalar_points(state.mean, state.cov, x, scale):
        return None
    return ScalarPoints(x, scale, *rule.weights(3))
