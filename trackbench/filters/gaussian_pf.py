"""Gaussian particle filter: weighted draws from a Gaussian, without resampling."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Ge
from numpy.random import Generator

from trackbench.core import particle_weights
from trackbench.core.angles import bring_together
from trackbench.core.arrays import Array
from trackbench.core.distributions import Distribution
from trackbench.core.particle_weights import Evidence
from trackbench.core.particles import Particles
from trackbench.filters.particle_base import PFState, WeightedParticlesFilter
from trackbench.models.base import Model, angle_rows
from trackbench.models.first_particles import draw_covering
from trackbench.models.likelihood import log_likelihood
from trackbench.registry import register


@register("filters", "gpf")
@dataclass(frozen=True, kw_only=True)
class GaussianPF(WeightedParticlesFilter):
    """Gaussian particle filter: draws from a Gaussian at each step, and resamples nothing.

    Kotecha & Djuric 2003a. The posterior is assumed Gaussian, with the moments of N weighted draws.
    """

    N: Annotated[int, Ge(2)] = 100
    """number of particles"""

    def init(self, model: Model, prior: Distribution, rng: Generator) -> PFState:
        """Draw from the prior and take the moments."""
        x, log_w = draw_covering(prior, rng, self.N)
        return _state_of_draws(x, log_w)

    def step(self, model: Model, state: PFState, z: Array, k: int, rng: Generator) -> PFState:
        """Draw from the Gaussian, move, weigh, take the moments."""
        before = state.estimate.sample(rng, self.N)
        x = model.motion.transition(before, k).sample(rng)
        log_w = log_likelihood(model.sensor, z, x, k)
        return _state_of_draws(x, log_w, angle_rows(model.motion))


def _state_of_draws(x: Array, log_w: Array, angles: tuple[int, ...] = ()) -> PFState:
    """Return the state whose particles are the draws x (n, M, N) with log-weights (M, N).

    ``angles`` are the components that are angles: whole turns between them are removed before they are
    averaged.
    """
    # A log-weight that all particles share is broadcast to (M, N) first.
    w, collapsed, sum_of_weights = particle_weights.normalize(np.broadcast_to(log_w, x.shape[1:]))
    cloud = bring_together(Particles(x, w), angles)
    return PFState(
        particles=cloud,
        averaged_particles=cloud,  # the particles whose mean is the estimate: nothing is resampled
        estimate=cloud.moments(),
        collapsed=collapsed,
        w=w,
        # For p(z_k | z_1..k-1): the mean of N weights. `carried` are the log-weights before the update;
        # 0.0 stands for equal ones.
        evidence=(Evidence(sum_of_weights, carried=0.0, N=w.shape[1]),),
    )
