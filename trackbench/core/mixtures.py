"""Mixtures of Gaussians: moments, density, and a prior that is a sum of several normal laws."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain, pairwise

import numpy as np

from trackbench.core import compiled, elementary, linalg
from trackbench.core.angles import mean_direction, near
from trackbench.core.arrays import Array, with_trailing
from trackbench.core.distributions import Gaussian, Symmetric
from trackbench.core.random_streams import Streams


def log_mixture(weights: Array, log_densities: Array) -> Array:
    """Return the log of a mixture of densities, from their logs.

    Parameters
    ----------
    weights : array (r, *batch)
        Weights of the r densities. A weight may be 0.
    log_densities : array (r, *batch)
        Log of each density.

    Returns
    -------
    array (*batch)
        Log of the weighted sum, -inf if every term is 0.
    """
    with np.errstate(divide="ignore"):
        terms = elementary.log(weights) + log_densities
    value = terms[0]
    for term in terms[1:]:
        value = elementary.logaddexp(value, term)
    return value


def combine(
    states: Sequence[Gaussian],
    weights: Array,
    without_spread: Sequence[Sequence[int]] = (),
    angles: Sequence[int] = (),
) -> Gaussian:
    """Combine a mixture of Gaussians to its moments.

    ``m = sum_j w_j m_j`` and ``P = sum_j w_j (P_j + (m_j - m) (m_j - m)')``.

    Parameters
    ----------
    states : sequence of Gaussian
        r states, means (n, M), covariances (n, n[, M]).
    weights : array (r, M)
        Their weights.
    without_spread : sequence of sequences of int
        Components of each state whose ``m_j - m`` is taken as zero; default: none. They are those that a
        model lacks, so that its state was filled up with zeros.
    angles : sequence of int
        Components that are angles: the means are first shifted by whole turns to within half a turn of
        their mean direction.

    Returns
    -------
    Gaussian
        Mean (n, M) and covariance (n, n, M).
    """
    if angles:
        states = brought_together(states, weights, angles)
    terms = list(zip(weights, states, strict=True))
    # m = sum_j w_j m_j
    mean = np.asarray(sum(w * s.mean for w, s in terms))
    cov = np.zeros((len(mean), *mean.shape))
    # P = sum_j w_j (P_j + e e') with e = m_j - m
    for j, (w, s) in enumerate(terms):
        kernels = None if without_spread else compiled.kernels
        # The kernel adds the term to cov, unless it cannot read the memory of an argument.
        if kernels and kernels.mix(w, s.mean, s.cov, mean, cov):
            continue
        e = s.mean - mean
        if without_spread:
            e[list(without_spread[j])] = 0.0
        cov += w * (with_trailing(s.cov, 1, leading=2) + linalg.outer(e, e))
    return Gaussian(mean, cov)


def brought_together(
    states: Sequence[Gaussian], weights: Array, angles: Sequence[int]
) -> list[Gaussian]:
    """Shift the angles of r means by whole turns to within half a turn of their mean direction.

    Parameters
    ----------
    states : sequence of Gaussian
        r states, means (n, M), covariances (n, n[, M]).
    weights : array (r, M)
        Their weights.
    angles : sequence of int
        Components that are angles, rad.

    Returns
    -------
    list of Gaussian
        The states with shifted means. The mean direction is on the turn of the first mean. Covariances
        stay as they are.
    """
    means = np.stack([state.mean for state in states], axis=-1)
    center = mean_direction(means, weights.T, states[0].mean, angles)
    return [Gaussian(near(state.mean, center, angles), state.cov) for state in states]


@dataclass(frozen=True)
class GaussianMixture(Symmetric):
    """A mixture, in each of M runs, of r Gaussians with weights (r,), means (n,), covariances (n, n).

    All runs have the same weights, means and covariances.
    """

    weights: Array
    parts: tuple[Gaussian, ...]
    runs: int

    @cached_property
    def _moments(self) -> Gaussian:
        states = [Gaussian(component.mean[:, None], component.cov) for component in self.parts]
        return combine(states, self.weights[:, None])

    @property
    def mean(self) -> Array:
        """Mean (n, M)."""
        return np.tile(self._moments.mean, (1, self.runs))

    @property
    def cov(self) -> Array:
        """Covariance (n, n)."""
        return self._moments.cov[..., 0]

    @property
    def mode(self) -> Array:
        """Mean of the part at whose mean the density is highest, for each run (n, M)."""
        # The parts' means (n,) are points; `log_prob` takes them as (n, 1).
        heights = [float(self.log_prob(part.mean[:, None])[0]) for part in self.parts]
        highest = self.parts[int(np.argmax(heights))]
        return np.tile(highest.mean[:, None], (1, self.runs))

    def sample(self, rng: Streams, *trailing: int) -> Array:
        """Draw the part of each state, then the state (n, M, *trailing).

        All runs have the same parts, with means (n,), and the same weights (r,).
        """
        u = rng.random((self.runs, *trailing))
        # Each part draws all the states (n, M, *trailing). A state is that of part j if its u is between
        # the sums of the weights before part j and up to it.
        x = self.parts[0].sample(rng, self.runs, *trailing)
        below = self.weights[0]
        for weight, part in zip(self.weights[1:], self.parts[1:], strict=True):
            x = np.where(u >= below, part.sample(rng, self.runs, *trailing), x)
            below = below + weight
        return x

    def log_prob(self, x: Array) -> Array:
        """Compute ``log sum_j w_j N(x; m_j, P_j)``."""
        axes = x.ndim - 1
        logs = [Gaussian(with_trailing(p.mean, axes), p.cov).log_prob(x) for p in self.parts]
        return log_mixture(with_trailing(self.weights, axes), np.stack(logs))

    def intervals(self, deviations: float) -> list[tuple[Array, Array]]:
        """Return disjoint intervals of a scalar within so many deviations of the means.

        They end wherever a part's does, so that nodes resolve a narrow part within a wide one. All runs
        have the same parts, with means (1,) and covariances (1, 1).

        Parameters
        ----------
        deviations : float
            Reach of each part to both sides of its mean, in its standard deviations.

        Returns
        -------
        list of (array (M,), array (M,))
            Lower and upper end of each interval for each run, in order. Intervals may touch.
        """
        reach = [deviations * float(np.sqrt(part.cov[0, 0])) for part in self.parts]
        ends = [(p.mean[0] - r, p.mean[0] + r) for p, r in zip(self.parts, reach, strict=True)]
        cuts = sorted({float(end) for end in chain.from_iterable(ends)})
        intervals = []
        for a, b in pairwise(cuts):
            if any(low <= a and b <= high for low, high in ends):
                intervals.append((np.full(self.runs, a), np.full(self.runs, b)))
        return intervals
