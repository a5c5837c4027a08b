"""Check that a filter uses the interval between steps, also if intervals are unequal."""

from collections.abc import Callable

import numpy as np

from trackbench.contract.compare_with_references import (
    compare_with_references,
    runs_for,
    with_many_particles,
)
from trackbench.contract.estimates import alike, has_constant_covariance, run_filter, simulate
from trackbench.contract.findings import ContractError, LeftOutError
from trackbench.contract.kalman_check import difference_from_ekf
from trackbench.contract.problems import PLANAR, RADAR, UNEQUAL, ModelDraws, planar, radar
from trackbench.contract.why_not_running import WhyNotRunning, why_not_running
from trackbench.filters.base import AnyFilter
from trackbench.scenarios.base import Scenario
from trackbench.scenarios.tracking import Tracking


def check_interval(tracker: AnyFilter, scenario: Scenario) -> None:
    """Check that the estimates depend on the interval between steps, and on unequal intervals.

    ``scenario`` is PLANAR or RADAR, or the problem of a config, a `ModelDraws`. A filter may have the
    interval of the config as a constant: only unequal intervals are then checked.
    """
    if isinstance(scenario, ModelDraws):
        _check_unequal_intervals(tracker, scenario)
        return
    make_problem: Callable[..., Scenario] = radar if scenario is RADAR else planar
    data = simulate(make_problem(), runs=3)
    first = run_filter(tracker, make_problem(), data)
    # Twice the interval of the contract's problems.
    changed_problems: dict[str, Scenario] = {"the interval dt": make_problem(T=4.0)}
    if scenario is PLANAR:
        # PLANAR, with intervals that differ from step to step.
        why = why_not_running(tracker, UNEQUAL)
        _check_no_failure(tracker, why)
        if not why.text:
            changed_problems["intervals after the first"] = UNEQUAL
    # The data stay the same: only the times and the model that the filter gets change.
    for name, problem in changed_problems.items():
        if alike(first, run_filter(tracker, problem, data)):
            message = f"the estimates do not depend on {name}: is it ignored?"
            raise ContractError(f"{message} A filter of one interval is checked with `--on CONFIG`")


def _check_no_failure(tracker: AnyFilter, why: WhyNotRunning) -> None:
    """Raise ContractError if a program fails at unequal intervals, for the reason ``why``.

    It may answer `error` to them, but must not begin and fail.
    """
    if why.is_failure and tracker.runs_program:
        raise ContractError(f"fails at unequal intervals, where T is null: {why.text}")


def _check_unequal_intervals(tracker: AnyFilter, scenario: ModelDraws) -> None:
    """Check that a filter that fits the problem of a config also fits it at unequal intervals."""
    other = at_unequal_intervals(scenario)
    if other is None:
        raise LeftOutError("the steps of this problem cannot be unequal")
    why = why_not_running(tracker, other)
    _check_no_failure(tracker, why)
    if why.text:
        if why_not_running(tracker, scenario).text:
            raise LeftOutError("the filter does not run at equal intervals, either")
        raise LeftOutError("the filter refuses unequal intervals")
    two_runs = run_filter(tracker, other, simulate(other, runs=2))
    if "mode" in two_runs.series:
        # The reference filters have one motion, that of the model.
        raise LeftOutError("has several motions: it reports the diagnostic `mode`")
    if has_constant_covariance(two_runs):
        raise LeftOutError("the covariance is constant: its gain is that of one interval")
    # Step 1: its errors, in comparison with reference filters.
    precise_tracker = with_many_particles(tracker)
    runs = runs_for(tracker)
    if compare_with_references(precise_tracker, scenario):
        raise LeftOutError("the errors do not fit at equal intervals, either")
    difference = compare_with_references(precise_tracker, other)
    if difference:
        raise ContractError(f"fits at equal intervals and not at unequal ones: {difference.text}")
    # Step 2: its estimates, if they equal those of the EKF at equal intervals. They show a wrong Q,
    # which hardly changes the errors.
    if two_runs.random or difference_from_ekf(precise_tracker, scenario, runs):
        return
    message = difference_from_ekf(precise_tracker, other, runs)
    if message:
        raise ContractError(f"is the EKF at equal intervals and not at unequal ones: {message}")


def at_unequal_intervals(problem: Scenario) -> ModelDraws | None:
    """Vary the intervals of a config's problem from step to step; None if they cannot vary."""
    # The problem of a config is a `ModelDraws`, whose only fields are `base` and `unequal`.
    if not isinstance(problem, ModelDraws):
        return None
    base = problem.base
    # Two intervals, which can differ, take three steps.
    if not isinstance(base, Tracking) or len(base.steps) < 3:
        return None
    # None: the target has no motion, and the filters assume none. A motion that depends on the time k T
    # needs equal intervals.
    motion = base.assume.motion or base.target.own_motion
    if motion is None or motion.uses_time:
        return None
    has_equal_intervals = np.ptp(np.diff(base.times)) < 1e-9 * base.T
    if not has_equal_intervals:
        return None
    return ModelDraws(base=base, unequal=True)
