"""Particle filters that resample by differential evolution: PFDE and HDEPF.

`pfde`: Li, Wang & Su 2011, as the hdepf paper uses it. `hdepf`: C. Zhang and L. Li, section III:
part B is ``step``, with the paper's steps beside it; part A, the evolution, is ``core/evolution.py``.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Literal, NamedTuple

import numpy as np
from annotated_types import Ge, Interval
from numpy.random import Generator

from trackbench.core import particles
from trackbench.core.arrays import Array
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.core.evolution import Evolution, Evolved, Fitness, Selection
from trackbench.core.particles import Particles
from trackbench.core.posteriors import Posterior
from trackbench.core.sums import mean, total
from trackbench.filters.proposal import MERWE_PROPOSAL, Proposed, ProposedCloud, UnscentedProposal
from trackbench.keys import Natural, Positive, Share
from trackbench.models.base import Model
from trackbench.registry import register


class EvolvedCloud(NamedTuple):
    """A proposed cloud after evolution, with what the evolution did to each run (M,)."""

    cloud: ProposedCloud
    acceptance: Array
    spread_ratio: Array


@dataclass(frozen=True, kw_only=True)
class _Evolutionary(UnscentedProposal[EvolvedCloud]):
    N: Annotated[int, Ge(4)] = 10
    """number of particles, more than the three that make a mutant"""
    F: Annotated[float, Interval(gt=0, le=2)] = 0.9
    """scaling factor of the mutation (eq. 10)"""
    CR: Share = 0.6
    """crossover probability (eq. 11)"""
    G: Natural = 20
    """generations per step"""
    fitness: Fitness = "log"
    """what selection compares: log-fitness, fitness normalised over the population, or raw"""
    target: Literal["posterior", "ratio"] = "posterior"
    """fitness: likelihood * prior, or the importance ratio likelihood * prior / proposal (printed)"""
    keep_best: Literal["slot", "none"] = "slot"
    """return the best point each slot visited, or the last population"""
    bounds: Literal["none", "cloud"] = "none"
    """leave trials free, or clip them to the initial cloud's [x^L, x^U] of eq. 9"""
    final_weights: Literal["fitness", "uniform", "importance"] = "fitness"
    """weights of the evolved particles"""
    estimate_from: Literal["after", "before"] = "after"
    """estimate from the evolved cloud, or from the weighted one before the evolution"""

    def init(self, model: Model, prior: Distribution, rng: Generator) -> EvolvedCloud:
        """N draws from the prior."""
        cloud = self.drawn(prior, rng)
        runs = cloud.dead.shape
        return EvolvedCloud(cloud, np.zeros(runs), np.ones(runs))

    def step(
        self, model: Model, state: EvolvedCloud, z: Array, k: int, rng: Generator
    ) -> EvolvedCloud:
        """Propose, weight (eq. 7), evolve in place of resampling, estimate."""
        origin = state.cloud.particles.x
        # First step: each particle is drawn from a UKF of its own, and weighed (eq. 7).
        proposed = self._proposed(model, state.cloud, z, k, rng)

        def log_posterior(x: Array) -> Array:
            return self.log_target(model, origin, z, x, k)

        def log_ratio(x: Array) -> Array:
            return log_posterior(x) - proposed.log_q(x)

        w, dead, mass = particles.normalise(log_ratio(proposed.x))
        before = Particles(proposed.x, w)
        # Second to fourth: the particles are the first population, mutated, crossed, selected, cooled.
        fitness = log_ratio if self.target == "ratio" else log_posterior
        evolved = self._evolution.run(proposed.x, fitness, rng)
        after = Particles(evolved.x, self._final_weights(evolved, log_ratio))
        # The estimate is the weighted mean; what has evolved goes on with equal weights.
        source = after if self.estimate_from == "after" else before
        carried = Particles(evolved.x, particles.uniform(*w.shape))
        estimate, P = source.moments(), proposed.kalman.cov
        cloud = ProposedCloud(carried, P, estimate, dead, w, mass, source)
        return EvolvedCloud(cloud, evolved.acceptance, _spread(evolved.x) / _spread(proposed.x))

    def estimate(self, state: EvolvedCloud) -> Gaussian:
        """Weighted mean and covariance."""
        return state.cloud.estimate

    def posterior(self, state: EvolvedCloud) -> Posterior:
        """The cloud of the estimate."""
        return state.cloud.posterior

    def log_likelihood(self, state: EvolvedCloud) -> Array:
        """Logarithm (M,) of the mean weight of what was proposed, before the evolution."""
        return self.log_evidence(state.cloud)

    def diagnostics(self, state: EvolvedCloud) -> dict[str, Array]:
        """Share of new trials accepted, spread of the cloud after over before, steps without weight.

        ``ess``: effective sample size of the proposal before the evolution, ``distinct``: particles that
        are no copies after it, both as shares of N.
        """
        return state.cloud.noted() | {
            "acceptance": state.acceptance,
            "spread_ratio": state.spread_ratio,
            "distinct": particles.distinct(np.sort(state.cloud.particles.x[0])),
        }

    def _proposed(
        self, model: Model, cloud: ProposedCloud, z: Array, k: int, rng: Generator
    ) -> Proposed:
        return self.propose(model, cloud, z, k, rng)

    def _final_weights(self, evolved: Evolved, log_ratio: Callable[[Array], Array]) -> Array:
        if self.final_weights == "uniform":
            w = particles.uniform(*evolved.log_fitness.shape)
            return np.where(np.isnan(evolved.log_fitness).any(axis=-1, keepdims=True), np.nan, w)
        if self.final_weights == "importance":
            return particles.normalise(log_ratio(evolved.x)).w
        return particles.normalise(evolved.log_fitness).w

    @property
    def _evolution(self) -> Evolution:
        """Section III.A with a greedy selection."""
        return Evolution(
            F=self.F,
            CR=self.CR,
            G=self.G,
            fitness=self.fitness,
            keep_best=self.keep_best == "slot",
            clip_to_cloud=self.bounds == "cloud",
        )


@register("filters", "pfde")
@dataclass(frozen=True, kw_only=True)
class PFDE(_Evolutionary):
    """Particle filter with greedy differential evolution as its resampling (Li, Wang & Su 2011)."""

    proposal: Literal["prior", "ukf"] = "prior"
    """where particles are drawn from before the evolution"""

    def held(self, model: Model) -> int:
        """Without a Kalman step: the arrays of a generation, and the covariances of the first."""
        if self.proposal == "ukf":
            return super().held(model)
        return self.N * (12 + len(model.motion.components) ** 2)

    def _proposed(
        self, model: Model, cloud: ProposedCloud, z: Array, k: int, rng: Generator
    ) -> Proposed:
        if self.proposal == "ukf":
            return self.propose(model, cloud, z, k, rng)
        moved = model.motion.transition(cloud.particles.x, k)
        return Proposed(moved.sample(rng), Gaussian(moved.mean, cloud.P), moved.log_prob)


@register("filters", "hdepf")
@dataclass(frozen=True, kw_only=True)
class HDEPF(_Evolutionary):
    """Hybrid differential evolution particle filter: UKF proposal, Metropolis selection, cooling.

    C. Zhang and L. Li, section III.B. `preset: literal` is the algorithm exactly as printed.
    """

    T0: Positive = 100.0
    """initial temperature"""
    rho: Annotated[float, Interval(gt=0, le=1)] = 0.9
    """cooling factor per generation"""
    select: Selection = "metropolis"
    """selection step"""

    presets: ClassVar[dict[str, dict[str, object]]] = {
        "matched": {},
        "merwe-demo": MERWE_PROPOSAL,
        "literal": {
            "weights": "naive",
            "fitness": "normalised",
            "target": "ratio",
            "keep_best": "none",
            "bounds": "none",
            "final_weights": "fitness",
        },
        "published-level": {
            **MERWE_PROPOSAL,
            "weights": "floor",
            "fitness": "normalised",
            "target": "ratio",
            "keep_best": "none",
            "bounds": "cloud",
        },
    }

    @property
    def _evolution(self) -> Evolution:
        """Section III.A with selection as in simulated annealing."""
        return replace(super()._evolution, T0=self.T0, rho=self.rho, select=self.select)


def _spread(x: Array) -> Array:
    """Root mean square distance from the centre (M,)."""
    with np.errstate(over="ignore", invalid="ignore"):
        return np.sqrt(total(mean(np.square(x - mean(x)[..., None])), axis=0))
