"""Copies of a filter's states, which the filter's later steps leave as they are."""

from collections.abc import Callable
from copy import deepcopy
from typing import Any

from trackbench.component_parts import foreign_parts
from trackbench.filters.base import AnyFilter
from trackbench.models.base import Model


def make_state_copier(tracker: AnyFilter, model: Model) -> Callable[[Any], Any]:
    """Return a function that copies a state of the filter, or returns it if no step can change it.

    A filter that loops over runs, such as a program, has an object for each run, which changes with
    every step. A plugin that breaks the contract writes to the arrays of its state.

    Parameters
    ----------
    tracker
        filter
    model
        model that the filter assumes; it is not copied

    Returns
    -------
    callable
        function of a state that returns a state
    """
    may_change_states = tracker.loops_over_runs or bool(foreign_parts(tracker))

    def copy_state(state: Any) -> Any:
        if not may_change_states:
            return state
        # The second argument keeps the model, which the objects share, from being copied.
        return deepcopy(state, {id(model): model})

    return copy_state
