"""Particle filters that resample by differential evolution: PFDE and HDEPF.

`pfde`: Li, Wang & Su 2011, as the hdepf paper uses it. `hdepf`: C. Zhang and L. Li, section III: part A
is `Evolution.evolved`, with the moves of eqs. 10 and 11 from ``core/differential_evolution.py``; part B
is `HDEPF.step`, which proposes, and `Evolution.renewed`, with the paper's steps beside them.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal, NamedTuple

import numpy as np
from annotated_types import Ge, Interval
from numpy.random import Generator

from trackbench.core import elementary, particles
from trackbench.core.arrays import Array, Mask
from trackbench.core.differential_evolution import crossover, mutate
from trackbench.core.distributions import Gaussian
from trackbench.core.metropolis import metropolis
from trackbench.core.particles import Evidence, Particles
from trackbench.core.random_streams import Streams
from trackbench.core.sums import mean, total
from trackbench.field_types import Natural, Positive, Share
from trackbench.filters.kalman_proposal import (
    MERWE_PROPOSAL,
    Proposed,
    ProposingFilter,
    UnscentedProposal,
)
from trackbench.filters.particle_base import Cloud
from trackbench.models.base import Model, Scene
from trackbench.registry import register

_OF_GENERATIONS = ("F", "CR", "fitness", "keep_best", "bounds", "T0", "rho", "select")


class Evolved(NamedTuple):
    """The last population x (n, M, N), its log-fitness (M, N), and the share of trials accepted (M,).

    A trial that is its parent again, because crossover took nothing from the mutant or clipping took it
    back, is none: of one component it is 1 - CR of them.
    """

    x: Array
    log_fitness: Array
    acceptance: Array


@dataclass(frozen=True, kw_only=True)
class Evolution:
    """Keys of the evolution, in the papers' symbols, and what it makes of proposed particles."""

    N: Annotated[int, Ge(4)] = 10
    """number of particles, more than the three that make a mutant"""
    F: Annotated[float, Interval(gt=0, le=2)] = 0.9
    """scaling factor of the mutation (eq. 10)"""
    CR: Share = 0.6
    """crossover probability (eq. 11)"""
    G: Natural = 20
    """generations per step"""
    fitness: Literal["log", "normalised", "raw"] = "log"
    """what selection compares: log-fitness, fitness normalised over the population, or raw"""
    target: Literal["posterior", "ratio"] = "posterior"
    """fitness: likelihood * prior, or the importance ratio likelihood * prior / proposal (printed)"""
    keep_best: Literal["slot", "none"] = "slot"
    """return the best point each slot visited, or the last population"""
    population: Literal["particles", "uniform"] = "particles"
    """first population: the particles (section III.B), or draws between their limits (eq. 9)"""
    bounds: Literal["none", "cloud"] = "none"
    """leave trials free, or clip them to the initial cloud's [x^L, x^U] of eq. 9"""
    final_weights: Literal["fitness", "uniform", "importance"] = "fitness"
    """weights of the evolved particles"""
    estimate_from: Literal["after", "before"] = "after"
    """estimate from the evolved cloud, or from the weighted one before the evolution"""
    _also_noted: ClassVar[frozenset[str]] = frozenset({"acceptance", "spread_ratio"})

    def _idle_evolution(self) -> dict[str, str]:
        idle = dict.fromkeys(_OF_GENERATIONS, "with `G: 0`") if self.G == 0 else {}
        if self.estimate_from == "before":
            idle["final_weights"] = "with `estimate_from: before`"
        return idle

    def renewed(
        self, proposed: Proposed, log_posterior: Callable[[Array], Array], rng: Streams
    ) -> Cloud:
        """Section III.B from the weights on: weigh (eq. 7), evolve in place of resampling, estimate."""

        def log_ratio(x: Array) -> Array:
            return log_posterior(x) - proposed.log_q(x)

        w, dead, mass = particles.normalize(log_ratio(proposed.x))
        # Second to fourth: the particles are the first population, mutated, crossed, selected, cooled.
        fitness = log_ratio if self.target == "ratio" else log_posterior
        evolved = self.evolved(proposed.x, fitness, rng)
        # The estimate is the weighted mean; what has evolved goes on with equal weights.
        source = Particles(proposed.x, w)
        if self.estimate_from == "after":
            source = Particles(evolved.x, self._final_weights(evolved, log_ratio))
        ratio = _spread(evolved.x) / _spread(proposed.x)
        return Cloud(
            Particles(evolved.x, particles.equal_weights(*w.shape)),
            source,
            source.moments(),
            dead,
            P=proposed.kalman.cov,
            w=w,
            evidence=(Evidence(mass, 0.0, self.N),),
            notes=(("acceptance", evolved.acceptance), ("spread_ratio", ratio)),
        )

    def evolved(self, x: Array, log_fitness: Callable[[Array], Array], rng: Streams) -> Evolved:
        """Section III.A: G generations of mutation, crossover, selection and cooling."""
        lowest, highest = x.min(axis=-1, keepdims=True), x.max(axis=-1, keepdims=True)
        if self.population == "uniform":
            x = lowest + rng.random(x.shape) * (highest - lowest)  # eq. 9
        fit = log_fitness(x)
        best_x, best_fit = x, fit
        accepted, tried = (np.zeros(fit.shape) for _ in range(2))
        for temperature in self._temperatures():
            trial = crossover(x, mutate(x, self.F, rng), self.CR, rng)
            if self.bounds == "cloud":
                trial = np.clip(trial, lowest, highest)
            trial_fit = log_fitness(trial)
            take = self._selected(fit, trial_fit, temperature, rng)
            is_new = (trial != x).any(axis=0)
            x, fit = np.where(take, trial, x), np.where(take, trial_fit, fit)
            if self.keep_best == "slot":
                better = fit > best_fit
                best_x, best_fit = np.where(better, x, best_x), np.where(better, fit, best_fit)
            else:
                best_x, best_fit = x, fit
            accepted += take & is_new
            tried += is_new
        return Evolved(best_x, best_fit, total(accepted) / np.maximum(total(tried), 1.0))

    def _temperatures(self) -> Iterable[float | None]:
        """Temperature of each generation; None where selection is greedy."""
        return (None,) * self.G

    def _selected(self, old: Array, new: Array, temperature: float | None, rng: Streams) -> Mask:
        with np.errstate(invalid="ignore", over="ignore"):
            gain = self._scaled(new) - self._scaled(old)
        if temperature is None:
            # Strictly better: with underflowed fitness, 0 >= 0 would walk away at random.
            return np.asarray(gain > 0.0)
        return metropolis(gain, temperature, rng)

    def _scaled(self, log_fitness: Array) -> Array:
        if self.fitness == "log":
            return log_fitness
        if self.fitness == "raw":
            return elementary.exp(log_fitness)
        fitness = elementary.exp(log_fitness - log_fitness.max(axis=-1, keepdims=True))
        return fitness / total(fitness)[:, None]

    def _final_weights(self, evolved: Evolved, log_ratio: Callable[[Array], Array]) -> Array:
        if self.final_weights == "uniform":
            w = particles.equal_weights(*evolved.log_fitness.shape)
            return np.where(np.isnan(evolved.log_fitness).any(axis=-1, keepdims=True), np.nan, w)
        if self.final_weights == "importance":
            return particles.normalize(log_ratio(evolved.x)).w
        return particles.normalize(evolved.log_fitness).w


def _spread(x: Array) -> Array:
    """Root mean square distance from the centre (M,)."""
    with np.errstate(over="ignore", invalid="ignore"):
        return np.sqrt(total(mean(np.square(x - mean(x)[..., None])), axis=0))


@register("filters", "pfde")
@dataclass(frozen=True, kw_only=True)
class PFDE(Evolution, UnscentedProposal, ProposingFilter):
    """Particle filter with greedy differential evolution as its resampling (Li, Wang & Su 2011)."""

    proposal: Literal["prior", "ukf"] = "prior"
    """where particles are drawn from before the evolution"""

    def idle_keys(self, scenario: Scene) -> dict[str, str]:
        """Return the keys of a UKF that does not propose, and of an evolution without generations."""
        idle = {"defensive": self._unused} if self.proposal == "prior" else {}
        return super().idle_keys(scenario) | idle | self._idle_evolution()

    @property
    def _unused(self) -> str:
        return "with `proposal: prior`" if self.proposal == "prior" else super()._unused

    def step(self, model: Model, state: Cloud, z: Array, k: int, rng: Generator) -> Cloud:
        """Draw from the transition or a UKF per particle; weigh and evolve."""
        log_posterior = self._log_target(model, state.particles.x, z, k)
        if self.proposal == "ukf":
            return self.renewed(self._proposed(model, state, z, k, rng), log_posterior, rng)
        assert state.P is not None
        moved = model.motion.transition(state.particles.x, k)
        kalman = Gaussian(moved.mean, state.P)
        return self.renewed(Proposed(moved.sample(rng), kalman, moved.log_prob), log_posterior, rng)

    def _held_by_each(self, model: Model) -> int:
        """Without a Kalman step: the arrays of a generation, and the covariances of the first."""
        if self.proposal == "ukf":
            return super()._held_by_each(model)
        return 12 + len(model.motion.components) ** 2


@register("filters", "hdepf")
@dataclass(frozen=True, kw_only=True)
class HDEPF(Evolution, UnscentedProposal, ProposingFilter):
    """Hybrid differential evolution particle filter: UKF proposal, Metropolis selection, cooling.

    C. Zhang and L. Li, section III.B. `preset: literal` is the algorithm exactly as printed.
    """

    T0: Positive = 100.0
    """initial temperature"""
    rho: Annotated[float, Interval(gt=0, le=1)] = 0.9
    """cooling factor per generation"""
    select: Literal["metropolis", "greedy"] = "metropolis"
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

    def idle_keys(self, scenario: Scene) -> dict[str, str]:
        """Return the keys of the temperature under greedy selection."""
        greedy = ("T0", "rho") if self.select == "greedy" else ()
        idle = dict.fromkeys(greedy, "with `select: greedy`")
        return super().idle_keys(scenario) | idle | self._idle_evolution()

    def step(self, model: Model, state: Cloud, z: Array, k: int, rng: Generator) -> Cloud:
        """Section III.B: each particle is drawn from a UKF of its own; then weighed and evolved."""
        proposed = self._proposed(model, state, z, k, rng)
        log_posterior = self._log_target(model, state.particles.x, z, k)
        return self.renewed(proposed, log_posterior, rng)

    def _temperatures(self) -> Iterable[float | None]:
        """Selection as in simulated annealing: from T0 down by rho each generation."""
        temperature = self.T0
        for _ in range(self.G):
            yield temperature if self.select == "metropolis" else None
            temperature *= self.rho
