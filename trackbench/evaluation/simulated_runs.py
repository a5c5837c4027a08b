"""Simulated or recorded data of a block's runs, from a cache; copies of the runs for joined filters."""

from typing import Any

import numpy as np

from trackbench.core.distributions import Gaussian
from trackbench.core.latest_results import LatestResults
from trackbench.core.random_streams import RunStreams
from trackbench.core.read_only import freeze
from trackbench.scenarios.base import Scenario, Simulation


def numbers_from(first: int, size: int) -> range:
    """Return ``size`` numbers of runs or blocks, from ``first`` on; training ones count down from -1."""
    step = 1 if first >= 0 else -1
    return range(first, first + step * size, step)


def _simulate(scenario: Scenario, seed: int, first_run: int, width: int) -> Simulation:
    """Simulate ``width`` runs from run ``first_run`` on, each from the random stream of its number."""
    rng = RunStreams(seed, numbers_from(first_run, width))
    return freeze(scenario.simulate(rng, width))


simulate = LatestResults(_simulate, size=2)
"""The block's data, read-only; cached, because every filter of a block gets the same data."""


def _simulate_copies(
    scenario: Scenario, seed: int, first_run: int, width: int, copies: int
) -> Simulation:
    """Repeat the data of the same ``width`` runs ``copies`` times, for that many joined filters.

    The joined filter computes what several filters of one structure would, each over one copy of the
    runs: the runs of copy i are those of filter i. The prior becomes a Gaussian, as such filters use its
    mean and covariance only (`JoinableFilter`).
    """
    data = simulate(scenario, seed, first_run, width)

    def repeat_runs(rows: Any) -> Any:
        # The runs are the last axis.
        return np.concatenate([rows] * copies, axis=-1)

    # A covariance (n, n) is shared by all runs.
    cov = data.prior.cov
    if cov.ndim > 2:
        cov = repeat_runs(cov)
    arrival = data.arrival
    if arrival is not None:
        arrival = repeat_runs(arrival)
    copied = Simulation(
        truth=repeat_runs(data.truth),
        measurements=repeat_runs(data.measurements),
        prior=Gaussian(repeat_runs(data.prior.mean), cov),
        arrival=arrival,
    )
    return freeze(copied)


_cached_copies = LatestResults(_simulate_copies, size=1)


def simulate_copies(
    scenario: Scenario, seed: int, first_run: int, width: int, copies: int
) -> Simulation:
    """Return the data of a block that ``copies`` filters filter side by side, read-only, from a cache.

    They are the data of the same ``width`` runs, once for each filter.
    """
    if copies == 1:
        return simulate(scenario, seed, first_run, width)
    return _cached_copies(scenario, seed, first_run, width, copies)
