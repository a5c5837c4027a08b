"""Restart at the onset of a maneuver: its data are filtered again (Bar-Shalom & Birmiwal 1982)."""

from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array, Index, Mask
from trackbench.core.distributions import Gaussian
from trackbench.filters.adaptive_kf.per_axis import Sampling, axis_step, where_runs
from trackbench.models.motions.kinematic import Axis


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
    """Fill every slot of a history with the prior, without measurements.

    Parameters
    ----------
    prior : Gaussian
        Mean (2, 2, M), component by axis, and covariance (2, 2, A, M).
    window : int
        Number W of slots, in steps.

    Returns
    -------
    History
        Mean (W, 2, 2, M), covariance (W, 2, 2, A, M), and measurements (W, 2, M) that are all NaN.
    """
    return History(
        np.broadcast_to(prior.mean, (window, *prior.mean.shape)),
        np.broadcast_to(prior.cov, (window, *prior.cov.shape)),
        np.full((window, *prior.mean.shape[1:]), np.nan),
    )


def refilter(
    past: History, onset: Index, runs: Index, k: int, motion: Axis, sampling: Sampling
) -> Gaussian:
    """Filter the measurements since the onset again by the maneuvering filter (MF), up to step k.

    Parameters
    ----------
    past : History
        The window's measurements, and the posteriors of the non-maneuvering filter (NMF).
    onset : array (m,)
        Step of the onset in each of the m runs, which must have a measurement of the step after it.
    runs : array (m,)
        Indices of the runs that are filtered.
    k : int
        Number of the last step.
    motion : Axis
        Motion of the MF along an axis, of position, velocity and acceleration.
    sampling : Sampling
        Sampling time, s, and variance (1, 1) of a measured position, m^2.

    Returns
    -------
    Gaussian
        Posterior of the MF at step k: mean (3, 2, m), component by axis, and covariance (3, 3, A, m).
    """
    T, R = sampling
    W = len(past.z)
    # The NMF's posterior at the onset. Fancy indices move in front: (m, 2, 2) and (m, 2, 2, A).
    mean = np.moveaxis(past.mean[onset % W, :, :, runs], 0, -1)
    cov = np.moveaxis(past.cov[onset % W, :, :, :, runs], 0, -1)
    # The first measurement after the onset initializes the MF, the later ones update it.
    first = past.z[(onset + 1) % W, :, runs].T
    state = augmented_start(Gaussian(mean, cov), first, T, float(R[0, 0]))
    # Each run goes on from its own onset; runs whose onset is later wait.
    for step in range(int(onset.min()) + 2, k + 1):
        updated, _ = axis_step(state, motion, past.z[step % W][:, runs], R)
        state = where_runs(step >= onset + 2, updated, state)
    return state


def augmented_start(state: Gaussian, z: Array, T: float, R: float) -> Gaussian:
    """Estimate position, velocity and acceleration by the first measurement of a maneuver.

    The acceleration a is the one that moves the posterior (x, v, P) of the step before to z within T:
    ``a = 2 (z - x - T v) / T^2``. The position is z, the velocity ``v + T a`` (Bar-Shalom & Birmiwal
    1982, eqs. 21-29).

    Parameters
    ----------
    state : Gaussian
        Posterior of the step before: mean (2, 2, m), position and velocity by axis of the plane, and
        covariance (2, 2, A, m), with A = 1 if both axes share it.
    z : array (2, m)
        Measured positions of the m runs, m.
    T : float
        Sampling time, s.
    R : float
        Variance of z, m^2.

    Returns
    -------
    Gaussian
        Mean (3, 2, m) and covariance (3, 3, A, m).
    """
    x, v = state.mean  # (2, m) each: of both axes
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
