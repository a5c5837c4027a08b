"""Check that `init` and `step` leave their arguments unchanged, and that equal steps are equal."""

from copy import deepcopy
from dataclasses import is_dataclass

import numpy as np

from trackbench.component_parts import field_values
from trackbench.contract.estimates import new_rng, simulate
from trackbench.contract.findings import ContractError
from trackbench.filters.base import AnyFilter
from trackbench.scenarios.base import Scenario


def check_purity(tracker: AnyFilter, scenario: Scenario) -> None:
    """Check that `init` and `step` leave their arguments unchanged, and that equal steps are equal."""
    data = simulate(scenario, runs=5)
    prior = deepcopy(data.prior)
    state = tracker.init(scenario.model, data.prior, new_rng())
    if not _equal(prior, data.prior):
        raise ContractError("the prior is written to; make a new array")
    # The same step twice, from equal arguments. Index 0 of the steps is that of the prior, which has no
    # measurement: the first measurement belongs to index 1.
    z = data.measurements[:, 0]
    k = int(scenario.steps[1])
    before = deepcopy((state, z))
    first = tracker.estimate(tracker.step(scenario.model, state, z, k, new_rng()))
    if not _equal(before, (state, z)):
        raise ContractError("the state or the measurement is written to; make a new array")
    # A filter may write all estimates into one array: the first one is copied before the second.
    first_mean = np.array(first.mean)
    second = tracker.estimate(tracker.step(scenario.model, state, z, k, new_rng()))
    if not np.array_equal(first_mean, second.mean, equal_nan=True):
        raise ContractError("the same step with the same noise gives another estimate")


def _equal(a: object, b: object) -> bool:
    """Test whether two values have equal arrays, also within tuples, lists and dataclasses.

    One of them is a copy of the other that was made before a filter's code ran. So both have the same
    types and lengths. Only arrays are compared: the check is on code that writes into an array.
    """
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return bool(np.array_equal(a, b, equal_nan=a.dtype.kind == "f"))
    if isinstance(a, tuple | list) and isinstance(b, tuple | list):
        return all(_equal(x, y) for x, y in zip(a, b, strict=True))
    if is_dataclass(a) and not isinstance(a, type):
        return all(_equal(value, getattr(b, key)) for key, value in field_values(a).items())
    return True
