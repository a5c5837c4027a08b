"""Simulated data of a block: each run from the random stream of its number."""

from typing import Any

import numpy as np

from trackbench.core.distributions import Gaussian
from trackbench.core.latest_results import LatestResults
from trackbench.core.random_streams import RunStreams
from trackbench.core.read_only import freeze
from trackbench.scenarios.base import Scenario, Simulation


def _simulate(scenario: Scenario, seed: int, first_run: int, width: int) -> Simulation:
    """Simulate ``width`` runs from run ``first_run`` on, each from the random stream of its number."""
    # Training runs count down: -1, -2, ...
    step = 1 if first_run >= 0 else -1
    rng = RunStreams(seed, range(first_run, first_run + step * width, step))
    return freeze(scenario.simulate(rng, width))


simulate = LatestResults(_simulate, size=2)
"""The block's data, read-only; cached, because every filter of a block gets the same data."""


def _simulate_copies(
    scenario: Scenario, seed: int, first_run: int, width: int, copies: int
) -> Simulation:
    """Repeat the data of the same runs ``copies`` times, for filters that are joined to one filter.

    The prior becomes a Gaussian, as such filters use its mean and covariance only (`JoinableFilter`).
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


simulate_copies = LatestResults(_simulate_copies, size=1)
"""The data of a block that several filters filter side by side, read-only."""
