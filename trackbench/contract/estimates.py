"""Estimates of a filter on a problem of the contract, and their differences from others."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.random import SFC64, Generator

from trackbench.core import linalg
from trackbench.core.angles import near
from trackbench.core.arrays import Array
from trackbench.core.distributions import Distribution, Gaussian, per_run_moments
from trackbench.core.random_streams import RunStreams
from trackbench.filters.base import AnyFilter
from trackbench.scenarios.base import Scenario, Simulation


class Estimates(NamedTuple):
    """Estimates of a filter at every step."""

    mean: Array
    """means (n_x, T + 1, M)"""
    cov: Array
    """covariances (n_x, n_x, T + 1, M)"""
    random: bool
    """whether the filter drew random numbers"""
    series: dict[str, Array]
    """NIS, weight of further models and log-likelihood (T, M), of filters that have them"""


def simulate(scenario: Scenario, runs: int, order: int = 1, seed: int = 1) -> Simulation:
    """Simulate the first ``runs`` runs of the scenario; in reverse order if ``order`` is -1.

    A recording has at most its own number of runs.
    """
    runs = min(runs, scenario.recorded_runs or runs)
    return scenario.simulate(RunStreams(seed, range(runs)[::order]), runs)


def run_filter(tracker: AnyFilter, scenario: Scenario, data: Simulation) -> Estimates:
    """Run the filter over the data, by `init` and one `step` after another; return its estimates.

    A program filters all steps in one call, since single steps would begin each run anew.
    """
    rng = new_rng()
    state = tracker.init(scenario.model, data.prior, rng)
    all_steps = None
    if tracker.runs_program:
        first_step = int(scenario.steps[1])
        all_steps = tracker.all_steps(scenario.model, state, data.measurements, first_step)
    # Step 1: copies of the estimates, as a filter may write all into one array, and the series of each
    # step.
    moments = [_copied_moments(tracker.estimate(state))]
    rows = []
    for i, k in enumerate(scenario.steps[1:]):
        if all_steps is None:
            state = tracker.step(scenario.model, state, data.measurements[:, i], int(k), rng)
        else:
            state = all_steps.state(i)
        moments.append(_copied_moments(tracker.estimate(state)))
        row = {}
        for name, value in tracker.diagnostics(state).items():
            if name in ("nis", "mode"):  # the diagnostics that checks read
                row[name] = value
        log_likelihood = tracker.log_likelihood(state)
        if log_likelihood is not None:
            row["log_likelihood"] = log_likelihood
        rows.append(row)
    # Step 2: stack them over the steps.
    series = {}
    for name in rows[-1]:  # each step has the same names
        series[name] = np.array([row[name] for row in rows])
    has_drawn = state_words(rng) != state_words(new_rng())
    return Estimates(
        mean=np.stack([estimate.mean for estimate in moments], axis=1),
        cov=np.stack([estimate.cov for estimate in moments], axis=2),
        random=has_drawn or depends_on_seed(tracker, scenario),
        series=series,
    )


def _copied_moments(estimate: Distribution) -> Gaussian:
    """Return the mean (n, M) and the covariance (n, n, M) of each run, in arrays of their own."""
    per_run = per_run_moments(estimate)
    return Gaussian(np.array(per_run.mean), np.array(per_run.cov))


@lru_cache(maxsize=16)
def depends_on_seed(tracker: AnyFilter, scenario: Scenario) -> bool:
    """Test whether a program draws random numbers: its estimates depend on the seed of the run."""
    if not tracker.runs_program:
        return False
    data = simulate(scenario, runs=2)
    means: list[Array] = []
    # The seed of `new_rng`, and another one.
    for rng in (new_rng(), Generator(SFC64(20260102))):
        state = tracker.init(scenario.model, data.prior, rng)
        steps = tracker.all_steps(scenario.model, state, data.measurements, int(scenario.steps[1]))
        # Without `all_steps` (None) the estimates before the first measurement are compared.
        means.append(steps.estimate.mean if steps else state.mean)
    return not np.array_equal(means[0], means[1], equal_nan=True)


def has_covariance(tracker: AnyFilter, scenario: Scenario) -> bool:
    """Test whether the estimates have covariances, as a filter may estimate means alone.

    That of the first state may be the prior's.
    """
    estimates = run_filter(tracker, scenario, simulate(scenario, runs=1))
    return not np.isnan(estimates.cov[:, :, 1:]).all()


def has_constant_covariance(estimates: Estimates) -> bool:
    """Test whether the covariance is the same at all steps, the start included, and in all runs.

    It is that of a filter of constant gain.
    """
    return not np.ptp(estimates.cov, axis=(2, 3)).any()


def alike(a: Estimates, b: Estimates) -> bool:
    """Test whether two runs of filters have equal means and covariances, bit for bit.

    The covariance of a filter that estimates the mean alone is NaN.
    """
    has_equal_mean = np.array_equal(a.mean, b.mean, equal_nan=True)
    return has_equal_mean and np.array_equal(a.cov, b.cov, equal_nan=True)


def deviation(
    estimates: Estimates, center: Estimates, rows: tuple[int, ...], horizon: int | None = None
) -> Array:
    """Return how far each run's estimates (M,) are from a reference's at most, in standard deviations.

    The largest deviation of any component at any step after the prior counts. It is infinite if an
    estimate is NaN, and the largest float if one is infinite. The means are (n, T + 1, M).

    ``center`` are the reference's estimates, whose standard deviations are the unit. ``rows`` are the
    rows of the state that are angles: whole turns are no deviation. Only the first ``horizon`` steps
    count; default: all.
    """
    sigma = np.sqrt(linalg.diagonal(center.cov))  # (n, T + 1, M)
    # The filter's state may have further components after those of the reference's.
    mean = near(estimates.mean[: len(sigma)], center.mean, rows)
    # A component that is known exactly has no spread: nothing is divided by zero.
    ratio = np.abs(mean - center.mean) / np.maximum(sigma, np.finfo(float).tiny)
    # Index 0 of the steps is the prior.
    last = None if horizon is None else horizon + 1
    return np.nan_to_num(ratio[:, 1:last].max(axis=(0, 1)), nan=np.inf)


def new_rng() -> Generator:
    """Return a new stream of random numbers, with the same seed for every check."""
    return Generator(SFC64(20260101))


def state_words(rng: Generator) -> list[int]:
    """Return the generator's state, which changes with every number that is drawn."""
    return rng.bit_generator.state["state"]["state"].tolist()
