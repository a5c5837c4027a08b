"""Kalman steps of two axes that do not couple.

The axis is one more batch axis: a state of n components is ``(n, 2, M)``: component, axis, run. A
covariance is ``(n, n, A, M)`` with A = 1 as long as both axes share it, which halves the work.
"""

from functools import cache
from typing import NamedTuple, cast

import numpy as np

from trackbench.core import kalman
from trackbench.core.arrays import Array, Mask, any_nan, with_trailing
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.core.kalman import Innovation, Updated
from trackbench.core.read_only import fixed
from trackbench.models.base import Model
from trackbench.models.motions.kinematic import Axis
from trackbench.models.motions.linear import Linear
from trackbench.models.sensors.position import PositionSensor


class Sampling(NamedTuple):
    """Sampling time T, s, and the variance R (1, 1) of a position measured along an axis."""

    T: float
    R: Array


def sampling_of(model: Model) -> Sampling:
    """Return sampling time and measurement variance of the scenario's model."""
    motion, sensor = cast("tuple[Linear, PositionSensor]", model)
    return Sampling(motion.T, sensor.per_axis)


def per_axis(prior: Distribution) -> Gaussian:
    """Split a prior of a planar state into its axes.

    Parameters
    ----------
    prior : Distribution
        Prior of (px, vx, py, vy, ...): mean (n_x, M), covariance (n_x, n_x[, M]). Components beyond the
        first four are left out.

    Returns
    -------
    Gaussian
        Mean (2, 2, M), component by axis, and covariance (2, 2, A, M). A is 1 if both axes have one
        covariance, else 2.

    Raises
    ------
    ValueError
        If the prior correlates the axes.
    """
    runs = prior.mean.shape[1]
    if prior.cov[:2, 2:4].any():
        raise ValueError("the prior correlates x and y, which this filter treats apart")
    cov = with_trailing(prior.cov, 1, leading=2)
    # Cut the covariance into one block (position, velocity) per axis.
    blocks = np.stack([cov[:2, :2], cov[2:4, 2:4]], axis=2)
    # Equal blocks share one covariance recursion: A = 1.
    if (blocks[:, :, 0] == blocks[:, :, 1]).all():
        blocks = blocks[:, :, :1]
    shape = (*blocks.shape[:3], runs)
    # (px, vx, py, vy) to (component, axis, run)
    mean = prior.mean[:4].reshape(2, 2, runs).swapaxes(0, 1)
    return Gaussian(mean.copy(), np.broadcast_to(blocks, shape).copy())


def both_axes(state: Gaussian) -> Gaussian:
    """Join position and velocity of both axes.

    Parameters
    ----------
    state : Gaussian
        Mean (n, 2, M), n components by axis, and covariance (n, n, A, M), with A = 1 if both axes share
        it. The first two components are position and velocity; a third one, the acceleration, is left
        out.

    Returns
    -------
    Gaussian
        Mean (4, M) of (px, vx, py, vy), and covariance (4, 4, M).
    """
    runs = state.mean.shape[-1]
    cov = np.zeros((4, 4, runs))
    # One covariance for both axes, or one for each: index -1 is the second axis, or the only entry.
    cov[:2, :2] = state.cov[:2, :2, 0]
    cov[2:, 2:] = state.cov[:2, :2, -1]
    return Gaussian(state.mean[:2].swapaxes(0, 1).reshape(4, runs), cov)


def axis_step(state: Gaussian, motion: Axis, z: Array, R: Array) -> Updated:
    """Predict and update every axis with its measured position (adaptive-kf, eqs. 8-12).

    Parameters
    ----------
    state : Gaussian
        Posterior of the step before: mean (n, 2, M), n components by axis of the plane, and covariance
        (n, n, A, M), with A = 1 if both axes share it.
    motion : Axis
        Transition matrix F and noise covariance Q (n, n[, 1, M]) of one axis.
    z : array (2, M)
        Measured positions, m. A run that misses one coordinate is treated as missing both.
    R : array (1, 1)
        Variance of a position measured along an axis, m^2.

    Returns
    -------
    posterior : Gaussian
        Mean (n, 2, M), covariance (n, n, A, M).
    innovation : Innovation
        ``nu`` (1, 2, M), NaN without a measurement, and S (1, 1, A, M).
    """
    # x- = F x, P- = F P F' + Q
    predicted = kalman.predict(state, motion.F, motion.Q)
    nu = (z - predicted.mean[0])[None]
    if any_nan(nu):
        nu = np.where(np.isnan(nu).any(axis=1), np.nan, nu)
    posterior, innovation = kalman.update(predicted, nu, _position_matrix(len(motion.F)), R)
    # Axes that share their covariance (A = 1) still do after a missing measurement, for which the update
    # gave each axis its own.
    axes = state.cov.shape[2]
    innovation = innovation._replace(S=innovation.S[:, :, :axes])
    return Gaussian(posterior.mean, posterior.cov[:, :, :axes]), innovation


@cache
def _position_matrix(n: int) -> Array:
    """Return H (1, n) of a sensor that measures the first of n components."""
    return fixed(np.eye(1, n))


def is_missing(innovation: Innovation) -> Mask:
    """Return the runs (M,) without a measurement."""
    if not any_nan(innovation.nu):
        return np.zeros(innovation.nu.shape[-1], dtype=np.bool_)
    return np.asarray(np.isnan(innovation.nu).any(axis=(0, 1)))


def sum_over_axes(values: Array) -> Array:
    """Sum NIS or log-likelihoods (2, M) to (M,), zero where nothing was measured."""
    x, y = np.where(np.isnan(values), 0.0, values) if any_nan(values) else values
    return np.asarray(x + y)


def where_runs(where: Mask, a: Gaussian, b: Gaussian) -> Gaussian:
    """Take ``a`` in the masked runs (M,), ``b`` in the others."""
    return Gaussian(np.where(where, a.mean, b.mean), np.where(where, a.cov, b.cov))


def first_components(state: Gaussian, n: int) -> Gaussian:
    """Return the marginal of the first n components."""
    return Gaussian(state.mean[:n], state.cov[:n, :n])
