"""Gaussian particle filter: a Gaussian between the steps, particles within each."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Ge
from numpy.random import Generator

from trackbench.core import particles
from trackbench.core.arrays import Array
from trackbench.core.distributions import Distribution, covering
from trackbench.core.particles import Evidence, Particles
from trackbench.filters.clouds import Cloud, CloudFilter
from trackbench.models.base import Model, log_likelihood
from trackbench.registry import register


@register("filters", "gpf")
@dataclass(frozen=True, kw_only=True)
class GaussianPF(CloudFilter):
    """Gaussian particle filter: draws anew from a Gaussian at each step, so that nothing is resampled.

    Kotecha & Djuric 2003a. The moments are as right as N draws make them; that the posterior has no
    other shape is assumed.
    """

    N: Annotated[int, Ge(2)] = 100
    """number of particles"""

    def init(self, model: Model, prior: Distribution, rng: Generator) -> Cloud:
        """The moments of draws from the prior."""
        x, log_w = covering(prior, rng, self.N)
        return _fitted(x, log_w)

    def step(self, model: Model, state: Cloud, z: Array, k: int, rng: Generator) -> Cloud:
        """Draw, move, weigh, and keep the moments."""
        x = model.motion.transition(state.estimate.sample(rng, self.N), k).sample(rng)
        return _fitted(x, log_likelihood(model.sensor, z, x, k))


def _fitted(x: Array, log_w: Array) -> Cloud:
    """Draws (n, M, N) and log-weights (M, N)."""
    w, dead, mass = particles.normalise(np.broadcast_to(log_w, x.shape[1:]))
    cloud = Particles(x, w)
    told = (Evidence(mass, 0.0, w.shape[1]),)
    return Cloud(cloud, cloud, cloud.moments(), dead, w=w, evidence=told)
