"""Input estimation: the effect of an unmodeled acceleration on the innovations of a quiescent filter.

One constant input u per axis sets in after step t, for every t of a window at once (Bogler 1987; Park,
Seo & Lee 1995). The filter's error is then ``M(t) u`` plus the error without an input::

    M^- = F M + g,   psi = H M^-,   L^-1 += psi^2 / S,   d += psi nu / S,   M = M^- - K psi

and ``u = L d`` with variance L. Without an input, ``zeta = sum over axes d^2 L`` is chi-square with as
many degrees of freedom as there are axes.

Array axes: state component (2), axis of the plane (A), onset in the window (W), run (M). A is one where
the axes share their covariance.
"""

from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array, Index, Mask, any_nan
from trackbench.core.distributions import Gaussian
from trackbench.core.kalman import Innovation
from trackbench.core.sums import total


class Hypotheses(NamedTuple):
    """Hypotheses of an input's onset after each step of a window.

    ``response`` M (2, A, W, M), ``information`` L^-1 (A, W, M), ``score`` d (2, W, M). Slot ``t % W``
    belongs to the onset after step t. ``since`` (M,) is the step of each run's last restart, the
    earliest possible onset; it is -1 before the first step.
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
        """Update every onset's response and least squares after step k of the quiescent filter.

        The quiescent filter is the one whose motion has no input. F (2, 2), g (2,) and R (1, 1) are
        transition, effect of a unit input on position and velocity, and measurement noise of one axis.
        The filter's posterior has a covariance (2, 2, A, M), its innovation nu (1, 2, M) and
        S (1, 1, A, M); nu is NaN if a run has no measurement. A is 1 if both axes of the plane share
        their covariance, else 2. For each of W onsets there are the response M (2, A, W, M) of position
        and velocity, the information L^-1 (A, W, M) and the score d (2, W, M).
        """
        # Step 1: M^- = F M + g, psi = H M^- with H = [1 0].
        F_ = F[:, :, None, None, None]
        g_ = g[:, None, None, None]
        response = F_[:, 0] * self.response[0]
        response += F_[:, 1] * self.response[1]
        response += g_
        psi = response[0]  # (A, W, M)
        S = innovation.S[0, 0]  # (A, M)
        nu = innovation.nu[0]  # (2, M)
        # Step 2: K = P H' / R of the posterior; a missing measurement has no gain and no information.
        gain = posterior.cov[:, 0] / R[0, 0]
        precision = 1.0 / S
        if any_nan(nu):
            measured = ~np.isnan(nu).any(axis=0)
            gain, precision, nu = (np.where(measured, a, 0.0) for a in (gain, precision, nu))
        # Step 3: L^-1 += psi^2 / S, d += psi nu / S, M = M^- - K psi.
        weight = precision[:, None] * psi
        information = weight * psi
        score = weight * nu[:, None]
        information += self.information
        score += self.score
        response -= gain[:, :, None] * psi
        return Hypotheses(
            response=response,
            information=information,
            score=score,
            since=self.with_start(k).since,  # the earliest possible onset
        )

    def with_start(self, k: int) -> "Hypotheses":
        """Set ``since`` to step k - 1 in the runs whose first step is k; it is -1 before."""
        return self._replace(since=np.where(self.since < 0, k - 1, self.since))

    def add_onset(self, k: int) -> "Hypotheses":
        """Replace the oldest onset by the onset after step k; the arrays are changed in place.

        Each of the last W = `width` onsets has a slot of the second last axis, in which the onset after
        step k has the index ``k % W``.
        """
        for array in (self.response, self.information, self.score):
            array[..., k % self.width, :] = 0.0
        return self

    def reset(self, where: Mask, k: int) -> "Hypotheses":
        """Clear the runs that the mask ``where`` (M,) marks, whose filters restart at step k."""
        if not where.any():
            return self
        return Hypotheses(
            response=np.where(where, 0.0, self.response),
            information=np.where(where, 0.0, self.information),
            score=np.where(where, 0.0, self.score),
            since=np.where(where, k, self.since),
        )

    def significance(self) -> Array:
        """Return the statistic zeta (W, M) of an input that sets in at each of the W onsets.

        Without an input it is chi-square with as many degrees of freedom as there are axes. It is zero
        where there is no information yet.
        """
        # zeta = sum over the axes of d^2 L, with the score d and the variance L of the estimated input
        L = 1.0 / np.where(self.information > 0.0, self.information, np.inf)
        square = np.square(self.score)
        square *= L
        return total(square, axis=0)

    def onset(self, slot: Index, k: int) -> Index:
        """Return the step t (M,) after which the input of each run's ``slot`` (M,) sets in, at step k.

        It is not before the run's last restart.
        """
        # Age of the slot in the ring of W onsets, 1 ... W.
        age = (k - 1 - slot) % self.width + 1
        return np.maximum(k - age, self.since)

    def slot_of(self, age: int, k: int) -> Index:
        """Return the slot (M,) of the onset ``age`` steps before k, or of the restart if it is later."""
        return np.maximum(k - np.minimum(age, self.width), self.since) % self.width

    def select(self, slot: Index, runs: Index) -> "Input":
        """Return response and estimated input of ``runs`` (m,), each for the onset in its slot (m,).

        Information L^-1 and score d have the array axes (axis of the plane, onset, run). The response
        has that of the state's components before these. Each axis of the plane has an input u and a
        score of its own; the variance L may be one for both.
        """
        # Least squares: u = L d with the variance L
        L = 1.0 / self.information[:, slot, runs]
        return Input(self.response[:, :, slot, runs], L * self.score[:, slot, runs], L)


class Input(NamedTuple):
    """Response M (2, A, m), input u (2, m) and its variance L (A, m) of m runs.

    A is 1 if both axes of the plane share their covariance, else 2.
    """

    response: Array
    u: Array
    variance: Array

    def correct(self, state: Gaussian) -> Gaussian:
        """Correct the quiescent state by the input's effect: ``N(x + M u, P + M L M')``.

        M (2, A, m) is ``response``, u (2, m) the input, and L (A, m) its ``variance``.
        ``state`` has the mean x (2, 2, m), component by axis, and the covariance P (2, 2, A, m). A is 1
        if both axes share their covariance, else 2.
        """
        M = self.response
        L = self.variance
        return Gaussian(state.mean + M * self.u, state.cov + M[:, None] * L * M[None])

    def augment(self, state: Gaussian) -> Gaussian:
        """Add the input as a component: ``[x + M u; u]`` with ``[P + M L M', M L; L M', L]``.

        M (2, A, m) is ``response``, u (2, m) the input, and L (A, m) its ``variance``.
        ``state`` has the mean x (2, 2, m), component by axis, and the covariance P (2, 2, A, m). A is 1
        if both axes share their covariance, else 2.
        """
        corrected = self.correct(state)
        M, u, L = self
        ML = np.broadcast_to(M * L, corrected.cov[:, 0].shape)
        # Stack the blocks [P + M L M', M L] and [L M', L].
        upper = np.concatenate([corrected.cov, ML[:, None]], axis=1)
        lower = np.concatenate([ML, np.broadcast_to(L, ML[0].shape)[None]])[None]
        mean = np.concatenate([corrected.mean, u[None]])
        return Gaussian(mean, np.concatenate([upper, lower]))


def empty_hypotheses(window: int, axes: int, runs: int) -> Hypotheses:
    """Return hypotheses without information for a window of so many onsets in each of the runs.

    ``axes`` is 1 if both axes of the plane share their covariance, else 2.
    """
    return Hypotheses(
        response=np.zeros((2, axes, window, runs)),  # of position and velocity
        information=np.zeros((axes, window, runs)),
        score=np.zeros((2, window, runs)),  # of both axes of the plane
        since=np.full(runs, -1),  # earliest possible onset: -1 before the first step
    )
