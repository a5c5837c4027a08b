"""Differential evolution of a particle cloud (Storn & Price 1997), with Metropolis selection.

A population is x (n, M, N): N individuals in each of M runs. The hybrid form replaces the greedy
selection by the Metropolis criterion of simulated annealing (the hdepf paper, section III.A).
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, NamedTuple

import numpy as np

from trackbench.core import elementary
from trackbench.core.arrays import Array, Index, Mask
from trackbench.core.resampling import select
from trackbench.core.streams import Streams
from trackbench.core.sums import total

Fitness = Literal["log", "normalised", "raw"]
Selection = Literal["metropolis", "greedy"]


class Evolved(NamedTuple):
    """The last population, its log-fitness (M, N), and the share of trials accepted (M,).

    A trial that is its parent again, because crossover took nothing from the mutant or clipping took it
    back, is none: of one component it is 1 - CR of them.
    """

    x: Array
    log_fitness: Array
    acceptance: Array


@dataclass(frozen=True)
class Evolution:
    """The algorithm's parameters, in the papers' symbols."""

    F: float
    CR: float
    G: int
    T0: float = 1.0
    rho: float = 1.0
    select: Selection = "greedy"
    fitness: Fitness = "log"
    keep_best: bool = False
    clip_to_cloud: bool = False

    def run(self, x: Array, log_fitness: Callable[[Array], Array], rng: Streams) -> Evolved:
        """G generations of mutation, crossover, selection and cooling."""
        fit = log_fitness(x)
        lowest, highest = x.min(axis=-1, keepdims=True), x.max(axis=-1, keepdims=True)
        best_x, best_fit = x, fit
        accepted, tried = (np.zeros(fit.shape) for _ in range(2))
        temperature = self.T0
        for _ in range(self.G):
            trial = crossover(x, mutate(x, self.F, rng), self.CR, rng)
            if self.clip_to_cloud:
                trial = np.clip(trial, lowest, highest)
            trial_fit = log_fitness(trial)
            take = self._selected(fit, trial_fit, temperature, rng)
            is_new = (trial != x).any(axis=0)
            x, fit = np.where(take, trial, x), np.where(take, trial_fit, fit)
            if self.keep_best:
                better = fit > best_fit
                best_x, best_fit = np.where(better, x, best_x), np.where(better, fit, best_fit)
            accepted += take & is_new
            tried += is_new
            temperature *= self.rho
        acceptance = total(accepted) / np.maximum(total(tried), 1.0)
        return (
            Evolved(best_x, best_fit, acceptance) if self.keep_best else Evolved(x, fit, acceptance)
        )

    def _selected(self, old: Array, new: Array, temperature: float, rng: Streams) -> Mask:
        with np.errstate(invalid="ignore", over="ignore"):
            gain = self._scaled(new) - self._scaled(old)
        if self.select == "greedy":
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


def mutate(x: Array, F: float, rng: Streams) -> Array:
    """``x_i + F (x_r1 - x_r2)``, r1 != r2 != i (hdepf paper, eq. 10)."""
    r1, r2 = distinct_pairs(x.shape[1], x.shape[2], rng)
    return x + F * (select(x, r1) - select(x, r2))


def crossover(x: Array, mutant: Array, CR: float, rng: Streams) -> Array:
    """Component by component the mutant's with probability CR, else x's (hdepf paper, eq. 11)."""
    return np.where(rng.random(x.shape) <= CR, mutant, x)


def metropolis(gain: Array, temperature: float, rng: Streams) -> Mask:
    """Accept every gain, and a loss with probability ``exp(gain / temperature)`` (none below 1e-5)."""
    loss: Array = rng.standard_gamma(
        1, gain.shape
    )  # -log u of a uniform u < exp(gain / temperature)
    loss *= -temperature
    return np.asarray(gain > loss)


def distinct_pairs(runs: int, N: int, rng: Streams) -> tuple[Index, Index]:
    """Flat indices r1, r2 (M, N), uniform over pairs with r1, r2 and i all different; N >= 3."""
    u = rng.random((2, runs, N))
    u[0] *= N - 1
    u[1] *= N - 2
    steps = u.astype(np.intp)
    steps += 1  # r1 = i + steps[0], 1 <= steps[0] <= N - 1
    steps[1] += steps[1] >= steps[0]  # the N - 2 steps that are neither 0 nor steps[0]
    around, start = _rounds(runs, N)
    steps += start
    r1, r2 = around.take(steps, mode="clip")
    return r1, r2


@lru_cache(maxsize=8)
def _rounds(runs: int, N: int) -> tuple[Index, Index]:
    """Flat indices of each run's particles twice over (2 M N,), and where in them each stands (M, N)."""
    i, run = np.arange(N), np.arange(runs)[:, None]
    return (run * N + np.concatenate([i, i])).ravel(), run * (2 * N) + i
