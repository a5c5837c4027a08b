"""Checks of the contract that are left out for a filter, with the reasons.

A filter that cannot pass a check by its nature gives the reason in a class attribute:
``contract_exemptions = {"kalman": "uses no measurement"}``. The names are those of `checks.CHECKS`.
"""

from collections.abc import Callable

from trackbench.contract.estimates import alike, has_covariance, run_filter, simulate
from trackbench.contract.problems import PLANAR, RADAR, ModelDraws, planar, radar
from trackbench.contract.why_not_running import runs_on
from trackbench.filters.base import AnyFilter
from trackbench.filters.gaussian_base import GaussianFilter
from trackbench.scenarios.base import Scenario
from trackbench.scenarios.tracking import Tracking

_OWN_MODEL = "has constants of its own: `--on CONFIG` names an experiment that they belong to"
_OWN_MODEL_AT_PLACE = f"{_OWN_MODEL}, with a sensor that does not stand at the origin"


def find_exemptions(tracker: AnyFilter, scenario: Scenario, why_not_linear: str) -> dict[str, str]:
    """Return the checks that are left out for a filter on a scenario: the reasons by the checks' names.

    The names are those of `checks.CHECKS`. ``why_not_linear`` is the reason why the filter is not
    compared with the Kalman filter.
    """
    # Step 1: by the filter's nature.
    exempt: dict[str, str] = dict(type(tracker).contract_exemptions)
    if isinstance(tracker, GaussianFilter) and tracker.robust:
        exempt.setdefault("kalman", "weighs measurements by `robust`")
    if "kalman" in exempt:
        exempt.setdefault("consistency", exempt["kalman"])
    if "consistency" in exempt:
        exempt.setdefault("motion", exempt["consistency"])
    # This exemption leaves nothing else out: the consistency of a filter of one run is still checked.
    if tracker.loops_over_runs:
        exempt.setdefault("kalman", "a filter of one run is compared by its errors")
    if runs_on(tracker, scenario) and not has_covariance(tracker, scenario):
        why = "the filter gives no covariance"
        if tracker.runs_program:
            why = "the program answers no covariance"
        exempt["covariance"] = why
        exempt["consistency"] = why
        exempt.setdefault("kalman", why)
        # Its errors are compared with those of reference filters by the covariance.
        exempt["motion"] = why
    # Step 2: by the problem.
    is_contract_problem = scenario in (PLANAR, RADAR)
    if not is_contract_problem:
        exempt.setdefault("tracks", "is another problem than the contract's")
        exempt.setdefault("motion", exempt["tracks"])
        # With `--on` a filter may be one of the config's sensor alone.
        exempt.setdefault("equations", exempt["tracks"])
        # These three checks change the problem itself: its intervals, sensors or prior. They can do so
        # for the contract's problems and for the problem of a config (`ModelDraws`).
        if not isinstance(scenario, ModelDraws):
            exempt.setdefault("interval", exempt["tracks"])
            exempt.setdefault("place", exempt["tracks"])
            exempt.setdefault("angles", exempt["tracks"])
    elif not takes_model(tracker, of_radar=scenario is RADAR):
        exempt.setdefault("kalman", _OWN_MODEL)
        exempt.setdefault("consistency", _OWN_MODEL)
        exempt.setdefault("place", _OWN_MODEL_AT_PLACE)
        exempt.setdefault("motion", _OWN_MODEL)
        # A filter of one run gets dt, so these checks are fair without its model.
        if not tracker.loops_over_runs:
            exempt.setdefault("interval", _OWN_MODEL)
            exempt.setdefault("tracks", _OWN_MODEL)
    if scenario is not PLANAR:
        exempt.setdefault("kalman", why_not_linear)
    is_drawn_from_model = isinstance(scenario, ModelDraws) and not scenario.recorded_runs
    if not is_contract_problem and not is_drawn_from_model:
        exempt.setdefault("consistency", "has no reference filter")
    return exempt


def takes_model(tracker: AnyFilter, of_radar: bool) -> bool:
    """Test whether the filter uses the noise of the model that it is given.

    Its estimates then depend on the process noise or on the measurement noise. A filter of one run often
    has one of the two noises in a key: it must depend on both. ``of_radar`` chooses the contract's
    problem of a radar instead of the planar one.
    """
    make_problem: Callable[..., Tracking] = radar if of_radar else planar
    large_sigma = 120.0 if of_radar else 60.0  # three times the default of the problem
    if not runs_on(tracker, make_problem()):
        return True  # the checks report that the filter does not run
    # Step 1: two equal runs. If they differ, the filter draws random numbers of its own, and its
    # dependence on the noise cannot be seen.
    data = simulate(make_problem(), runs=3)
    first = run_filter(tracker, make_problem(), data)
    again = run_filter(tracker, make_problem(), data)
    if not alike(first, again):
        # A filter of all runs is written with the model, so it is taken to use it. A filter of one run,
        # such as a class of another library, more often has its noise in keys.
        return not tracker.loops_over_runs
    # Step 2: equal data with another process noise, of 16 times the default q, and with another
    # measurement noise.
    other_q = run_filter(tracker, make_problem(q=400.0), data)
    uses_q = not alike(first, other_q)
    other_sigma = run_filter(tracker, make_problem(sigma=large_sigma), data)
    uses_sigma = not alike(first, other_sigma)
    if tracker.loops_over_runs:
        return uses_q and uses_sigma
    return uses_q or uses_sigma
