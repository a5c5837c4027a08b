"""Check that a filter uses the place of a sensor, which may move."""

import numpy as np

from trackbench.contract.compare_with_references import compare_with_references, with_many_particles
from trackbench.contract.estimates import alike, run_filter, simulate
from trackbench.contract.findings import ContractError, LeftOutError
from trackbench.contract.other_sensors import with_sensors_at_origin
from trackbench.contract.problems import MOVING, PLACED, RADAR, ModelDraws
from trackbench.contract.why_not_running import runs_on
from trackbench.filters.base import AnyFilter
from trackbench.scenarios.base import Scenario


def check_place(tracker: AnyFilter, scenario: Scenario) -> None:
    """Check that the estimates depend on the place of a sensor, and fit one that moves."""
    if isinstance(scenario, ModelDraws):
        _check_place_of_config(tracker, scenario)
        return
    if not runs_on(tracker, RADAR):
        raise LeftOutError("the filter does not run on the contract's problem of a radar")
    if not runs_on(tracker, PLACED):
        raise LeftOutError("the filter refuses a radar that does not stand at the origin")
    if not _uses_measurements(tracker, PLACED):
        raise LeftOutError("the filter uses no measurement")
    # RADAR stands at the origin, PLACED elsewhere, and MOVING moves.
    problems = {"a radar at [-1500, 2000]": PLACED}
    if runs_on(tracker, MOVING):
        problems["a radar that moves on a `platform`"] = MOVING
    # Step 1: equal data, with the radar at its place and at the origin.
    for name, problem in problems.items():
        if not _depends_on_place(tracker, problem):
            message = f"with {name} the estimates equal those of a radar at the origin"
            raise ContractError(f"{message}; {_way_to_place(tracker, problem)}")
    # Step 2: the errors, if they fit with a radar at the origin. A filter with several motions, which
    # reports the diagnostic `mode`, has no reference filter.
    precise_tracker = with_many_particles(tracker)
    if "mode" in run_filter(tracker, RADAR, simulate(RADAR, runs=2)).series:
        return
    at_origin = with_sensors_at_origin(PLACED)
    assert at_origin is not None
    if compare_with_references(precise_tracker, at_origin):
        return
    for name, problem in problems.items():
        difference = compare_with_references(precise_tracker, ModelDraws(base=problem))
        if difference:
            message = f"fits with a radar at the origin, and not with {name}: {difference.text}"
            raise ContractError(f"{message}; {_way_to_place(tracker, problem)}")


def _check_place_of_config(tracker: AnyFilter, scenario: ModelDraws) -> None:
    """Check that the estimates depend on the places of a config's sensors.

    A filter may have the places of this problem as constants. So estimates that do not depend on them
    are no breach; the errors show whether the constants are right.
    """
    if with_sensors_at_origin(scenario) is None:
        raise LeftOutError(
            "the sensors of this problem stand at the origin; give `--on` a config whose sensor stands "
            "elsewhere, as by `at: [-1500, 2000]`; without `--on` a radar elsewhere is tried for a "
            "filter that takes q and R from the model"
        )
    if not _depends_on_place(tracker, scenario):
        raise LeftOutError(
            "the estimates do not depend on the places of the sensors, which may be constants of the "
            "filter; its errors show whether they are right"
        )


def _depends_on_place(tracker: AnyFilter, problem: Scenario) -> bool:
    """Test whether estimates from equal data change if all sensors are moved to the origin.

    A sensor of the problem must stand elsewhere. A filter that does not run with sensors at the origin
    depends on the place.
    """
    at_origin = with_sensors_at_origin(problem)
    assert at_origin is not None
    if not runs_on(tracker, at_origin):
        return True
    # A few runs are enough: the place of the sensor changes every estimate.
    data = simulate(problem, runs=3)
    at_place = run_filter(tracker, problem, data)
    return not alike(at_place, run_filter(tracker, at_origin, data))


def _uses_measurements(tracker: AnyFilter, problem: Scenario) -> bool:
    """Test whether estimates change if all measurements are missing (NaN)."""
    data = simulate(problem, runs=3)
    without = data._replace(measurements=np.full_like(data.measurements, np.nan))
    return not alike(run_filter(tracker, problem, data), run_filter(tracker, problem, without))


def _way_to_place(tracker: AnyFilter, problem: Scenario) -> str:
    """Advise how a filter takes the place of a sensor from its model, or refuses such a sensor."""
    if problem is MOVING:
        text = "subtract from the position the place of the sensor at each step"
        if tracker.runs_program:
            return f"{text}, or answer `error` to a sensor that has the key `platform`"
        return text
    text = "subtract the place `at` of the sensor from the position"
    if tracker.runs_program:
        return f"{text}, or answer `error` to an `at` that is not [0.0,0.0]"
    return text
