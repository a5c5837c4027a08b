"""A filter whose two axes do not couple: the axis is one more batch axis.

A state of n components is ``(n, 2, M)``: component, axis, run. A covariance is ``(n, n, A, M)`` with
A = 1 as long as both axes share it, which halves the work.
"""

from functools import cache
from typing import NamedTuple, cast

import numpy as np

from trackbench.core import kalman
from trackbench.core.arrays import Array, Mask, fixed, with_trailing
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.core.kalman import Updated
from trackbench.models.base import Model
from trackbench.models.motions.kinematic import Axis, Linear
from trackbench.models.sensors.position import PositionSensor


class Site(NamedTuple):
    """Sampling time T, s, and the variance R (1, 1) of a position measured along an axis."""

    T: float
    R: Array


def site(model: Model) -> Site:
    """What these filters take from the scenario's model."""
    motion, sensor = cast("tuple[Linear, PositionSensor]", model)
    return Site(motion.T, sensor.per_axis)


def per_axis(prior: Distribution) -> Gaussian:
    """A prior that begins (px, vx, py, vy), mean (n, M), as mean (2, 2, M) and cov (2, 2, A, M).

    Raises ValueError if it correlates the axes.
    """
    runs = prior.mean.shape[1]
    if prior.cov[:2, 2:4].any():
        raise ValueError("the prior correlates x and y, which this filter treats apart")
    cov = with_trailing(prior.cov, 1, leading=2)
    blocks = np.stack([cov[:2, :2], cov[2:4, 2:4]], axis=2)
    if (blocks[:, :, 0] == blocks[:, :, 1]).all():
        blocks = blocks[:, :, :1]
    shape = (*blocks.shape[:3], runs)
    mean = prior.mean[:4].reshape(2, 2, runs).swapaxes(0, 1)
    return Gaussian(mean.copy(), np.broadcast_to(blocks, shape).copy())


def both_axes(state: Gaussian) -> Gaussian:
    """Position and velocity of both axes: mean (4, M), cov (4, 4, M)."""
    runs = state.mean.shape[-1]
    cov = np.zeros((4, 4, runs))
    cov[:2, :2] = state.cov[:2, :2, 0]
    cov[2:, 2:] = state.cov[:2, :2, -1]
    return Gaussian(state.mean[:2].swapaxes(0, 1).reshape(4, runs), cov)


def axis_step(state: Gaussian, motion: Axis, z: Array, R: Array) -> Updated:
    """Predict and update every axis with its position z (2, M) (adaptive-kf, eqs. 8-12).

    A run that misses one coordinate of a measurement is treated as missing both.
    """
    predicted = kalman.predict(state, motion.F, motion.Q)
    nu = (z - predicted.mean[0])[None]
    missing = np.isnan(nu)
    if missing.any():
        nu = np.where(missing.any(axis=1), np.nan, nu)
    posterior, innovation = kalman.update(predicted, nu, _position(len(motion.F)), R)
    shared = state.cov.shape[2]  # a missing measurement leaves the axes alike
    alike = innovation._replace(S=innovation.S[:, :, :shared])
    return Gaussian(posterior.mean, posterior.cov[:, :, :shared]), alike


@cache
def _position(n: int) -> Array:
    """H (1, n) of a sensor that measures the first of n components."""
    return fixed(np.eye(1, n))


def over_axes(values: Array) -> Array:
    """Sum over the axes (2, M): of NIS, or of log-likelihoods, zero where nothing was measured."""
    x, y = np.where(np.isnan(values), 0.0, values)
    return np.asarray(x + y)


def choose(where: Mask, a: Gaussian, b: Gaussian) -> Gaussian:
    """``a`` in the chosen runs (M,), ``b`` in the others."""
    return Gaussian(np.where(where, a.mean, b.mean), np.where(where, a.cov, b.cov))


def first_components(state: Gaussian, n: int) -> Gaussian:
    """The marginal of the first n components."""
    return Gaussian(state.mean[:n], state.cov[:n, :n])
