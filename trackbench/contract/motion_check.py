"""Check that a filter uses the kind of motion of its model, and not only its keys."""

from trackbench.contract.compare_with_references import (
    compare_with_references,
    misfit,
    runs_for,
    with_many_particles,
)
from trackbench.contract.estimates import run_filter, simulate
from trackbench.contract.findings import ContractError, LeftOutError
from trackbench.contract.problems import ONE_MOTION, OTHER_MOTION, RADAR, ModelDraws
from trackbench.contract.why_not_running import runs_on
from trackbench.filters.base import AnyFilter
from trackbench.scenarios.base import Scenario


def check_motion(tracker: AnyFilter, scenario: Scenario) -> None:
    """Check that a filter that fits one kind of motion also fits another kind with an equal key `q`.

    The two kinds are white-noise acceleration (`cwna`) and one with a noise that is constant in a step
    (`cv`). A filter fits if its errors and covariances are those of the reference filters.
    """
    name = "radar" if scenario is RADAR else "planar"
    one_motion = ModelDraws(base=ONE_MOTION[name])
    other_motion = ModelDraws(base=OTHER_MOTION[name])
    for problem in (one_motion, other_motion):
        if not runs_on(tracker, problem):
            raise LeftOutError("the filter refuses another motion")
    if "mode" in run_filter(tracker, one_motion, simulate(one_motion, runs=2)).series:
        # The reference filters have one motion, that of the model.
        raise LeftOutError("has several motions: it reports the diagnostic `mode`")
    precise_tracker = with_many_particles(tracker)
    if compare_with_references(precise_tracker, one_motion):
        raise LeftOutError("the errors do not fit with the first motion, either")
    difference = compare_with_references(precise_tracker, other_motion)
    if difference is None:
        return
    # The filter gets the other motion, and data of the first one. If it fits these, it ignores the kind;
    # otherwise it is an approximation that is worse with more noise.
    runs = runs_for(tracker)
    if not misfit(precise_tracker, one_motion, runs, tested_scenario=other_motion):
        text = (
            "fits with the motion `cwna`, and not with `cv` of the same `q`, which has another meaning "
            f"there: {difference.text}; take F and Q from the model"
        )
        if tracker.runs_program:
            text += ", which the first line has under `motion`, or answer `error` to other kinds"
        raise ContractError(text)
