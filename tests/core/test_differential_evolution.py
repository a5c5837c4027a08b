from dataclasses import replace

import numpy as np
import pytest

from trackbench.core.differential_evolution import crossover, distinct_pairs
from trackbench.core.metropolis_hastings import metropolis
from trackbench.core.random_streams import block_stream
from trackbench.filters.hdepf import HDEPF, PFDE, HybridReading

LAST = HybridReading(keep_best="none")
CLIPPED = HybridReading(bounds="cloud", keep_best="none")


@pytest.mark.parametrize("N", [4, 5, 10])
def test_pairs_are_distinct_and_uniform(N: int, rng: np.random.Generator) -> None:
    runs = 6000
    r1, r2 = distinct_pairs(runs, N, rng)
    own = np.arange(runs * N).reshape(runs, N)
    assert ((r1 // N) == np.arange(runs)[:, None]).all()
    assert ((r2 // N) == np.arange(runs)[:, None]).all()
    assert (r1 != own).all()
    assert (r2 != own).all()
    assert (r1 != r2).all()
    # For individual 0 each of the (N - 1)(N - 2) ordered pairs has the same chance.
    pairs = (r1[:, 0] % N) * N + r2[:, 0] % N
    counts = np.bincount(pairs, minlength=N * N)
    counts = counts[counts > 0]
    cells = (N - 1) * (N - 2)
    assert len(counts) == cells
    chi2 = ((counts - runs / cells) ** 2 / (runs / cells)).sum()
    assert abs(chi2 - (cells - 1)) < 5 * np.sqrt(2 * (cells - 1))


def test_crossover_takes_the_share_it_is_told(rng: np.random.Generator) -> None:
    x, mutant = np.zeros((2, 100, 100)), np.ones((2, 100, 100))
    share = crossover(x, mutant, 0.6, rng).mean()
    assert abs(share - 0.6) < 4 * np.sqrt(0.24 / x.size)
    assert not crossover(x, mutant, 0.0, rng).any()
    assert crossover(x, mutant, 1.0, rng).all()


def test_metropolis_accepts_losses_with_their_probability(rng: np.random.Generator) -> None:
    loss = np.full((200, 200), -1.0)
    share = metropolis(loss, 2.0, rng).mean()
    p = np.exp(-0.5)
    assert abs(share - p) < 4 * np.sqrt(p * (1 - p) / loss.size)
    assert metropolis(-loss, 2.0, rng).all()
    nowhere = np.full((3, 3), np.nan)  # from zero fitness to zero fitness
    assert not metropolis(nowhere, 2.0, rng).any()


def test_greedy_needs_a_strict_gain(rng: np.random.Generator) -> None:
    """Zero fitness against zero fitness must not walk."""
    x = rng.standard_normal((1, 20, 10))
    evolved = PFDE(F=0.9, CR=1.0, G=5).differential_evolution(
        x, lambda x: np.full(x.shape[1:], -np.inf), rng
    )
    np.testing.assert_array_equal(evolved.x, x)
    assert not evolved.acceptance.any()


def test_greedy_finds_a_maximum(rng: np.random.Generator) -> None:
    """The best of each population does; a straggler can be left behind when the others agree."""
    x = rng.uniform(-5, 5, (2, 30, 20))
    target = np.array([1.0, -2.0])[:, None, None]
    de = PFDE(F=0.7, CR=0.9, G=120, reading=LAST)
    evolved = de.differential_evolution(x, lambda x: -np.square(x - target).sum(axis=0), rng)
    assert evolved.log_fitness.max(axis=1).min() > -1e-5
    start = -np.square(x - target).sum(axis=0)
    assert (evolved.log_fitness >= start).all()


def test_hot_metropolis_samples_and_best_slot_remembers(rng: np.random.Generator) -> None:
    """At T = 1 on log-fitness the population keeps the target's spread; `keep_best` climbs."""
    x = rng.standard_normal((1, 400, 10))

    def log_normal(x: np.ndarray) -> np.ndarray:
        return -0.5 * np.square(x[0])

    free = HDEPF(F=0.9, CR=0.6, G=40, T0=1.0, rho=1.0, reading=LAST)
    spread = free.differential_evolution(x, log_normal, rng).x.std()
    assert 0.7 < spread < 1.3
    kept = replace(free, reading=HybridReading())
    best = kept.differential_evolution(x, log_normal, rng)
    assert (best.log_fitness >= log_normal(x) - 1e-12).all()


def test_cloud_bounds_hold(rng: np.random.Generator) -> None:
    x = rng.standard_normal((1, 50, 10))
    wild = HDEPF(F=2.0, CR=1.0, G=10, T0=1e9, rho=1.0, reading=CLIPPED)
    evolved = wild.differential_evolution(x, lambda x: np.zeros(x.shape[1:]), rng).x
    assert (evolved >= x.min(axis=2, keepdims=True)).all()
    assert (evolved <= x.max(axis=2, keepdims=True)).all()


def test_acceptance_counts_trials_that_are_new(rng: np.random.Generator) -> None:
    """A scalar count of trials and of what became of them; of one component 1 - CR are the parent."""

    def log_normal(x: np.ndarray) -> np.ndarray:
        return -0.5 * np.square(x).sum(axis=0)

    start, trials = rng.standard_normal((1, 30, 8)), []

    def recorded(x: np.ndarray) -> np.ndarray:
        trials.append(x.copy())
        return log_normal(x)

    hybrid = HDEPF(F=0.9, CR=0.6, G=6, T0=0.5, rho=0.9, reading=LAST)
    found = hybrid.differential_evolution(start, recorded, block_stream(1, 0))
    # The population before each generation, from runs of fewer of them on the same noise.
    before = [
        replace(hybrid, G=g).differential_evolution(start, log_normal, block_stream(1, 0)).x[0]
        for g in range(7)
    ]
    taken, tried = np.zeros(30), np.zeros(30)
    for g, m, i in np.ndindex(6, 30, 8):
        new, old, kept = trials[g + 1][0, m, i], before[g][m, i], before[g + 1][m, i]
        tried[m] += new != old
        taken[m] += new != old and kept == new
    np.testing.assert_allclose(found.acceptance, taken / tried)
    assert 0.0 < taken.sum() < tried.sum()
    assert abs(tried.mean() / 48 - 0.6) < 4.5 * np.sqrt(0.24 / (30 * 48))


def test_acceptance_is_one_where_all_is_taken_and_zero_without_trials(
    rng: np.random.Generator,
) -> None:
    x = rng.standard_normal((1, 30, 10))

    def flat(x: np.ndarray) -> np.ndarray:
        return np.zeros(x.shape[1:])

    hot = HDEPF(F=0.9, CR=0.3, G=20, T0=100.0, rho=1.0, reading=LAST)
    np.testing.assert_array_equal(hot.differential_evolution(x, flat, rng).acceptance, 1.0)
    assert not replace(hot, G=0).differential_evolution(x, flat, rng).acceptance.any()
    assert not replace(hot, CR=0.0).differential_evolution(x, flat, rng).acceptance.any()
