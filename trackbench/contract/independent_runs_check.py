"""Check that no run depends on other runs."""

import numpy as np

from trackbench.contract.estimates import run_filter, simulate
from trackbench.contract.findings import ContractError
from trackbench.filters.base import AnyFilter
from trackbench.scenarios.base import Scenario


def check_independence(tracker: AnyFilter, scenario: Scenario) -> None:
    """Check that no run depends on the measurements, the order or the number of other runs."""
    runs = 6
    data = simulate(scenario, runs)
    together = run_filter(tracker, scenario, data)
    # Step 1: another measurement in the first or the last run changes this run alone.
    for run, other_runs in ((0, slice(1, None)), (-1, slice(None, -1))):
        measurements = data.measurements.copy()
        measurements[..., run] += 1.0
        changed = run_filter(tracker, scenario, data._replace(measurements=measurements))
        before = together.mean[..., other_runs]
        after = changed.mean[..., other_runs]
        if not np.array_equal(before, after, equal_nan=True):
            message = "another measurement in one run changes the estimates of the others"
            raise ContractError(message)
    # Step 2: without random numbers neither the order of the runs nor their number matters. Only the
    # last digits may depend on them, as those of a filter with `mixes_runs` do.
    if together.random:
        return
    reversed_runs = run_filter(tracker, scenario, simulate(scenario, runs, order=-1))
    mean = reversed_runs.mean[..., ::-1]
    if not np.allclose(mean, together.mean, rtol=1e-10, atol=1e-10, equal_nan=True):
        raise ContractError("the estimates depend on the order of the runs")
    alone = run_filter(tracker, scenario, simulate(scenario, runs=1)).mean
    if not np.allclose(alone, together.mean[..., :1], rtol=1e-10, atol=1e-10, equal_nan=True):
        raise ContractError("the first run has another estimate without the other runs")
