"""Base of the filters whose state is equally weighted draws: members, mean, covariance."""

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
from annotated_types import Ge
from numpy.random import Generator

from trackbench.core.angles import mean_direction, near
from trackbench.core.arrays import Array
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.core.kalman import Innovation
from trackbench.core.particle_weights import equal_weights
from trackbench.core.particles import Particles
from trackbench.core.posterior_scores import ParticlePosterior, Posterior
from trackbench.core.sums import dot, mean
from trackbench.filters.base import InnovationFilter
from trackbench.models.base import Model


class Ensemble(NamedTuple):
    """State of an ensemble filter: members of equal weight."""

    x: Array
    """members (n, M, N)"""
    nis: Array
    """NIS (M,) of the last measurement"""
    innovation: Innovation | None = None
    """innovation of the last measurement"""
    predicted: Array | None = None
    """members (n, M, N) before the last measurement"""


@dataclass(frozen=True, kw_only=True)
class EnsembleFilter(InnovationFilter[Ensemble]):
    """Base of the filters whose state is equally weighted draws."""

    N: Annotated[int, Ge(2)] = 100
    """number of members"""

    def init(self, model: Model, prior: Distribution, rng: Generator) -> Ensemble:
        """Draw the members from the prior."""
        x = prior.sample(rng, self.N)
        return Ensemble(x, np.full(x.shape[1], np.nan))

    def estimate(self, state: Ensemble) -> Gaussian:
        """Return the mean and the sample covariance of the members."""
        m = mean(state.x)
        e = state.x - m[..., None]
        return Gaussian(m, members_cov(e, e))

    def posterior(self, state: Ensemble) -> Posterior:
        """Return the members."""
        return ParticlePosterior(Particles(state.x, equal_weights(*state.x.shape[1:])))


def members_together(x: Array, angles: tuple[int, ...]) -> tuple[Array, Array]:
    """Shift angles of the members by whole turns so that they are near each other.

    Parameters
    ----------
    x : array (n, M, N)
        Members.
    angles : tuple of int
        Rows of x that are angles, rad, as `angle_rows` returns them; empty for none.

    Returns
    -------
    together : array (n, M, N)
        Members. Their angles are within half a turn of the middle.
    middle : array (n, M)
        Mean of the members, or of an angle the mean direction.
    """
    if not angles:
        return x, mean(x)
    w = equal_weights(*x.shape[1:])
    middle = mean_direction(x, w, mean(x), angles)
    together = near(x, middle[..., None], angles)
    rows = list(angles)
    middle_of_all = mean(together)
    middle_of_all[rows] = middle[rows]
    return together, middle_of_all


def members_cov(a: Array, b: Array) -> Array:
    """Return the sample covariance of two sets of deviations, with the divisor N - 1.

    Parameters
    ----------
    a : array (n, M, N)
        Deviations of the members from their mean, such as those of the states.
    b : array (m, M, N)
        Deviations of the same members, such as those of their measurements.

    Returns
    -------
    array (n, m, M)
        Covariance of a and b.
    """
    return np.stack([dot(row, b) for row in a]) / (a.shape[-1] - 1.0)
