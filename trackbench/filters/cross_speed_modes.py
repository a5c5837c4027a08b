"""Modes of the particles of a radar's target, which may cross to the left or to the right."""

from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array, Mask
from trackbench.core.mixtures import combine
from trackbench.core.particles import Particles
from trackbench.core.regularization import Mode
from trackbench.core.sums import total

_MODE_FLOOR = 0.25  # least share of the particles of either mode
_NEGLIGIBLE = 1e-6  # share of the weight below which a mode is given up
_SEPARATION = 3.0  # distance of the modes' mean cross speeds, in sums of their standard deviations


class CrossSpeedModes(NamedTuple):
    """Particles split by the sign of the cross speed: positive first.

    A range depends on the square of the cross speed. Until the azimuths determine its sign, the
    particles have two modes, and one kernel as wide as both would blur them. Particles without two
    separate modes get one kernel. A few outlying azimuths can favor the wrong sign, so `gain`
    raises the share of particles of a light mode.
    """

    share: Array
    """share (2, M) of the weight"""
    cov: list[Array]
    """covariance (n, n, M) of each mode; without separate modes both are that of all particles"""
    separate: Mask
    """runs (M,) with two separate modes"""
    gain: Array
    """factor (2, M) on each mode's share of the particles"""

    @staticmethod
    def of_each(x: Array, values: Array) -> Array:
        """Return the value of each particle's mode (M, N), from the values (2, M) of both modes."""
        return np.where(x[1] > 0.0, values[0][:, None], values[1][:, None])

    def kernels(self, x: Array) -> list[Mode]:
        """Return a kernel for each mode of the particles, positive cross speeds first.

        Parameters
        ----------
        x : array (n, M, N)
            Particles in the line-of-sight frame of `los_rbpf._to_frame`, whose row 1 is the cross speed,
            m/s.

        Returns
        -------
        list of Mode
            Two kernels with their members (M, N), share (M,) of the weight and covariance (n, n, M). In
            a run without two separate modes both have the share 1 and the covariance of all particles.
        """
        up = x[1] > 0.0
        # In runs without two separate modes (`separate` is False) both signs have the kernel of all
        # particles: the share is 1, and both entries of `cov` are the covariance of all.
        shares = np.where(self.separate, self.share, 1.0)
        return [
            Mode(members=up, share=shares[0], cov=self.cov[0]),
            Mode(members=~up, share=shares[1], cov=self.cov[1]),
        ]


def split_by_cross_speed_sign(frame: Particles) -> CrossSpeedModes | None:
    """Split particles by the sign of their cross speed.

    Parameters
    ----------
    frame : Particles
        Particles x (4, M, N) in the line-of-sight frame of `los_rbpf._to_frame`, whose row 1 is the
        cross speed, m/s, with normalized weights w (M, N).

    Returns
    -------
    CrossSpeedModes or None
        Shares, covariances and gains of both signs. None if each run has particles of one sign.
    """
    up = frame.x[1] > 0.0
    if (up == up[:, :1]).all():
        return None
    # Share and moments of either sign.
    shares = []
    moments = []
    for side in (up, ~up):
        w = np.where(side, frame.w, 0.0)
        share_of_side = total(w)
        # All weights stay zero in a run without a particle on this side.
        normalized = w / np.maximum(share_of_side, 1e-300)[:, None]
        shares.append(share_of_side)
        moments.append(Particles(frame.x, normalized).moments())
    share = np.stack(shares)
    # Separate: m1 - m2 > 3 (s1 + s2) of the cross speeds, both with weight.
    distance = moments[0].mean[1] - moments[1].mean[1]
    deviations = np.sqrt(moments[0].cov[1, 1]) + np.sqrt(moments[1].cov[1, 1])
    separate = distance > _SEPARATION * deviations
    separate &= (share > 0.0).all(axis=0)
    # As long as both of two separate modes have noticeable weight, the sign is undecided, and each mode
    # gets at least a quarter of the particles, _MODE_FLOOR. The gain is the quotient of a mode's share
    # of the particles and its share of the weight.
    whole = combine(moments, share).cov
    is_undecided = separate & (share > _NEGLIGIBLE).all(axis=0)
    floored = np.clip(share, _MODE_FLOOR, 1.0 - _MODE_FLOOR)
    gain = np.where(is_undecided, floored / np.maximum(share, _NEGLIGIBLE), 1.0)
    covs = [np.where(separate, of_side.cov, whole) for of_side in moments]
    return CrossSpeedModes(share=share, cov=covs, separate=separate, gain=gain)
