"""Estimates of a filter on a problem of the contract, or the reason why it cannot run on it."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.random import SFC64, Generator

from trackbench.config.filter_requirements import meets_requirement
from trackbench.contract.seed_of_checks import new_rng, state_words
from trackbench.core.arrays import Array
from trackbench.core.distributions import Distribution, Gaussian, per_run_moments
from trackbench.core.random_streams import RunStreams
from trackbench.errors import in_line
from trackbench.filters.base import AnyFilter
from trackbench.plugins.guarded_code import guarded
from trackbench.plugins.returned_values import filter_conflicts
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
    """Test whether the estimates have covariances, as a program may answer means alone."""
    return not np.isnan(run_filter(tracker, scenario, simulate(scenario, runs=1)).cov).all()


def has_constant_covariance(estimates: Estimates) -> bool:
    """Test whether the covariance is the same at all steps, the start included, and in all runs.

    It is that of a filter of constant gain.
    """
    return not np.ptp(estimates.cov, axis=(2, 3)).any()


def runs_on(tracker: AnyFilter, scenario: Scenario) -> bool:
    """Test whether a filter accepts a scenario and runs on it without an exception."""
    return not why_not_running(tracker, scenario).text


class WhyNotRunning(NamedTuple):
    """Reason why a filter does not run on a scenario."""

    text: str = ""
    """empty if it runs"""
    is_failure: bool = False
    """True if the filter accepts the scenario, and then fails"""


def why_not_running(tracker: AnyFilter, scenario: Scenario) -> WhyNotRunning:
    """Return the reason why a filter does not accept a scenario, or fails when it runs on it."""
    is_accepted = False
    try:
        # `guarded`: the filter's code cannot end the program.
        with guarded(), np.errstate(all="ignore"):
            refusal = why_not(tracker, scenario)
            if refusal:
                return WhyNotRunning(refusal)
            is_accepted = True
            run_filter(tracker, scenario, simulate(scenario, runs=2))
    except Exception as error:
        words = in_line(str(error)) or type(error).__name__
        return WhyNotRunning(words, is_failure=is_accepted)
    return WhyNotRunning()


def why_not(tracker: AnyFilter, scenario: Scenario) -> str:
    """Explain why a filter cannot run on a scenario; an empty text if it can."""
    for requirement in tracker.all_requirements:
        if not meets_requirement(scenario, requirement):
            return f"needs {requirement}"
    conflicts = list(filter_conflicts(tracker, scenario).values())
    if conflicts:
        return conflicts[0]
    return ""


def alike(a: Estimates, b: Estimates) -> bool:
    """Test whether two runs of filters have equal means and covariances, bit for bit."""
    return np.array_equal(a.mean, b.mean) and np.array_equal(a.cov, b.cov)
