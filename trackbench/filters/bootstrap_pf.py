"""Bootstrap (SIR) particle filter, which proposes from the transition."""

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Interval
from numpy.random import Generator

from trackbench.core import elementary, particle_diagnostics
from trackbench.core.angles import bring_together
from trackbench.core.arrays import Array
from trackbench.core.metropolis_hastings import independence_moves
from trackbench.core.particles import Particles
from trackbench.field_types import Natural
from trackbench.filters.particle_base import ParticleFilter, PFState
from trackbench.filters.particle_smoother import SimulatingSmoother
from trackbench.models.base import Model, angle_rows
from trackbench.registry import register


@register("filters", "pf")
@dataclass(frozen=True, kw_only=True)
class PF(SimulatingSmoother):
    """Bootstrap (SIR) particle filter: prior proposal, weights from the likelihood.

    Gordon, Salmond & Smith 1993; hdepf paper, eqs. 6-8.
    """

    ess_threshold: Annotated[float, Interval(gt=0, le=1)] = 1.0
    """resample a run when its effective sample size is below this share of N; 1 is every step"""
    moves: Natural = 0
    """Metropolis-Hastings steps of each particle after resampling, drawn from its parent's transition"""
    estimate_from: Literal["weighted", "resampled"] = "weighted"
    """particles the estimate is taken from: before resampling, or after it and the moves (demo)"""
    diagnostic_names = ParticleFilter.diagnostic_names | {"distinct_particles"}

    def step(self, model: Model, state: PFState, z: Array, k: int, rng: Generator) -> PFState:
        """Predict, weigh, resample, move."""
        # Step 1: draw each particle from the transition, x_k ~ p(x_k | x_{k-1}).
        parents = state.particles.x
        x = model.motion.transition(parents, k).sample(rng)
        # Step 2: weigh by the likelihood, w_k = w_{k-1} p(z_k | x_k): the transition is the proposal.
        if self.ess_threshold < 1.0:
            # Runs that were not resampled carry their weights on: `_weigh` adds `log_w` to the
            # log-likelihoods.
            state = state._replace(log_w=elementary.log(state.particles.w))
        w, collapsed, evidence = self._weigh(model, state, z, x, k)
        # Angles that differ by whole turns are brought together before they are averaged.
        angles = angle_rows(model.motion)
        weighted = bring_together(Particles(x, w), angles)
        # Step 3: resample: draw particle i with probability w_k^i, with equal weights afterwards.
        size = self._particle_count_after(state.age + 1)
        if self.moves:
            # Step 4: move. A move needs the parent, which is resampled with its child as one state.
            families = Particles(np.concatenate((weighted.x, parents)), w)
            families = self._resample_if_needed(families, rng, size)
            resampled = bring_together(self._move(model, families, z, k, rng), angles)
        else:
            resampled = self._resample_if_needed(weighted, rng, size)
        averaged = weighted if self.estimate_from == "weighted" else resampled
        return PFState(
            particles=resampled,
            averaged_particles=averaged,
            estimate=averaged.moments(),
            collapsed=collapsed,
            age=state.age + 1,
            w=w,  # those before resampling, for the effective sample size
            evidence=evidence,
        )

    def diagnostics(self, state: PFState) -> dict[str, Array]:
        """Report also ``distinct_particles``: share of particles that are no copies after resampling."""
        # Copies have equal first components, and stand side by side.
        distinct = particle_diagnostics.distinct_share(state.particles.x[0])
        return super().diagnostics(state) | {"distinct_particles": distinct}

    def _resample_if_needed(self, cloud: Particles, rng: Generator, size: int) -> Particles:
        """Resample the runs whose effective sample size is below the threshold.

        ``cloud`` are the particles x (n, M, N) with weights w (M, N), and ``size`` is their number from
        now on.
        """
        resampled = self._resample(cloud, rng, size)
        # All runs are resampled if the number of particles changes.
        if self.ess_threshold < 1.0 and size == cloud.w.shape[1]:
            # Runs with a large effective sample size keep their weighted particles.
            ess = particle_diagnostics.effective_sample_size(cloud.w)
            keep = (ess >= self.ess_threshold * size)[:, None]
            resampled = Particles(
                np.where(keep, cloud.x, resampled.x), np.where(keep, cloud.w, resampled.w)
            )
        # A subclass may add noise to the copies.
        return self._after_resampling(cloud, resampled, rng)

    def _after_resampling(
        self, cloud: Particles, resampled: Particles, rng: Generator
    ) -> Particles:
        """Return the particles after resampling; ``cloud`` are those before it.

        A hook, in which `JitterPF` adds noise to copies.
        """
        return resampled

    def _move(
        self, model: Model, families: Particles, z: Array, k: int, rng: Generator
    ) -> Particles:
        """Move resampled particles by Metropolis-Hastings steps, with draws from the transition.

        ``families`` (2 n, M, N) has the particles, and below them their parents of step k - 1, from
        which the transition starts.
        """
        # The transition from the parents is both proposal and prior, so that they cancel, and only the
        # likelihoods are compared.
        children, parents = np.split(families.x, 2)
        transition = model.motion.transition(parents, k)

        def log_ratio(x: Array) -> Array:
            return self._log_likelihood(model, z, x, k)

        moved = independence_moves(children, transition.sample, log_ratio, self.moves, rng)
        return Particles(moved, families.w)
