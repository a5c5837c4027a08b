"""Errors of a filter's posterior means of functions of the state, such as the mean range."""

import numpy as np

from trackbench.core.arrays import Array
from trackbench.evaluation.validate_returned_arrays import checked_numbers
from trackbench.filters.base import Filter, State, has_expectations
from trackbench.scenarios.base import Scenario


def observable_errors(
    scenario: Scenario, tracker: Filter[State], state: State, truth: Array
) -> dict[str, Array]:
    """Return the squared and signed errors of the scenario's observables at one step.

    Observables are functions of the state that the scenario names. The filter's expectation of each is
    compared with the value at the truth.

    Parameters
    ----------
    scenario
        scenario, which names the observables
    tracker
        filter
    state
        state of the filter after the step
    truth
        true states (n_x, M)

    Returns
    -------
    dict
        ``squared_<name>`` and ``error_<name>`` (M,). Empty if the filter computes no expectations, or
        the scenario names no observables

    Raises
    ------
    WrongReturnError
        if the filter returns other expectations than numbers (M,) by name
    """
    if not has_expectations(tracker):
        return {}
    exact = scenario.observables(truth)
    if not exact:
        return {}
    expectations = tracker.expectation(state, scenario.observables)
    errors: dict[str, Array] = {}
    for name, value in checked_numbers("expectation", expectations, truth.shape[1]).items():
        error = value - exact[name]
        errors[f"squared_{name}"] = np.square(error)
        errors[f"error_{name}"] = error
    return errors
