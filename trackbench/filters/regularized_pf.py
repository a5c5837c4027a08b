"""Regularized particle filters: resample from a kernel density, or jitter the copies alone."""

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from trackbench.core import particle_diagnostics
from trackbench.core.angles import bring_together
from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.core.particles import Particles
from trackbench.core.regularization import Kernel, bandwidth, jitter, jitter_if_measured
from trackbench.field_types import NonNegative
from trackbench.filters.bootstrap_pf import PF
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


@register("filters", "jitter-pf")
@dataclass(frozen=True, kw_only=True)
class JitterPF(PF):
    """Bootstrap filter that moves the copies of a particle apart after resampling.

    Post-regularization (Musso et al. 2001) of the copies alone, as in ``PartFilt`` of DAPPER.
    """

    bandwidth_scale: NonNegative = 1.0
    """factor on the optimal bandwidth of a Gaussian kernel"""

    def _after_resampling(
        self, cloud: Particles, resampled: Particles, rng: Generator
    ) -> Particles:
        """Add noise of the particles' covariance to each particle that equals a neighbor."""
        # Step 1: unbiased covariance P / (1 - sum w^2); where one particle has all the weight it would
        # be 0 / 0, and is that of equal weights.
        has_several = 1.0 - 1.0 / particle_diagnostics.effective_sample_size(cloud.w) > 1e-10
        w = np.where(has_several[:, None], cloud.w, 1.0 / cloud.w.shape[1])
        biased = Particles(cloud.x, w).moments().cov
        P = biased / (1.0 - 1.0 / particle_diagnostics.effective_sample_size(w))
        # Step 2: add scale h e, e ~ N(0, P), to the copies.
        n, _, size = resampled.x.shape  # x is (n, M, size)
        h = self.bandwidth_scale * bandwidth(n, size, "gaussian")
        e = Gaussian(np.zeros(P.shape[1:]), P).sample(rng, size)
        # Resampling puts copies side by side, and they have equal first components.
        first = resampled.x[0]
        is_copy = (first == np.roll(first, 1, axis=-1)) | (first == np.roll(first, -1, axis=-1))
        return resampled._replace(x=np.where(is_copy, resampled.x + h * e, resampled.x))
