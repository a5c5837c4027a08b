"""Particle filters that propose from the transition: SIR, regularised, auxiliary."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal, NamedTuple

import numpy as np
from annotated_types import Ge, Interval
from numpy.random import Generator

from trackbench.core import elementary, particles, resampling
from trackbench.core.arrays import Array, Mask
from trackbench.core.distributions import Distribution, Gaussian, covering
from trackbench.core.particles import Particles, WeightReading, read_likelihood
from trackbench.core.regularisation import Kernel, jitter
from trackbench.core.resampling import Scheme, ancestors, select
from trackbench.core.streams import Streams
from trackbench.keys import Count, Natural, NonNegative
from trackbench.models.base import Model, log_likelihood
from trackbench.registry import register


class Cloud(NamedTuple):
    """Particles to go on from; those of the estimate, with it; runs without weight; steps done.

    ``P`` is the one covariance of what each particle carries in a Kalman filter, if it does; ``log_w``
    (M, N) the weights' logarithms up to a constant, where the next step weighs what underflows.
    """

    particles: Particles
    weighted: Particles
    estimate: Gaussian
    dead: Mask
    age: int
    P: Array | None = None
    log_w: Array | float = 0.0


@dataclass(frozen=True, kw_only=True)
class ParticleFilter:
    """Keys and hooks shared by the filters that carry a cloud."""

    N: Annotated[int, Ge(2)] = 100
    """number of particles"""
    resampling: Scheme = "systematic"
    """resampling scheme"""
    weights: WeightReading = "log"
    """arithmetic of the likelihood: log-domain, exp() in float64, or exp() + 1e-99"""
    boost: Count = 1
    """factor on N during the first steps"""
    boost_scans: Natural = 0
    """how many steps the cloud is boosted for"""
    counts: ClassVar[frozenset[str]] = frozenset({"dead_steps"})

    def init(self, model: Model, prior: Distribution, rng: Generator) -> Cloud:
        """Draws from the prior in each run, with weights where it covers its tails."""
        x, log_w = covering(prior, rng, self._size(0))
        cloud = Particles(x, particles.normalise(log_w).w)
        dead = np.zeros(x.shape[1], dtype=np.bool_)
        return Cloud(cloud, cloud, cloud.moments(), dead, 0, log_w=log_w)

    def estimate(self, state: Cloud) -> Gaussian:
        """Weighted mean and covariance."""
        return state.estimate

    def expectation(self, state: Cloud, g: Callable[[Array], dict[str, Array]]) -> dict[str, Array]:
        """Posterior means (M,) of functions of the state."""
        return state.weighted.expectation(g)

    def diagnostics(self, state: Cloud) -> dict[str, Array]:
        """``dead_steps``: every likelihood was zero, and the cloud was kept with equal weights."""
        return {"dead_steps": state.dead.astype(float)}

    def _log_likelihood(self, model: Model, z: Array, x: Array, k: int) -> Array:
        return read_likelihood(log_likelihood(model.sensor, z, x, k), self.weights)

    def _size(self, age: int) -> int:
        """Number of particles after so many steps."""
        return self.N * (self.boost if age < self.boost_scans else 1)

    def _resampled(self, cloud: Particles, rng: Streams, size: int) -> Particles:
        index = ancestors(cloud.w, rng, self.resampling, size)
        return Particles(select(cloud.x, index), particles.uniform(*index.shape))


@register("filters", "pf")
@dataclass(frozen=True, kw_only=True)
class PF(ParticleFilter):
    """Bootstrap (SIR) particle filter: prior proposal, weights from the likelihood.

    Gordon, Salmond & Smith 1993; hdepf paper, eqs. 6-8.
    """

    ess_threshold: Annotated[float, Interval(gt=0, le=1)] = 1.0
    """resample a run when its effective sample size is below this share of N; 1 is every step"""
    estimate_from: Literal["weighted", "resampled"] = "weighted"
    """cloud the estimate is taken from: before resampling, or after it as in the public demo"""

    def step(self, model: Model, state: Cloud, z: Array, k: int, rng: Generator) -> Cloud:
        """Move, weight (eq. 7 with q the prior), resample."""
        x = model.motion.transition(state.particles.x, k).sample(rng)
        carried = elementary.log(state.particles.w) if self.ess_threshold < 1.0 else state.log_w
        log_w = self._log_likelihood(model, z, x, k) + carried
        w, dead = particles.normalise(log_w)
        weighted = Particles(x, w)
        resampled = self._resample_if_needed(weighted, rng, self._size(state.age + 1))
        source = weighted if self.estimate_from == "weighted" else resampled
        return Cloud(resampled, source, source.moments(), dead, state.age + 1)

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
        w, dead = particles.normalise(self._log_likelihood(model, z, x, k) + state.log_w)
        weighted = Particles(x, w)
        moments = weighted.moments()
        resampled = self._resampled(weighted, rng, self._size(state.age + 1))
        x = jitter(resampled.x, moments.cov, self.kernel, rng, self.bandwidth_scale)
        return Cloud(Particles(x, resampled.w), weighted, moments, dead, state.age + 1)


@register("filters", "apf")
@dataclass(frozen=True, kw_only=True)
class APF(ParticleFilter):
    """Auxiliary particle filter: picks ancestors by how well they predict the measurement.

    Pitt & Shephard 1999.
    """

    first_stage: Literal["mean", "mode", "sample"] = "mean"
    """point mu at which an ancestor's likelihood is judged: of its transition density"""

    def step(self, model: Model, state: Cloud, z: Array, k: int, rng: Generator) -> Cloud:
        """First-stage weights w p(z|mu), move the chosen, second-stage weights p(z|x) / p(z|mu)."""
        cloud = state.particles
        mu = self._characteristic(model, cloud.x, k, rng)
        first = self._log_likelihood(model, z, mu, k)
        chosen = particles.normalise(first + state.log_w)
        # A run whose first stage has no weight anywhere has learnt nothing from it: mu counts as flat.
        first = np.where(chosen.dead[:, None], 0.0, first)
        size = self._size(state.age + 1)
        index = resampling.ancestors(chosen.w, rng, self.resampling, size)
        x = model.motion.transition(select(cloud.x, index), k).sample(rng)
        second = self._log_likelihood(model, z, x, k) - select(first, index)
        w, dead = particles.normalise(second)
        moved = Particles(x, w)
        log_w = np.where(dead[:, None], 0.0, second)
        return Cloud(moved, moved, moved.moments(), dead, state.age + 1, log_w=log_w)

    def _characteristic(self, model: Model, x: Array, k: int, rng: Generator) -> Array:
        moved = model.motion.transition(x, k)
        if self.first_stage == "sample":
            return moved.sample(rng)
        return moved.mean if self.first_stage == "mean" else moved.mode
