"""Check that equal runs give equal estimates, also beside copies of a state that make other steps."""

import random

import numpy as np

from trackbench.contract.estimates import new_rng, run_filter, simulate
from trackbench.contract.findings import ContractError, LeftOutError
from trackbench.evaluation.state_copies import make_state_copier
from trackbench.filters.base import AnyFilter
from trackbench.scenarios.base import Scenario


def check_repeats(tracker: AnyFilter, scenario: Scenario) -> None:
    """Check that a filter gives equal estimates twice, and draws its random numbers from `rng` alone.

    A copy of a state must also share no memory with the state.
    """
    data = simulate(scenario, runs=3)
    # `run_filter` begins each time with an equal `rng`. Other draws change numpy's or Python's state.
    before = repr((random.getstate(), np.random.get_state(legacy=False)))
    first = run_filter(tracker, scenario, data)
    second = run_filter(tracker, scenario, data)
    after = repr((random.getstate(), np.random.get_state(legacy=False)))
    if before != after:
        message = "draws from the global np.random or random"
        raise ContractError(f"{message}: noise comes from `rng` alone")
    if not np.array_equal(first.mean, second.mean, equal_nan=True):
        # A program outside of Python gets a number in place of `rng`.
        source = "SEED" if tracker.runs_program else "`rng`"
        message = "the estimates differ the second time"
        raise ContractError(f"{message}: noise comes from {source} alone")
    # For an external program no state is copied: it is sent all measurements from the first one again.
    if not tracker.runs_program:
        check_copies(tracker, scenario)


def check_copies(tracker: AnyFilter, scenario: Scenario) -> None:
    """Check that the estimates from a state stay the same if a copy of the state makes a step.

    Prediction errors and late measurements take such copies, of filters that may change their states.
    The check is left out for a filter whose estimates differ in any case.
    """
    if len(scenario.steps) < 3:
        return
    model = scenario.model
    first_step, second_step = scenario.steps[1:3].tolist()
    copy_state = make_state_copier(tracker, model)
    means = []
    for takes_copy in (False, False, True):
        # New data each time, as a filter may write to them: that is another breach.
        data = simulate(scenario, runs=3)
        z = data.measurements
        state = tracker.init(model, data.prior, new_rng())
        state = tracker.step(model, state, z[:, 0], first_step, new_rng())
        if takes_copy:
            tracker.step(model, copy_state(state), z[:, 1] + 1.0, second_step, new_rng())
        state = tracker.step(model, state, z[:, 1], second_step, new_rng())
        means.append(np.array(tracker.estimate(state).mean))
    if not np.array_equal(means[0], means[1], equal_nan=True):
        raise LeftOutError("the estimates differ the second time in any case")
    if not np.array_equal(means[0], means[2], equal_nan=True):
        raise ContractError(
            "a copy of a state (`copy.deepcopy`) shares memory with it, so that a step of the copy "
            "changes the estimates of the state: keep arrays in the state alone, or write `__deepcopy__`"
        )
