"""Particle filters that propose from the transition: SIR, regularised, auxiliary."""

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Interval
from numpy.random import Generator

from trackbench.core import elementary, particles, resampling
from trackbench.core.arrays import Array
from trackbench.core.kernel_smoothing import Kernel, jitter
from trackbench.core.metropolis import independence_moves
from trackbench.core.particles import Evidence, Particles, read_likelihood
from trackbench.core.resampling import select
from trackbench.field_types import Natural, NonNegative
from trackbench.filters.particle_base import Cloud, ParticleFilter
from trackbench.models.base import Model, Scene
from trackbench.registry import register


@register("filters", "pf")
@dataclass(frozen=True, kw_only=True)
class PF(ParticleFilter):
    """Bootstrap (SIR) particle filter: prior proposal, weights from the likelihood.

    Gordon, Salmond & Smith 1993; hdepf paper, eqs. 6-8.
    """

    ess_threshold: Annotated[float, Interval(gt=0, le=1)] = 1.0
    """resample a run when its effective sample size is below this share of N; 1 is every step"""
    moves: Natural = 0
    """Metropolis-Hastings steps of each particle after resampling, drawn from its parent's transition"""
    estimate_from: Literal["weighted", "resampled"] = "weighted"
    """cloud the estimate is taken from: before resampling, or after it and the moves as in the demo"""

    def step(self, model: Model, state: Cloud, z: Array, k: int, rng: Generator) -> Cloud:
        """Predict, weight (eq. 7 with q the prior), resample, move."""
        origin = state.particles.x
        x = model.motion.transition(origin, k).sample(rng)
        if self.ess_threshold < 1.0:
            state = state._replace(log_w=elementary.log(state.particles.w))
        w, dead, told = self._weighed(model, state, z, x, k)
        weighted, size = Particles(x, w), self._size(state.age + 1)
        if self.moves:
            # Parents are resampled with their children, as components of one state.
            joint = Particles(np.concatenate((x, origin)), w)
            resampled = self._moved(model, self._resample_if_needed(joint, rng, size), z, k, rng)
        else:
            resampled = self._resample_if_needed(weighted, rng, size)
        source, age = weighted if self.estimate_from == "weighted" else resampled, state.age + 1
        return Cloud(resampled, source, source.moments(), dead, age, w=w, evidence=told)

    @property
    def diagnostic_names(self) -> frozenset[str]:
        """What `diagnostics` gives."""
        return super().diagnostic_names | {"distinct"}

    def diagnostics(self, state: Cloud) -> dict[str, Array]:
        """The same, and ``distinct``: share of particles that are no copies after resampling."""
        return super().diagnostics(state) | {
            "distinct": particles.distinct_share(state.particles.x[0])
        }

    def _moved(self, model: Model, joint: Particles, z: Array, k: int, rng: Generator) -> Particles:
        """The children (n, M, N) of (children, parents) (2 n, M, N), moved given their parents."""
        x, parents = np.split(joint.x, 2)
        moved = model.motion.transition(parents, k)

        def log_ratio(x: Array) -> Array:
            return self._log_likelihood(model, z, x, k)

        return Particles(independence_moves(x, moved.sample, log_ratio, self.moves, rng), joint.w)

    def _resample_if_needed(self, cloud: Particles, rng: Generator, size: int) -> Particles:
        resampled = self._resampled(cloud, rng, size)
        if self.ess_threshold == 1.0 or size != cloud.w.shape[1]:
            return resampled
        rich = particles.effective_sample_size(cloud.w) >= self.ess_threshold * size
        return Particles(
            np.where(rich[:, None], cloud.x, resampled.x),
            np.where(rich[:, None], cloud.w, resampled.w),
        )


@register("filters", "rpf")
@dataclass(frozen=True, kw_only=True)
class RPF(ParticleFilter):
    """Regularised particle filter: resamples from a kernel density of the posterior.

    Musso, Oudjane & Le Gland 2001, section 12.2 (post-regularisation).
    """

    kernel: Kernel = "epanechnikov"
    """regularisation kernel"""
    bandwidth_scale: NonNegative = 1.0
    """factor on the optimal bandwidth; 0 is plain resampling"""

    def step(self, model: Model, state: Cloud, z: Array, k: int, rng: Generator) -> Cloud:
        """Move, weight, resample, jitter by the kernel scaled to the weighted cloud's covariance."""
        x = model.motion.transition(state.particles.x, k).sample(rng)
        w, dead, told = self._weighed(model, state, z, x, k)
        weighted, age = Particles(x, w), state.age + 1
        moments = weighted.moments()
        resampled = self._resampled(weighted, rng, self._size(age))
        x = jitter(resampled.x, moments.cov, self.kernel, rng, self.bandwidth_scale)
        cloud = Particles(x, resampled.w)
        return Cloud(cloud, weighted, moments, dead, age, w=w, evidence=told)


@register("filters", "apf")
@dataclass(frozen=True, kw_only=True)
class APF(ParticleFilter):
    """Auxiliary particle filter: picks ancestors by how well they predict the measurement.

    Pitt & Shephard 1999 (``stages: 2``); with one stage Carpenter, Clifford & Fearnhead 1999.
    """

    first_stage: Literal["mean", "mode", "sample"] = "mean"
    """point mu at which an ancestor's likelihood is judged: of its transition density"""
    carried: Literal["log", "float64"] | None = None
    """weights that the next step starts from: logarithms, or normalised in float64, where small ones
    are zero; default: log with `weights: log`, else float64"""
    stages: Literal[1, 2] = 1
    """times that a step resamples: 1 carries the second-stage weights on; 2 resamples by them as well"""

    def idle_keys(self, scenario: Scene) -> dict[str, str]:
        """Return ``carried`` where the second stage leaves equal weights."""
        idle = {"carried": "with `stages: 2`"} if self.stages == 2 else {}
        return super().idle_keys(scenario) | idle

    def step(self, model: Model, state: Cloud, z: Array, k: int, rng: Generator) -> Cloud:
        """First-stage weights w p(z|mu), move the chosen, second-stage weights p(z|x) / p(z|mu)."""
        cloud = state.particles
        mu = self._characteristic(model, cloud.x, k, rng)
        first = self._log_likelihood(model, z, mu, k)
        chosen = particles.normalize(self._read(first + state.log_w))
        # A run whose first stage has no weight anywhere has learnt nothing from it: mu counts as flat.
        first = np.where(chosen.collapsed[:, None], 0.0, first)
        size = self._size(state.age + 1)
        index = resampling.ancestors(chosen.w, rng, self.resampling, size)
        x = model.motion.transition(select(cloud.x, index), k).sample(rng)
        second = self._log_likelihood(model, z, x, k) - select(first, index)
        w, dead, mass = particles.normalize(second)
        told = (Evidence(chosen.mass, state.log_w, first.shape[1]), Evidence(mass, 0.0, w.shape[1]))
        moved, age = Particles(x, w), state.age + 1
        if self.stages == 2:
            resampled = self._resampled(moved, rng, size)
            return Cloud(resampled, moved, moved.moments(), dead, age, w=w, evidence=told)
        log_w = elementary.log(w) if self._in_float64 else np.where(dead[:, None], 0.0, second)
        return Cloud(moved, moved, moved.moments(), dead, age, log_w=log_w, w=w, evidence=told)

    def log_likelihood(self, state: Cloud) -> Array:
        """Logarithm (M,) of both stages' mean weights, multiplied (Pitt 2002, section 2.2)."""
        if not state.evidence:
            return np.full(state.dead.shape, np.nan)
        first, second = (stage.log for stage in state.evidence)
        return np.where(first == -np.inf, 0.0, first) + second

    @property
    def _in_float64(self) -> bool:
        carried = self.carried or ("log" if self.weights == "log" else "float64")
        return carried == "float64"

    def _read(self, log_w: Array) -> Array:
        """Products of weights and likelihoods, of which a program that carries float64 loses some."""
        if self._in_float64 and self.weights != "log":
            return read_likelihood(log_w, "naive")
        return log_w

    def _characteristic(self, model: Model, x: Array, k: int, rng: Generator) -> Array:
        moved = model.motion.transition(x, k)
        if self.first_stage == "sample":
            return moved.sample(rng)
        return moved.mean if self.first_stage == "mean" else moved.mode
