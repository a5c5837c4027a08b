"""Particle filters that evolve their particles in place of resampling: PFDE and HDEPF.

`hdepf` is the filter of C. Zhang and L. Li: section III.A is
`EvolutionFilter.differential_evolution`, section III.B is `EvolutionFilter.step`. `pfde` is the
filter of Li, Wang and Su 2011 as that paper uses it: the draws come from the transition, and
selection is greedy. The paper leaves ten points open: the keys of `reading`.
"""

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal, NamedTuple, TypeAlias

import numpy as np
from annotated_types import Ge, Interval
from numpy.random import Generator

from trackbench.core import elementary, particle_weights
from trackbench.core.angles import bring_together
from trackbench.core.arrays import Array, Mask, choose
from trackbench.core.differential_evolution import crossover, mutate
from trackbench.core.metropolis_hastings import metropolis
from trackbench.core.particle_diagnostics import spread_ratio
from trackbench.core.particle_weights import Evidence, WeightReading
from trackbench.core.particles import Particles
from trackbench.core.random_streams import Streams
from trackbench.core.sums import total
from trackbench.field_types import Natural, Positive, Share
from trackbench.filters.merwe_demo import MERWE_PROPOSAL
from trackbench.filters.particle_base import PFState
from trackbench.filters.proposal_base import (
    KalmanProposalFilter,
    ProposalFilter,
    Proposals,
    TransitionReading,
    UnscentedProposal,
)
from trackbench.models.base import Model, Scene, angle_rows
from trackbench.registry import register


@dataclass(frozen=True, kw_only=True)
class Reading:
    """Interpretations of what the papers leave open; the defaults are coherent and work."""

    weights: WeightReading = "log"
    """arithmetic of the likelihood: log-domain, exp() in float64, or exp() + 1e-99"""
    transition_density: TransitionReading = "model"
    """noise in the weight's prior: x_k - f(x_{k-1}), or x_k - x_{k-1} as in the public demo"""
    fitness: Literal["log", "normalized", "raw"] = "log"
    """what selection compares: log-fitness, fitness normalized over the population, or raw"""
    target: Literal["posterior", "ratio"] = "posterior"
    """fitness: likelihood * prior, or the importance ratio likelihood * prior / proposal (printed)"""
    keep_best: Literal["slot", "none"] = "slot"
    """return the best point each slot visited, or the last population"""
    population: Literal["particles", "uniform"] = "particles"
    """first population: the particles (section III.B), or draws between their limits (eq. 9)"""
    bounds: Literal["none", "cloud"] = "none"
    """leave trials free, or clip them to the initial particles' [x^L, x^U] of eq. 9"""
    final_weights: Literal["fitness", "uniform", "importance"] = "fitness"
    """weights of the evolved particles"""
    estimate_from: Literal["after", "before"] = "after"
    """estimate from the evolved particles, or from the weighted ones before the evolution"""

    def compared(self, log_fitness: Array) -> Array:
        """Transform log-fitness to the values that selection compares.

        Parameters
        ----------
        log_fitness : array (M, N)
            Log-fitness of a population.

        Returns
        -------
        array (M, N)
            By the key ``fitness`` the log-fitness, the fitness, or the fitness as a share of the run's
            sum.
        """
        if self.fitness == "log":
            return log_fitness
        if self.fitness == "raw":
            return elementary.exp(log_fitness)
        # Normalized: relative to the largest fitness of the run, then to the sum.
        fitness = elementary.exp(log_fitness - log_fitness.max(axis=-1, keepdims=True))
        return fitness / total(fitness)[:, None]


@dataclass(frozen=True, kw_only=True)
class HybridReading(Reading):
    """Interpretations of the hdepf paper: those above, and the selection."""

    select: Literal["metropolis", "greedy"] = "metropolis"
    """selection: Metropolis criterion (section III.A, step 4), or strictly better trials only"""


class Greedy:
    """Selection of strictly better trials: ``>=`` would accept all trials where fitness underflows."""

    def accept(self, gain: Array, rng: Streams) -> Mask:
        """Accept where the gain (M, N) in what is compared is positive."""
        return np.asarray(gain > 0.0)

    def cool(self) -> "Greedy":
        """Return this rule as it is, since it has no temperature."""
        return self


class Metropolis(NamedTuple):
    """Selection of simulated annealing: a loss is accepted with probability ``exp(gain / T)``."""

    T: float
    rho: float

    def accept(self, gain: Array, rng: Streams) -> Mask:
        """Accept trials by the Metropolis criterion, given their gain (M, N) in what is compared."""
        return metropolis(gain, self.T, rng)

    def cool(self) -> "Metropolis":
        """Lower the temperature to ``rho T``."""
        return self._replace(T=self.T * self.rho)


Selection: TypeAlias = Greedy | Metropolis
"""Rule by which a trial replaces its parent: ``accept(gain, rng)``, and ``cool()`` for the next."""


class Evolved(NamedTuple):
    """Result of the evolution.

    A trial that equals its parent does not count in the acceptance. Crossover took nothing from its
    mutant, as for a share 1 - CR of the trials of a scalar state, or clipping took it back.
    """

    x: Array
    """best point of each of the N slots, or last population, as `Reading.keep_best` says (n, M, N)"""
    log_fitness: Array
    """log-fitness of these points (M, N)"""
    acceptance: Array
    """share of the trials that were accepted (M,)"""


@dataclass(frozen=True, kw_only=True)
class EvolutionFilter(ProposalFilter):
    """Base of PFDE and HDEPF: draw, weigh, evolve in place of resampling, estimate."""

    N: Annotated[int, Ge(4)] = 10
    """number of particles, more than the three that make a mutant"""
    F: Annotated[float, Interval(gt=0, le=2)] = 0.9
    """scaling factor of the mutation (eq. 10)"""
    CR: Share = 0.6
    """crossover probability (eq. 11)"""
    G: Natural = 20
    """generations per step"""
    reading: Reading = Reading()
    """interpretations of what the paper leaves open"""
    _extra_diagnostics: ClassVar[frozenset[str]] = frozenset({"acceptance_rate", "spread_ratio"})
    _reading_path: ClassVar[str] = "reading."
    contract_exemptions: ClassVar[dict[str, str]] = {
        "consistency": "evolves its particles towards the likelihood"
    }

    @property
    def _weight_reading(self) -> tuple[WeightReading, TransitionReading]:
        return self.reading.weights, self.reading.transition_density

    @property
    @abstractmethod
    def selection(self) -> Selection:
        """Selection of the first generation."""

    def idle_keys(self, scenario: Scene) -> dict[str, str]:
        """Report as idle the keys of an evolution without generations, and unused final weights."""
        idle = super().idle_keys(scenario)
        if self.G == 0:
            # T0, rho and `select` are keys of HDEPF only.
            keys = ["F", "CR", "T0", "rho"]
            keys += [f"reading.{key}" for key in ("fitness", "keep_best", "bounds", "select")]
            idle |= dict.fromkeys(keys, "with `G: 0`")
        if self.reading.estimate_from == "before":
            idle["reading.final_weights"] = "with `estimate_from: before`"
        return idle

    def step(self, model: Model, state: PFState, z: Array, k: int, rng: Generator) -> PFState:
        """Draw, weigh, evolve and estimate (section III.B).

        The key ``reading`` has the interpretations of what the paper leaves open.
        """
        # First step: draw each particle from its proposal q, and weigh by
        # w = p(z|x) p(x|x_{k-1}) / q(x) (eq. 7).
        proposals = self._draw_proposals(model, state, z, k, rng)
        log_posterior = self._log_target(model, state.particles.x, z, k)

        def log_ratio(x: Array) -> Array:
            """Return the log (M, N) of likelihood * transition density / proposal density."""
            return log_posterior(x) - proposals.q.log_prob(x)

        w, collapsed, sum_of_weights = particle_weights.normalize(log_ratio(proposals.x))
        # Second to fifth step: the draws are the first population; mutate, cross, select, cool down.
        fitness = log_ratio if self.reading.target == "ratio" else log_posterior
        evolved = self.differential_evolution(proposals.x, fitness, rng)
        # Last: the estimate is the weighted mean. The evolved particles go on with equal weights.
        if self.reading.estimate_from == "after":
            weighted = Particles(evolved.x, self._final_weights(evolved, log_ratio))
        else:
            weighted = Particles(proposals.x, w)
        # Angles that differ by whole turns are brought together, in estimate and next population.
        angles = angle_rows(model.motion)
        weighted = bring_together(weighted, angles)
        evolved_cloud = Particles(evolved.x, particle_weights.equal_weights(*w.shape))
        # Spread of the evolved particles as a share of that of the draws.
        ratio = spread_ratio(evolved.x, proposals.x)
        return PFState(
            particles=bring_together(evolved_cloud, angles),
            averaged_particles=weighted,
            estimate=weighted.moments(),
            collapsed=collapsed,
            P=None if proposals.kalman is None else proposals.kalman.cov,
            w=w,
            # For p(z_k | z_1..k-1): the mean of N weights. `carried` are the log-weights before the
            # update; 0.0 stands for equal ones.
            evidence=(Evidence(sum_of_weights, carried=0.0, N=self.N),),
            extra_diagnostics=(("acceptance_rate", evolved.acceptance), ("spread_ratio", ratio)),
        )

    def differential_evolution(
        self, x: Array, log_fitness: Callable[[Array], Array], rng: Streams
    ) -> Evolved:
        """Evolve a population over G generations by its fitness (section III.A).

        Parameters
        ----------
        x : array (n, M, N)
            First population: N particles in each of M runs.
        log_fitness : callable
            Takes a population (n, M, N) and returns its log-fitness (M, N): the log of likelihood *
            transition density, or of that over the proposal density.
        rng : Streams
            Random numbers of the block of runs.

        Returns
        -------
        Evolved
            Best or last population (n, M, N), its log-fitness (M, N), and the share of accepted trials
            (M,).
        """
        # Step 1: the first population, the particles or draws between their limits (eq. 9).
        lowest = x.min(axis=-1, keepdims=True)
        highest = x.max(axis=-1, keepdims=True)
        if self.reading.population == "uniform":
            x = lowest + rng.random(x.shape) * (highest - lowest)
        fitness = log_fitness(x)
        best_x = x
        best_fitness = fitness
        accepted = np.zeros(fitness.shape)
        tried = np.zeros(fitness.shape)
        selection = self.selection
        for _ in range(self.G):
            # Step 2: mutation, h = x_i + F (x_r1 - x_r2) (eq. 10).
            mutant = mutate(x, self.F, rng)
            # Step 3: crossover, each component from h with probability CR (eq. 11).
            trial = crossover(x, mutant, self.CR, rng)
            if self.reading.bounds == "cloud":
                trial = np.clip(trial, lowest, highest)
            # Step 4: selection by the gain f(v) - f(x), in which f is the log-fitness, the fitness, or
            # the fitness as a share of the population's, by the key `reading.fitness`.
            trial_fitness = log_fitness(trial)
            # The gain from -inf to -inf is NaN, and is not accepted.
            with np.errstate(invalid="ignore", over="ignore"):
                gain = self.reading.compared(trial_fitness) - self.reading.compared(fitness)
            take = selection.accept(gain, rng)
            is_new = (trial != x).any(axis=0)  # a trial that equals its parent does not count
            x = choose(take, trial, x)
            fitness = choose(take, trial_fitness, fitness)
            # The result is the best point that each of the N slots has visited, or the last population.
            if self.reading.keep_best == "slot":
                better = fitness > best_fitness
                best_x = choose(better, x, best_x)
                best_fitness = choose(better, fitness, best_fitness)
            else:
                best_x = x
                best_fitness = fitness
            accepted += take & is_new
            tried += is_new
            # Step 5: cool-down, T <- rho T.
            selection = selection.cool()
        acceptance = total(accepted) / np.maximum(total(tried), 1.0)
        return Evolved(x=best_x, log_fitness=best_fitness, acceptance=acceptance)

    def _final_weights(self, evolved: Evolved, log_ratio: Callable[[Array], Array]) -> Array:
        """Return the weights (M, N) of the evolved particles, as the key `reading.final_weights` says.

        They are equal, or proportional to the fitness, or to the importance ratio likelihood *
        transition density / proposal density. ``log_ratio`` computes the logarithm of this ratio. The
        fitness is the ratio too if `reading.target` is "ratio", else it lacks the proposal density.
        """
        if self.reading.final_weights == "uniform":
            w = particle_weights.equal_weights(*evolved.log_fitness.shape)
            has_diverged = np.isnan(evolved.log_fitness).any(axis=-1, keepdims=True)
            return np.where(has_diverged, np.nan, w)
        if self.reading.final_weights == "importance":
            return particle_weights.normalize(log_ratio(evolved.x)).w
        return particle_weights.normalize(evolved.log_fitness).w


@register("filters", "pfde")
@dataclass(frozen=True, kw_only=True)
class PFDE(EvolutionFilter):
    """Particle filter with greedy differential evolution in place of resampling (Li, Wang & Su 2011).

    The particles are drawn from the transition. With draws from a UKF per particle the same filter is
    ``{kind: hdepf, reading: {select: greedy}}``.
    """

    @property
    def selection(self) -> Selection:
        """Selection of strictly better trials."""
        return Greedy()

    def _draw_proposals(
        self, model: Model, state: PFState, z: Array, k: int, rng: Generator
    ) -> Proposals:
        """Draw the proposals from the motion."""
        transition = model.motion.transition(state.particles.x, k)
        return Proposals(x=transition.sample(rng), q=transition)


@register("filters", "hdepf")
@dataclass(frozen=True, kw_only=True)
class HDEPF(UnscentedProposal, EvolutionFilter, KalmanProposalFilter):
    """Hybrid differential evolution particle filter: UKF proposal, evolution with annealed selection.

    C. Zhang and L. Li, section III.B. The keys of `reading` are interpretations of what the paper leaves
    open. `preset: literal` is the algorithm exactly as printed.
    """

    T0: Positive = 100.0
    """initial temperature"""
    rho: Annotated[float, Interval(gt=0, le=1)] = 0.9
    """cooling factor per generation"""
    reading: HybridReading = HybridReading()
    """interpretations of what the paper leaves open"""
    presets: ClassVar[dict[str, dict[str, object]]] = {
        "matched": {},
        "merwe-demo": MERWE_PROPOSAL,
        "literal": {
            "reading": {
                "weights": "naive",
                "fitness": "normalized",
                "target": "ratio",
                "keep_best": "none",
                "bounds": "none",
                "final_weights": "fitness",
            }
        },
        "published-level": {
            **MERWE_PROPOSAL,
            "reading": {
                "weights": "floor",
                "fitness": "normalized",
                "target": "ratio",
                "keep_best": "none",
                "bounds": "cloud",
            },
        },
    }

    @property
    def selection(self) -> Selection:
        """Selection of the first generation: by the Metropolis criterion at T0, or greedy."""
        return Greedy() if self.reading.select == "greedy" else Metropolis(self.T0, self.rho)

    def idle_keys(self, scenario: Scene) -> dict[str, str]:
        """Report as idle also the keys of the temperature under greedy selection."""
        idle = {}
        if self.reading.select == "greedy":
            idle = dict.fromkeys(("T0", "rho"), "with `select: greedy`")
        return idle | super().idle_keys(scenario)
