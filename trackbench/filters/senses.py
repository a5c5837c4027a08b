"""A cloud in the line-of-sight frame by its sense of the cross speed, the second component."""

from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array, Mask
from trackbench.core.mixing import combined
from trackbench.core.particles import Particles
from trackbench.core.regularisation import Mode
from trackbench.core.sums import total

_LEAST = 0.25  # of the particles for either mode
_SETTLED = 1e-6  # share of the weight of a mode that is given up
_APART = 3.0  # modes of the cross speed: distance of their means in sums of their deviations


class Senses(NamedTuple):
    """A cloud by its sense across the line of sight: shares of the weight (2, M), covs, gains (2, M).

    A range tells the square of the cross speed: until the azimuths tell its sign the cloud has two
    modes, and a kernel as wide as both would undo what the ranges have told. A cloud that is not
    clearly two (M,) is one, half of which stands on either side. ``gain`` is by how much more than its
    share of the particles a sense is given: a few bad azimuths speak for the wrong one, and of the few
    that would be left of the other none need be where the target is.
    """

    share: Array
    cov: list[Array]
    two: Mask
    gain: Array

    @staticmethod
    def of(x: Array, numbers: Array) -> Array:
        """The number (2, M) of each particle's own sense (M, N)."""
        return np.where(x[1] > 0.0, numbers[0][:, None], numbers[1][:, None])

    def modes(self, x: Array) -> list[Mode]:
        """Modes of the particles x (n, M, N)."""
        up = x[1] > 0.0
        shares = np.where(self.two, self.share, 1.0)
        return [Mode(up, shares[0], self.cov[0]), Mode(~up, shares[1], self.cov[1])]


def senses_of(frame: Particles) -> Senses | None:
    """The weighted cloud in either sense; None if all of it is on one side."""
    one_way = frame.x[1] > 0.0
    if (one_way == one_way[:, :1]).all():
        return None
    weights = [np.where(side, frame.w, 0.0) for side in (one_way, ~one_way)]
    share = np.stack([total(w) for w in weights])
    parts = [
        Particles(frame.x, w / np.maximum(part, 1e-300)[:, None]).moments()
        for w, part in zip(weights, share, strict=True)
    ]
    up, down = parts
    apart = up.mean[1] - down.mean[1]
    two = apart > _APART * (np.sqrt(up.cov[1, 1]) + np.sqrt(down.cov[1, 1]))
    two &= (share > 0.0).all(axis=0)
    whole = combined(parts, share).cov
    undecided = two & (share > _SETTLED).all(axis=0)
    wanted = np.clip(share, _LEAST, 1.0 - _LEAST)
    gain = np.where(undecided, wanted / np.maximum(share, _SETTLED), 1.0)
    return Senses(share, [np.where(two, part.cov, whole) for part in parts], two, gain)
