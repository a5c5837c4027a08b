"""Regularized particle filter: resamples from a kernel density."""

from dataclasses import dataclass

from numpy.random import Generator

from trackbench.core.angles import bring_together
from trackbench.core.arrays import Array
from trackbench.core.particles import Particles
from trackbench.core.regularization import Kernel, jitter, jitter_if_measured
from trackbench.field_types import NonNegative
from trackbench.filters.particle_base import PFState
from trackbench.filters.particle_smoother import SimulatingSmoother
from trackbench.models.base import Model, angle_rows
from trackbench.registry import register


@register("filters", "rpf")
@dataclass(frozen=True, kw_only=True)
class RPF(SimulatingSmoother):
    """Regularized particle filter: resamples from a kernel density of the posterior.

    Musso, Oudjane & Le Gland 2001, section 12.2 (post-regularization).
    """

    kernel: Kernel = "epanechnikov"
    """regularization kernel"""
    bandwidth_scale: NonNegative = 1.0
    """factor on the optimal bandwidth; 0 is plain resampling"""

    def step(self, model: Model, state: PFState, z: Array, k: int, rng: Generator) -> PFState:
        """Predict, weigh, resample, jitter."""
        # Step 1: draw each particle from the transition.
        x = model.motion.transition(state.particles.x, k).sample(rng)
        # Step 2: weigh by the likelihood. Angles that differ by whole turns are brought together, before
        # they are averaged.
        w, collapsed, evidence = self._weigh(model, state, z, x, k)
        weighted = bring_together(Particles(x, w), angle_rows(model.motion))
        moments = weighted.moments()
        # Step 3: resample, and add h A e: e from the kernel, A A' the covariance of the particles.
        # The number of particles depends on the number of steps done: the first ones may have more
        # (`boost`).
        age = state.age + 1
        resampled = self._resample(weighted, rng, self._particle_count_after(age))
        jittered = jitter(resampled.x, moments.cov, self.kernel, rng, self.bandwidth_scale)
        x = jitter_if_measured(z, resampled.x, jittered)
        return PFState(
            particles=Particles(x, resampled.w),
            averaged_particles=weighted,
            estimate=moments,
            collapsed=collapsed,
            age=age,
            w=w,
            evidence=evidence,
        )
