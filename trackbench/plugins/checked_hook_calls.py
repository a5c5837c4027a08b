"""Check, before anything runs, that plugin classes return the types and shapes that the runner needs.

A mistake that these checks miss would end as a traceback, or in a wrong number.
"""

from collections.abc import Callable
from typing import TypeVar

from trackbench.component_parts import is_foreign
from trackbench.filters.base import AnyFilter, WrongReturnError
from trackbench.plugins.guarded_code import guarded
from trackbench.plugins.plugin_errors import PluginError, plugin_code
from trackbench.scenarios.base import Scenario

S = TypeVar("S")
T = TypeVar("T")


def filter_conflicts(tracker: AnyFilter, scenario: Scenario) -> dict[str, str]:
    """Collect a filter's conflicts with the scenario; for plugins also what would stop the runner."""
    if not is_foreign(tracker):
        return tracker.conflicts(scenario)
    try:
        with plugin_code(tracker):
            conflicts: dict[str, str] = call_hook(tracker.conflicts, dict, scenario)
            sentences = call_hook(tracker.cautions, list, scenario)
            check_words(*conflicts, *conflicts.values(), *sentences)
            # Numbers of particles, from which the memory and the width of a block follow.
            for key in ("N", "particle_count", "max_particle_count"):
                number = getattr(tracker, key, 1)
                if not isinstance(number, int) or number < 1:
                    raise WrongReturnError(key, f"its {key} is {number!r}, no whole number")
            hash(tracker)  # raises an exception for keys that cannot be hashed, such as lists
    except PluginError as error:
        return {"": str(error)}
    return conflicts


def check_words(*texts: object) -> None:
    """Raise WrongReturnError unless all of these are words."""
    if not all(isinstance(text, str) for text in texts):
        raise WrongReturnError("conflicts", "conflicts and cautions are words, and these are not")


def call_hook(hook: Callable[[S], T], return_type: type, argument: S) -> T:
    """Call a plugin's ``hook(argument)``, and return its value.

    Raises the hook's error, or WrongReturnError for a value of another type than ``return_type``. For
    the type ``list`` it may also return a tuple.
    """
    with guarded():
        value = hook(argument)
    allowed_types = (list, tuple) if return_type is list else return_type
    if not isinstance(value, allowed_types):
        message = f"{hook.__name__} gives a {type(value).__name__}, not a {return_type.__name__}"
        raise WrongReturnError(hook.__name__, message)
    return value
