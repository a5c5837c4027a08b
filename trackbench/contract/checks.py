"""Checks of the contract: each raises ContractError with a breach in one line."""

import random
from collections.abc import Callable
from copy import deepcopy
from dataclasses import is_dataclass
from typing import TypeAlias

import numpy as np

from trackbench.component_parts import field_values
from trackbench.contract.agreement_with_kalman import check_against_kalman
from trackbench.contract.angles import angles_of, mistaken_angle
from trackbench.contract.compare_with_references import (
    compare_with_references,
    misfit,
    runs_for,
    with_many_particles,
)
from trackbench.contract.covariance_check import check_covariance
from trackbench.contract.estimates import (
    run_filter,
    runs_on,
    simulate,
)
from trackbench.contract.findings import ContractError, LeftOutError
from trackbench.contract.likely_cause import PLACE_IGNORED, mistaken_track
from trackbench.contract.missing_measurements import check_gaps
from trackbench.contract.problems import (
    ONE_MOTION,
    OTHER_MOTION,
    PLANAR,
    PRECISE,
    RADAR,
    UNEQUAL,
    ModelDraws,
)
from trackbench.contract.seed_of_checks import new_rng
from trackbench.contract.sensor_place import check_place
from trackbench.contract.unequal_intervals import check_interval
from trackbench.core.arrays import with_trailing
from trackbench.core.distributions import Gaussian
from trackbench.evaluation.allowed_metric_names import check_diagnostic_names
from trackbench.evaluation.state_copies import make_state_copier
from trackbench.evaluation.validate_returned_arrays import check_estimate, checked_numbers
from trackbench.filters.base import AnyFilter, Steps, declares_diagnostics, has_likelihood
from trackbench.filters.external import External
from trackbench.filters.float32_digits import FLOAT32_NOTE, PRINT_ALL_DIGITS, float32_advice
from trackbench.scenarios.base import Scenario

Check: TypeAlias = Callable[[AnyFilter, Scenario], str | None]
"""A check of the contract, which raises ContractError; it may return what was tried, or a note."""


def _check_shapes(tracker: AnyFilter, scenario: Scenario) -> None:
    """Check shapes and types of estimates and diagnostics, and `all_steps` against `step`."""
    runs = 5
    rng = new_rng()
    data = simulate(scenario, runs)
    n = data.truth.shape[0]
    state = tracker.init(scenario.model, data.prior, rng)
    first_step = int(scenario.steps[0]) + 1
    # Step 1: all steps at once, if the filter can.
    all_steps = tracker.all_steps(scenario.model, state, data.measurements, first_step)
    if all_steps is not None and all_steps.estimate.mean.shape[1] != len(scenario.steps) - 1:
        message = f"{all_steps.estimate.mean.shape[1]} states, not one per measurement"
        raise ContractError(f"all_steps gives {message}")
    # Step 2: step through the scenario; check the estimate and the other numbers at each step. The first
    # step (i = 0) is that of the prior, which has no measurement.
    has_single_precision = True
    has_fractions = False
    first = tracker.estimate(state)
    changes = False
    for i, k in enumerate(scenario.steps):
        if i:
            state = tracker.step(scenario.model, state, data.measurements[:, i - 1], int(k), rng)
        estimate = tracker.estimate(state)
        changes = changes or not np.array_equal(estimate.mean, first.mean)
        if i and all_steps is not None:
            _compare_with_all_steps(tracker, all_steps, estimate, i, int(k))
        # Estimate and truth have the same number n of components.
        check_estimate(estimate, (n, n), runs)
        for name, array in (("mean", estimate.mean), ("cov", estimate.cov)):
            if np.asarray(array).dtype != np.float64:
                raise ContractError(f"{name} at step {k} is of {np.asarray(array).dtype}")
            # A program may answer a mean without a covariance.
            is_unanswered = name == "cov" and tracker.runs_program and np.isnan(array).all()
            if not np.isfinite(array).all() and not is_unanswered:
                raise ContractError(f"{name} at step {k} is not finite")
            if i and not np.array_equal(array, np.float32(array)):
                has_single_precision = False
            # Whole numbers are the same in float32.
            has_fractions = has_fractions or bool((array != np.rint(array)).any())
        diagnostics = checked_numbers("diagnostic", tracker.diagnostics(state), runs)
        if i and all_steps is not None:
            for name, value in diagnostics.items():
                rows = all_steps.diagnostics.get(name)
                if rows is None or not np.allclose(rows[i - 1], value, equal_nan=True):
                    message = f"another {name} than step at step {k}"
                    raise ContractError(f"all_steps gives {message}")
        check_diagnostic_names(diagnostics)
        names = sorted(tracker.diagnostic_names)
        if i and declares_diagnostics(type(tracker)) and sorted(diagnostics) != names:
            gives = f"diagnostics gives {sorted(diagnostics)}"
            raise ContractError(f"diagnostic_names is {names}, {gives}")
        if i and has_likelihood(tracker):
            checked_numbers("series", {"log_likelihood": tracker.log_likelihood(state)}, runs)
    # Step 3: the digits of all estimates; those of a program are another check. Estimates that stay as
    # they began have the digits of the start, whatever they are computed in.
    if has_single_precision and has_fractions and changes and not tracker.runs_program:
        raise ContractError("the estimates have the digits of float32: compute in float64")


def _check_digits(tracker: AnyFilter, scenario: Scenario) -> str:
    """Check that a program prints enough digits; return a note if they are those of float32."""
    assert isinstance(tracker, External)
    data = simulate(scenario, runs=5)
    first_step = int(scenario.steps[0]) + 1
    digits = tracker.digits(scenario.model, data.prior, data.measurements, first_step)
    # `too_few` is a text, such as "at most 6 digits"; empty if there are enough.
    if digits.too_few:
        raise ContractError(f"answers have {digits.too_few}: {PRINT_ALL_DIGITS}; of float32 `%.9g`")
    if not digits.is_float32:
        return ""
    estimates = run_filter(tracker, scenario, data)
    components = scenario.model.motion.components
    # The first estimate is the prior, which trackbench has written.
    mean = estimates.mean[:, 1:]
    cov = estimates.cov[:, :, 1:]
    advice = float32_advice(mean, cov, components, digits.printed)
    if advice:
        return f"{FLOAT32_NOTE}. Here {advice}"
    return FLOAT32_NOTE


def _compare_with_all_steps(
    tracker: AnyFilter, all_steps: Steps, estimate: Gaussian, i: int, k: int
) -> None:
    """Raise ContractError if `all_steps` gives another estimate after ``i`` steps, at step ``k``.

    ``all_steps`` is the result of this method of the filter. ``estimate`` is that of ``i`` calls of
    `step`.
    """
    state_estimate = tracker.estimate(all_steps.state(i - 1))
    # One covariance of all runs may stand for equal ones: then an axis of length 1 stands for the runs.
    cov = with_trailing(estimate.cov, 1, leading=2)
    pairs = [
        (state_estimate.mean, estimate.mean),
        (with_trailing(state_estimate.cov, 1, leading=2), cov),
        (all_steps.estimate.mean[:, i - 1], estimate.mean),
        (all_steps.estimate.cov[:, :, i - 1], cov),
    ]
    if not all(np.allclose(a, b, rtol=1e-6, atol=0.0, equal_nan=True) for a, b in pairs):
        raise ContractError(f"all_steps gives another estimate than step at step {k}")


def _check_purity(tracker: AnyFilter, scenario: Scenario) -> None:
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


def _check_repeats(tracker: AnyFilter, scenario: Scenario) -> None:
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
        _check_copies(tracker, scenario)


def _check_copies(tracker: AnyFilter, scenario: Scenario) -> None:
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


def _check_independence(tracker: AnyFilter, scenario: Scenario) -> None:
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


def _check_motion(tracker: AnyFilter, scenario: Scenario) -> None:
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


def _check_tracks(tracker: AnyFilter, scenario: Scenario) -> None:
    """Check that estimates follow a fast target in the plane, on one of the contract's problems."""
    # PLANAR has a position sensor, PRECISE a radar. A filter for one of these sensors may run on the
    # other one, too, and go wrong there: one problem is enough.
    mistakes = []
    for problem in (PLANAR, PRECISE):
        if runs_on(tracker, problem):
            mistakes.append(mistaken_track(tracker, problem))
    if mistakes and all(mistakes):
        raise ContractError(mistakes[0])


def _check_consistency(tracker: AnyFilter, scenario: Scenario) -> None:
    """Check errors and covariance against reference filters, on draws from the filter's model.

    In place of the linear problem PLANAR a filter is checked on UNEQUAL, if it runs there. That is
    PLANAR with intervals that differ from step to step, so that a wrong use of dt shows, too.
    """
    if "mode" in run_filter(tracker, scenario, simulate(scenario, runs=2)).series:
        # The reference filters have one motion, that of the model.
        raise LeftOutError("has several motions: it reports the diagnostic `mode`")
    problems = [scenario]
    if scenario is PLANAR:
        problems = [UNEQUAL if runs_on(tracker, UNEQUAL) else PLANAR]
        # PRECISE is an accurate radar far from the jump of the azimuth. A filter that follows a target
        # with it works for radars, and is checked with RADAR too, where the azimuth jumps by 2 pi.
        if runs_on(tracker, PRECISE) and not mistaken_track(tracker, PRECISE):
            problems.append(RADAR)
    precise_tracker = with_many_particles(tracker)
    for problem in problems:
        drawn_problem = problem if isinstance(problem, ModelDraws) else ModelDraws(base=problem)
        difference = compare_with_references(precise_tracker, drawn_problem)
        if difference:
            raise ContractError(difference.text)


def _check_angles(tracker: AnyFilter, scenario: Scenario) -> None:
    """Check that a filter does not go wrong where an angle crosses its cut, such as pi.

    The prior is turned about the sensor until the angles cross it. A filter that runs on the contract's
    linear problem, PLANAR, is checked with a radar instead, if it runs with one.
    """
    if scenario is PLANAR and runs_on(tracker, RADAR):
        scenario = RADAR
    problem = scenario if isinstance(scenario, ModelDraws) else ModelDraws(base=scenario)
    if not angles_of(problem):
        where = "this problem" if isinstance(scenario, ModelDraws) else "the contract's problem"
        raise LeftOutError(f"{where} has no angle; `--on CONFIG` names an experiment with one")
    # The prior is turned as a normal distribution, which lacks the attributes of other priors.
    for requirement in tracker.all_requirements:
        if requirement.startswith("prior."):
            raise LeftOutError(f"needs {requirement}, which a turned problem has not")
    message = mistaken_angle(with_many_particles(tracker), problem)
    # None: the angles could not be tested; empty: no mistake was found.
    if message is None:
        why = (
            "no angle passes its cut, no reference filter runs, or the filter is far off everywhere"
        )
        raise LeftOutError(f"{why}; `--on CONFIG` names an experiment that it is written for")
    if message:
        # A filter with a wrong place counts every angle wrongly.
        difference = compare_with_references(with_many_particles(tracker), problem)
        if difference and difference.ignores_place:
            raise LeftOutError(f"cannot be tested, as {PLACE_IGNORED}")
        raise ContractError(message)


CHECKS: dict[str, tuple[str, Check]] = {
    "shapes": ("shapes", _check_shapes),
    "digits": ("answers have enough digits", _check_digits),
    "purity": ("step leaves its arguments unchanged", _check_purity),
    "repeats": ("equal runs give equal estimates", _check_repeats),
    "copies": ("copies of a state are independent", _check_copies),
    "independence": ("runs are independent", _check_independence),
    "covariance": ("covariance is symmetric and positive definite", check_covariance),
    "gaps": ("predicts over a missing measurement", check_gaps),
    "interval": ("uses the interval between steps", check_interval),
    "tracks": ("follows the target", _check_tracks),
    "motion": ("uses the motion of the model", _check_motion),
    "place": ("uses the place of the sensor", check_place),
    "angles": ("wraps angles at their cut", _check_angles),
    "kalman": ("equals the Kalman filter on a linear model", check_against_kalman),
    "consistency": ("errors and covariance fit reference filters", _check_consistency),
}
"""Title and function of each check, by the name used in `contract_exemptions`.

`digits` checks programs alone. `repeats` includes `copies`, which is a check of its own if `repeats` is
left out.
"""
