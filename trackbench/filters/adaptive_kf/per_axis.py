"""Kalman steps of two axes that do not couple, and the restart that refilters from the onset on.

The axis is one more batch axis: a state of n components is ``(n, 2, M)``: component, axis, run. A
covariance is ``(n, n, A, M)`` with A = 1 as long as both axes share it, which halves the work. The
restart is that of Bar-Shalom & Birmiwal 1982.
"""

from functools import cache
from typing import NamedTuple, cast

import numpy as np

from trackbench.core import kalman
from trackbench.core.arrays import Array, Index, Mask, any_nan, with_trailing
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
    """Split a prior of (px, vx, py, vy, ...) into axes: mean (2, 2, M) and cov (2, 2, A, M).

    A is 1 if both axes have one covariance, else 2. Raises ValueError if the prior correlates the axes.
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
    """Join position and velocity of both axes: mean (4, M), cov (4, 4, M)."""
    runs = state.mean.shape[-1]
    cov = np.zeros((4, 4, runs))
    # One covariance for both axes, or one for each: index -1 is the second axis, or the only entry.
    cov[:2, :2] = state.cov[:2, :2, 0]
    cov[2:, 2:] = state.cov[:2, :2, -1]
    return Gaussian(state.mean[:2].swapaxes(0, 1).reshape(4, runs), cov)


def axis_step(state: Gaussian, motion: Axis, z: Array, R: Array) -> Updated:
    """Predict and update every axis with its position z (2, M) (adaptive-kf, eqs. 8-12).

    A run that misses one coordinate of a measurement is treated as missing both.
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


class History(NamedTuple):
    """Posteriors of the NMF and measurements of the last W steps, step k in slot k % W.

    ``mean`` (W, 2, 2, M), ``cov`` (W, 2, 2, A, M), ``z`` (W, 2, M).
    """

    mean: Array
    cov: Array
    z: Array

    def add_measurement(self, z: Array, k: int) -> "History":
        """Add the measurement of step k."""
        return self._replace(z=_with_entry(self.z, k, z))

    def add_posterior(self, posterior: Gaussian, k: int) -> "History":
        """Return the history with the posterior of step k in the slot of step k - W."""
        mean = _with_entry(self.mean, k, posterior.mean)
        cov = _with_entry(self.cov, k, posterior.cov)
        return self._replace(mean=mean, cov=cov)

    def has_measurement(self, k: Index) -> Mask:
        """Test whether each run has a measurement of its step k (M,)."""
        runs = np.arange(len(k))
        return np.asarray(np.isfinite(self.z[k % len(self.z), :, runs]).all(axis=1))


def initial_history(prior: Gaussian, window: int) -> History:
    """Fill every slot of a history with the prior, without measurements."""
    return History(
        np.broadcast_to(prior.mean, (window, *prior.mean.shape)),
        np.broadcast_to(prior.cov, (window, *prior.cov.shape)),
        np.full((window, *prior.mean.shape[1:]), np.nan),
    )


def refilter(
    past: History, onset: Index, runs: Index, k: int, motion: Axis, sampling: Sampling
) -> Gaussian:
    """Filter the measurements since the onset again by the maneuvering filter (MF), up to step k.

    ``past`` has the window's measurements and the posteriors of the non-maneuvering filter (NMF),
    ``runs`` (m,) are the runs that are filtered, ``onset`` (m,) is the step of each one's onset, and
    ``motion`` is the MF's. The result has means (3, 2, m).
    """
    T, R = sampling
    W = len(past.z)
    # The NMF's posterior at the onset. Fancy indices move in front: (m, 2, 2) and (m, 2, 2, A).
    mean = np.moveaxis(past.mean[onset % W, :, :, runs], 0, -1)
    cov = np.moveaxis(past.cov[onset % W, :, :, :, runs], 0, -1)
    # The first measurement after the onset initializes the MF, the later ones update it.
    first = past.z[(onset + 1) % W, :, runs].T
    state = augmented_start(Gaussian(mean, cov), first, T, float(R[0, 0]))
    for step in range(int(onset.min()) + 2, k + 1):
        updated, _ = axis_step(state, motion, past.z[step % W][:, runs], R)
        state = where_runs(step >= onset + 2, updated, state)
    return state


def augmented_start(state: Gaussian, z: Array, T: float, R: float) -> Gaussian:
    """Estimate position, velocity, acceleration by the first measurement z (2, m) of a maneuver.

    The acceleration a is the one that moves the posterior (x, v, P) of the step before to z within T:
    ``a = 2 (z - x - T v) / T^2``. The position is z, the velocity ``v + T a`` (Bar-Shalom & Birmiwal
    1982, eqs. 21-29). R is the variance of z.
    """
    x, v = state.mean
    p11 = state.cov[0, 0]
    p12 = state.cov[0, 1]
    p22 = state.cov[1, 1]
    # Mean: a = 2 e / T^2 with e = z - x - T v.
    a = 2.0 / (T * T) * (z - x - T * v)
    mean = np.stack([z, v + T * a, a])
    # With var(z) = R the covariances of z, v + T a and a follow.
    P11 = np.full_like(p11, R)
    P12 = np.full_like(p11, 2.0 * R / T)
    P13 = np.full_like(p11, 2.0 * R / (T * T))
    P22 = 4.0 / (T * T) * (R + p11) + p22 + 4.0 * p12 / T
    P23 = 4.0 / (T * T * T) * (R + p11) + 2.0 * p22 / T + 6.0 * p12 / (T * T)
    P33 = 4.0 / (T * T * T * T) * (R + p11 + 2.0 * T * p12 + T * T * p22)
    rows = [[P11, P12, P13], [P12, P22, P23], [P13, P23, P33]]
    return Gaussian(mean, np.stack([np.stack(row) for row in rows]))


def _with_entry(ring: Array, k: int, entry: Array) -> Array:
    """Return a copy of a ring (W, ...) of the last W steps' entries with that of step k replaced."""
    out = ring.copy()
    out[k % len(ring)] = entry
    return out
