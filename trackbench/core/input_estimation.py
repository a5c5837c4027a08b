"""Input estimation: how an unmodelled acceleration shows in the innovations of a quiescent filter.

One constant input u per axis that sets in after step t, for every t of a window at once (Bogler 1987;
Park, Seo & Lee 1995). If it did, the filter's error is ``M(t) u`` plus what it would have been::

    M^- = F M + g,   psi = H M^-,   L^-1 += psi^2 / S,   d += psi nu / S,   M = M^- - K psi

and ``u = L d`` with variance L; ``zeta = sum over axes d^2 L`` is chi-square of as many degrees of
freedom as there are axes if there is no input.

Axes: state component (2), axis of the plane, onset in the window (W), run (M). The middle one has
length one where the axes share their covariance.
"""

from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array, Index, Mask
from trackbench.core.distributions import Gaussian
from trackbench.core.kalman import Innovation
from trackbench.core.sums import total


class Hypotheses(NamedTuple):
    """``response`` M (2, A, W, M), ``information`` L^-1 (A, W, M) and ``score`` d (2, W, M).

    Slot ``t % W`` belongs to the onset after step t. ``since`` (M,) is the step of each run's last
    restart, before which there is no onset; -1 until the first step tells where the runs began.
    """

    response: Array
    information: Array
    score: Array
    since: Index

    @property
    def width(self) -> int:
        """Number of onsets W."""
        return self.score.shape[1]

    def update(
        self, k: int, F: Array, g: Array, posterior: Gaussian, innovation: Innovation, R: Array
    ) -> "Hypotheses":
        """Return the after step k of the quiescent filter, whose posterior and innovation are given."""
        F_, g_ = F[:, :, None, None, None], g[:, None, None, None]
        response = F_[:, 0] * self.response[0] + F_[:, 1] * self.response[1] + g_
        psi, S, nu = response[0], innovation.S[0, 0], innovation.nu[0]
        gain, precision = posterior.cov[:, 0] / R[0, 0], 1.0 / S  # K = P H' / R of the posterior
        missing = np.isnan(nu)
        if missing.any():  # a missing measurement has no gain and says nothing
            there = ~missing.any(axis=0)
            gain, precision, nu = (np.where(there, a, 0.0) for a in (gain, precision, nu))
        weight = precision[:, None] * psi
        return Hypotheses(
            response - gain[:, :, None] * psi,
            self.information + weight * psi,
            self.score + weight * nu[:, None],
            self.with_start(k).since,
        )

    def with_start(self, k: int) -> "Hypotheses":
        """Return hypotheses with ``since`` set, if step k is the first."""
        return self._replace(since=np.where(self.since < 0, k - 1, self.since))

    def add_onset(self, k: int) -> "Hypotheses":
        """Replace the oldest onset by the onset after step k; writes into arrays just made."""
        for array in (self.response, self.information, self.score):
            array[..., k % self.width, :] = 0.0
        return self

    def reset(self, where: Mask, k: int) -> "Hypotheses":
        """Clear the chosen runs, whose filters restart at step k."""
        if not where.any():
            return self
        return Hypotheses(
            np.where(where, 0.0, self.response),
            np.where(where, 0.0, self.information),
            np.where(where, 0.0, self.score),
            np.where(where, k, self.since),
        )

    def significance(self) -> Array:
        """Return zeta (W, M), zero where there is no information yet."""
        known = self.information > 0.0
        L = np.where(known, 1.0, 0.0) / np.where(known, self.information, 1.0)
        return total(np.square(self.score) * L, axis=0)

    def onset(self, slot: Index, k: int) -> Index:
        """Return the step t (M,) whose onset stands in each run's slot, seen from step k."""
        age = (k - 1 - slot) % self.width + 1
        return np.maximum(k - age, self.since)

    def slot_of(self, age: int, k: int) -> Index:
        """Return the slot (M,) of the onset so many steps before k, or since the restart."""
        return np.maximum(k - np.minimum(age, self.width), self.since) % self.width

    def select(self, slot: Index, runs: Index) -> "Input":
        """Return response and estimated input of ``runs`` (m,), each at its slot (m,)."""
        L = 1.0 / self.information[:, slot, runs]
        return Input(self.response[:, :, slot, runs], L * self.score[:, slot, runs], L)


class Input(NamedTuple):
    """M (2, A, m), u (2, m) and its variance L (A, m) of m runs."""

    response: Array
    u: Array
    variance: Array

    def correct(self, state: Gaussian) -> Gaussian:
        """Return ``N(x + M u, P + M L M')``: the quiescent state with the input's effect added."""
        M, L = self.response, self.variance
        return Gaussian(state.mean + M * self.u, state.cov + M[:, None] * L * M[None])

    def augment(self, state: Gaussian) -> Gaussian:
        """Return ``[x + M u; u]`` with ``[P + M L M', M L; L M', L]``: the input is a component."""
        moved, (M, u, L) = self.correct(state), self
        ML = np.broadcast_to(M * L, moved.cov[:, 0].shape)
        cov = np.concatenate(
            [
                np.concatenate([moved.cov, ML[:, None]], axis=1),
                np.concatenate([ML, np.broadcast_to(L, ML[0].shape)[None]])[None],
            ]
        )
        return Gaussian(np.concatenate([moved.mean, u[None]]), cov)


def empty_hypotheses(window: int, axes: int, runs: int) -> Hypotheses:
    """Return empty hypotheses; ``axes`` is the number with their own covariance (1 or 2)."""
    return Hypotheses(
        np.zeros((2, axes, window, runs)),
        np.zeros((axes, window, runs)),
        np.zeros((2, window, runs)),
        np.full(runs, -1),
    )
