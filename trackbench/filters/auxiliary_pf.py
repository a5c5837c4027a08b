"""Auxiliary particle filter: picks ancestors by how well they predict the measurement."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.random import Generator

from trackbench.core import elementary, particle_weights, resampling
from trackbench.core.angles import bring_together
from trackbench.core.arrays import Array
from trackbench.core.particle_weights import Evidence, read_likelihood
from trackbench.core.particles import Particles
from trackbench.core.resampling import select
from trackbench.filters.particle_base import PFState
from trackbench.filters.particle_smoother import SimulatingSmoother
from trackbench.models.base import Model, Scene, angle_rows
from trackbench.registry import register


@register("filters", "apf")
@dataclass(frozen=True, kw_only=True)
class APF(SimulatingSmoother):
    """Auxiliary particle filter: picks ancestors by how well they predict the measurement.

    Pitt & Shephard 1999 (``stages: 2``); with one stage Carpenter, Clifford & Fearnhead 1999.
    """

    first_stage: Literal["mean", "mode", "sample"] = "mean"
    """point mu of an ancestor's transition density at which its likelihood is evaluated; where its noise
    is wide beside the likelihood, the mean loses modes, however many particles there are"""
    carried: Literal["log", "float64"] | None = None
    """weights that the next step starts from: logarithms, or normalized in float64, where small ones
    are zero; default: log with `weights: log`, else float64"""
    stages: Literal[1, 2] = 1
    """resampling stages of a step: 1 carries the second-stage weights on; 2 resamples by them as well"""

    def idle_keys(self, scenario: Scene) -> dict[str, str]:
        """Report ``carried`` as idle if the second stage leaves equal weights."""
        idle = super().idle_keys(scenario)
        if self.stages == 2:
            idle["carried"] = "with `stages: 2`"
        return idle

    def step(self, model: Model, state: PFState, z: Array, k: int, rng: Generator) -> PFState:
        """Choose ancestors by p(z|mu), move them, weigh by p(z|x) / p(z|mu)."""
        cloud = state.particles
        size = self._particle_count_after(state.age + 1)
        # First stage: resample the ancestors by w p(z|mu). A particle's mu is a likely next state, such
        # as the mean of the transition.
        mu = self._characteristic(model, cloud.x, k, rng)
        log_p_mu = self._log_likelihood(model, z, mu, k)
        chosen = particle_weights.normalize(self._in_arithmetic(log_p_mu + state.log_w))
        # Where every first-stage weight is zero, p(z|mu) counts as flat.
        log_p_mu = np.where(chosen.collapsed[:, None], 0.0, log_p_mu)
        index = resampling.ancestors(chosen.w, rng, self.resampling, size)
        # Second stage: draw from the transition, weigh by p(z|x) / p(z|mu), mu of the particle's
        # ancestor.
        x = model.motion.transition(select(cloud.x, index), k).sample(rng)
        log_w = self._log_likelihood(model, z, x, k) - select(log_p_mu, index)
        w, collapsed, sum_of_weights = particle_weights.normalize(log_w)
        weighted = bring_together(Particles(x, w), angle_rows(model.motion))
        new = PFState(
            particles=weighted,
            averaged_particles=weighted,
            estimate=weighted.moments(),
            collapsed=collapsed,
            age=state.age + 1,
            w=w,
            # p(z_k | z_1..k-1) is the product of both stages' mean weights.
            evidence=(
                Evidence(chosen.mass, carried=state.log_w, N=log_p_mu.shape[1]),
                Evidence(sum_of_weights, carried=0.0, N=w.shape[1]),
            ),
        )
        # The weights are carried on to the next step, or the particles are resampled by them.
        if self.stages == 2:
            resampled = self._resample(weighted, rng, size)
            return new._replace(particles=resampled)
        if self._carries_float64:
            # The normalized weights, of which small ones are zero; a run with weight collapse has equal
            # ones already.
            return new._replace(log_w=elementary.log(w))
        # The logarithms, in which no weight is too small; equal ones after a weight collapse.
        return new._replace(log_w=np.where(collapsed[:, None], 0.0, log_w))

    def log_likelihood(self, state: PFState) -> Array:
        """Return the log-product (M,) of both stages' mean weights (Pitt 2002, section 2.2)."""
        if not state.evidence:
            return np.full(state.collapsed.shape, np.nan)
        first, second = (stage.log for stage in state.evidence)
        # Where all first-stage weights were zero, p(z|mu) counted as flat.
        return np.where(first == -np.inf, 0.0, first) + second

    @property
    def _carries_float64(self) -> bool:
        """True if the next step starts from weights in float64, not from logarithms."""
        carried = self.carried or ("log" if self.weights == "log" else "float64")
        return carried == "float64"

    def _in_arithmetic(self, log_w: Array) -> Array:
        """Return first-stage log-weights (M, N), with -inf for those that are zero in float64.

        That reproduces programs which multiply weights and likelihoods as float64 numbers. They are
        unchanged if the likelihood (key ``weights``) or the weights of the step before (key ``carried``)
        are logarithms, which have no smallest number.
        """
        if self._carries_float64 and self.weights != "log":
            # The arithmetic "naive" is exp() in float64, zero below 5e-324.
            return read_likelihood(log_w, "naive")
        return log_w

    def _characteristic(self, model: Model, x: Array, k: int, rng: Generator) -> Array:
        """Return the point mu (n, M, N) of each ancestor's transition density."""
        transition = model.motion.transition(x, k)
        if self.first_stage == "sample":
            return transition.sample(rng)
        return transition.mean if self.first_stage == "mean" else transition.mode
