"""Checks of the contract: each raises ContractError with a breach in one line."""

import random
from collections.abc import Callable
from copy import deepcopy
from dataclasses import fields, is_dataclass, replace
from functools import lru_cache
from typing import TypeAlias

import numpy as np

from trackbench.component_parts import field_values
from trackbench.contract.angles import angles_of, mistaken_angle
from trackbench.contract.diagnosis import PLACE_IGNORED, Misfit, misfit, mistaken_track
from trackbench.contract.estimates import (
    Estimates,
    WhyNotRunning,
    has_constant_covariance,
    new_rng,
    run_filter,
    runs_on,
    simulate,
    why_not,
    why_not_running,
    with_gaps,
)
from trackbench.contract.problems import (
    MOVING,
    ONE_MOTION,
    OTHER_MOTION,
    PLACED,
    PLANAR,
    PRECISE,
    RADAR,
    UNEQUAL,
    ModelDraws,
    WholeExperiment,
    at_unequal_intervals,
    planar,
    radar,
    with_sensors_at_origin,
)
from trackbench.core import linalg
from trackbench.core.angles import near
from trackbench.core.arrays import Array, Index, Mask, with_trailing
from trackbench.core.distributions import Gaussian
from trackbench.errors import counted
from trackbench.evaluation.allowed_metric_names import check_diagnostic_names
from trackbench.evaluation.state_copies import make_state_copier
from trackbench.evaluation.validate_output import check_estimate, check_names, checked_numbers
from trackbench.filters.base import AnyFilter, Steps, declares_diagnostics, has_likelihood
from trackbench.filters.ekf import EKF
from trackbench.filters.external import External
from trackbench.filters.printed_digits import FLOAT32_NOTE, PRINT_ALL_DIGITS, float32_advice
from trackbench.scenarios.base import Scenario

Check: TypeAlias = Callable[[AnyFilter, Scenario], str | None]
"""A check of the contract, which raises ContractError; it may return what was tried, or a note."""

_RUNS = 200  # on which a filter is compared with reference filters
_LOOPED_RUNS = 80  # of a filter that loops over its runs in Python
_LEAST_N = 1000  # particles with which a particle filter is compared with the package's
_TOLERANCE = 1e-7  # of correlations, in float64
_FLOAT32_TOLERANCE = 1e-6  # of correlations, in float32
_FLOAT32_COVARIANCE = (
    "the filter computes in float32: make P symmetric after each step, and take the Joseph form or a "
    "square root of P, or compute in double"
)
_MAX_DEVIATION = 4.5  # standard errors; none of a few dozen comparisons should exceed it


class ContractError(Exception):
    """Breach of the contract, in one line."""


class LeftOutError(Exception):
    """Reason why a check does not apply."""


def alike(a: Estimates, b: Estimates) -> bool:
    """Test whether two runs of filters have equal means and covariances, bit for bit."""
    return np.array_equal(a.mean, b.mean) and np.array_equal(a.cov, b.cov)


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

    Values of other types count as equal.
    """
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return bool(np.array_equal(a, b, equal_nan=a.dtype.kind == "f"))
    if isinstance(a, tuple | list) and isinstance(b, tuple | list):
        return all(_equal(x, y) for x, y in zip(a, b, strict=True))
    if is_dataclass(a) and not isinstance(a, type):
        return all(_equal(value, getattr(b, key)) for key, value in field_values(a).items())
    return True


def _check_repeats(tracker: AnyFilter, scenario: Scenario) -> None:
    """Check that a filter gives equal estimates twice, and draws its random numbers from `rng` alone."""
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
    # The state of a program is that of its lines, which are sent again.
    if not tracker.runs_program and not _has_independent_copies(tracker, scenario):
        raise ContractError(
            "a copy of a state (`copy.deepcopy`) shares memory with it, so that a step of the copy "
            "changes the estimates of the state: keep arrays in the state alone, or write `__deepcopy__`"
        )


def _has_independent_copies(tracker: AnyFilter, scenario: Scenario) -> bool:
    """Test whether the estimates from a state stay the same if a copy of the state makes a step.

    Prediction errors and late measurements take such copies, of filters that may change their states.
    """
    if len(scenario.steps) < 3:
        return True
    model = scenario.model
    first_step, second_step = scenario.steps[1:3].tolist()
    copy_state = make_state_copier(tracker, model)
    means = []
    for takes_copy in (False, True):
        # New data each time, as a filter may write to them: that is another breach.
        data = simulate(scenario, runs=3)
        z = data.measurements
        state = tracker.init(model, data.prior, new_rng())
        state = tracker.step(model, state, z[:, 0], first_step, new_rng())
        if takes_copy:
            tracker.step(model, copy_state(state), z[:, 1] + 1.0, second_step, new_rng())
        state = tracker.step(model, state, z[:, 1], second_step, new_rng())
        means.append(np.array(tracker.estimate(state).mean))
    return np.array_equal(means[0], means[1], equal_nan=True)


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
    reversed_runs = run_filter(tracker, scenario, simulate(scenario, runs, step=-1))
    mean = reversed_runs.mean[..., ::-1]
    if not np.allclose(mean, together.mean, rtol=1e-10, atol=1e-10, equal_nan=True):
        raise ContractError("the estimates depend on the order of the runs")
    alone = run_filter(tracker, scenario, simulate(scenario, runs=1)).mean
    if not np.allclose(alone, together.mean[..., :1], rtol=1e-10, atol=1e-10, equal_nan=True):
        raise ContractError("the first run has another estimate without the other runs")


def _check_covariance(tracker: AnyFilter, scenario: Scenario) -> str:
    """Check that covariances are symmetric and positive definite; return what was tried.

    Of a config's problem the runs of the experiment itself are tried, too, over its whole length: a
    covariance may become indefinite late, and off the model.
    """
    tried = _try_covariances(tracker, scenario, runs=20)
    if isinstance(scenario, ModelDraws):
        whole = WholeExperiment(base=scenario.base)
        tried += f" and {_try_covariances(tracker, whole, whole.runs, ' of the experiment')}"
    return tried


def _try_covariances(tracker: AnyFilter, problem: Scenario, runs: int, source: str = "") -> str:
    """Check the covariances of some runs of a problem; return a text with the number of runs and steps.

    ``source`` is a text that is put after it, such as " of the experiment".
    """
    estimates = run_filter(tracker, problem, simulate(problem, runs))
    # A recording may have fewer runs.
    runs = min(runs, problem.recorded_runs or runs)
    tried = f"{counted(runs, 'run')} of {counted(len(problem.steps) - 1, 'step')}{source}"
    try:
        _require_covariances(estimates.cov, problem.steps, tried)
    except ContractError as error:
        if not _is_float32(estimates.cov[:, :, 1:]):
            raise
        # The rounding of float32 is the likely cause: add how to compute in double.
        components = problem.model.motion.components
        advice = float32_advice(estimates.mean[:, 1:], estimates.cov[:, :, 1:], components)
        raise ContractError(f"{error}; {advice or _FLOAT32_COVARIANCE}") from None
    return tried


def _require_covariances(P: Array, steps: Index, tried: str) -> None:
    """Raise ContractError unless P (n, n, T + 1, M) are symmetric and positive definite.

    ``steps`` (T + 1,) are the numbers of the steps, ``tried`` names the runs.
    """
    known = np.isfinite(P)
    if (known != np.swapaxes(known, 0, 1)).any():
        raise ContractError(
            "not symmetric: an entry is NaN or infinite, and its mirror image is not"
        )
    # Compare correlations, so that units do not matter. The least sigma keeps those of a component that
    # is known exactly or has collapsed from being rounding errors.
    sigma = np.sqrt(np.abs(linalg.diagonal(P)))
    least_sigma = 1e-6 * np.nanmax(sigma, axis=(1, 2), keepdims=True)
    limited_sigma = np.maximum(sigma, least_sigma)
    scale = np.where(limited_sigma > 0.0, limited_sigma, 1.0)
    all_correlations = np.moveaxis(P / (scale[:, None] * scale), (0, 1), (-2, -1))
    # Entries that are not finite count as zero: they are reported by other checks.
    is_finite = np.isfinite(all_correlations).all(axis=(-2, -1))
    correlations = np.where(is_finite[..., None, None], all_correlations, 0.0)
    difference = np.abs(correlations - np.swapaxes(correlations, -2, -1)).max(axis=(-2, -1))
    # The tolerance is that of rounding, also in float32.
    tolerance = _FLOAT32_TOLERANCE if _is_float32(P) else _TOLERANCE
    if difference.max() > tolerance:
        where = _name_places(difference > tolerance, steps, tried)
        message = f"not symmetric: correlations differ by {difference.max():.2g}, {where}"
        raise ContractError(f"{message}; keep (P + P') / 2 after each update")
    least_eigenvalue = np.linalg.eigvalsh(correlations).min(axis=-1)
    if least_eigenvalue.min() < -tolerance:
        where = _name_places(least_eigenvalue < -tolerance, steps, tried)
        message = f"the correlations have an eigenvalue {least_eigenvalue.min():.2g}, {where}"
        raise ContractError(f"not positive definite: {message}")


def _is_float32(values: Array) -> bool:
    """Test whether the variances of covariances (n, n, ...) are numbers of float32.

    Covariances of a program may be made symmetric: such an entry is the mean of two float32 numbers, and
    no such number itself.
    """
    variances = np.einsum("ii...->i...", values)
    with np.errstate(over="ignore", under="ignore"):
        return np.array_equal(variances, np.float32(variances), equal_nan=True)


def _name_places(is_wrong: Mask, steps: Index, tried: str) -> str:
    """Name the first step with a mistake, and the number of runs that have one.

    ``is_wrong`` (T + 1, M) marks the mistakes, and ``steps`` (T + 1,) are the numbers of the steps.
    ``tried`` is the text on how many runs and steps were tried.
    """
    first = int(steps[np.flatnonzero(is_wrong.any(axis=1))[0]])
    return f"first at step {first}, in {is_wrong.any(axis=0).sum()} of {tried}"


def _check_gaps(tracker: AnyFilter, scenario: Scenario) -> None:
    """Check that a filter predicts where a measurement is missing, and does not take it as a number."""
    data = simulate(scenario, runs=6)
    z = data.measurements
    # The second measurement of every other run is missing: the third estimate, since the first one is
    # that of the prior.
    is_gap = np.zeros(z.shape, dtype=bool)
    is_gap[:, 1, ::2] = True

    def estimate_at_gaps(fill: Array | float) -> Estimates:
        """Estimate the states at the gaps, whose measurements are replaced by ``fill``."""
        filled = data._replace(measurements=np.where(is_gap, fill, z))
        estimates = run_filter(tracker, scenario, filled)
        return estimates._replace(mean=estimates.mean[:, 2, ::2], cov=estimates.cov[:, :, 2, ::2])

    missing = estimate_at_gaps(np.nan)
    measured = estimate_at_gaps(z)
    if not np.isfinite(missing.mean).all():
        raise ContractError("the estimate is not finite where a measurement is missing (NaN)")
    if np.array_equal(missing.mean, measured.mean):
        return  # the filter uses no measurement
    # A filter with a gate ignores measurements that are far away, and perhaps zero. Its estimates then
    # equal those at a gap, which is no mistake.
    far_away = estimate_at_gaps(1e3 * (1.0 + float(np.nanmax(np.abs(z)))))
    has_gate = np.array_equal(missing.mean, far_away.mean)
    replacements: dict[str, Array | float] = {
        "zero": 0.0,
        "the one before": np.roll(z, 1, axis=1),
    }
    for name, replacement in replacements.items():
        replaced = estimate_at_gaps(replacement)
        if np.array_equal(missing.mean, replaced.mean) and not has_gate:
            symbol = "NaN" if tracker.runs_program else "NaN, or None per run"
            raise ContractError(f"a missing measurement ({symbol}) is taken as {name}")
    if not np.allclose(missing.cov, measured.cov, rtol=1e-9, atol=0.0):
        return
    # A measurement must change the covariance, unless the filter has a constant one.
    if not has_constant_covariance(run_filter(tracker, scenario, data)):
        message = "the covariance is the same with and without a measurement"
        message += ": does the update reduce it?"
        if tracker.runs_program:
            message += (
                " A program of constant gain answers one covariance to all lines, or the mean alone"
            )
        raise ContractError(message)


def _check_interval(tracker: AnyFilter, scenario: Scenario) -> None:
    """Check that the estimates depend on the interval between steps, and on unequal intervals."""
    if isinstance(scenario, ModelDraws):
        _check_unequal_intervals(tracker, scenario)
        return
    make_problem: Callable[..., Scenario] = radar if scenario is RADAR else planar
    data = simulate(make_problem(), 3)
    first = run_filter(tracker, make_problem(), data)
    # Twice the interval of the contract's problems.
    changed_problems: dict[str, Scenario] = {"the interval dt": make_problem(T=4.0)}
    if scenario is PLANAR:
        # PLANAR, with intervals that differ from step to step.
        why = why_not_running(tracker, UNEQUAL)
        _check_no_failure(tracker, why)
        if not why.text:
            changed_problems["intervals after the first"] = UNEQUAL
    # The data stay the same: only the times and the model that the filter gets change.
    for name, problem in changed_problems.items():
        if alike(first, run_filter(tracker, problem, data)):
            message = f"the estimates do not depend on {name}: is it ignored?"
            raise ContractError(f"{message} A filter of one interval is checked with `--on CONFIG`")


def _check_no_failure(tracker: AnyFilter, why: WhyNotRunning) -> None:
    """Raise ContractError if a program fails at unequal intervals, for the reason ``why``.

    It may answer `error` to them, but must not begin and fail.
    """
    if why.is_failure and tracker.runs_program:
        raise ContractError(f"fails at unequal intervals, where T is null: {why.text}")


def _check_unequal_intervals(tracker: AnyFilter, scenario: ModelDraws) -> None:
    """Check that a filter that fits the problem of a config also fits it at unequal intervals."""
    other = at_unequal_intervals(scenario)
    if other is None:
        raise LeftOutError("the steps of this problem cannot be unequal")
    why = why_not_running(tracker, other)
    _check_no_failure(tracker, why)
    if why.text:
        if why_not_running(tracker, scenario).text:
            raise LeftOutError("the filter does not run at equal intervals, either")
        raise LeftOutError("the filter refuses unequal intervals")
    two_runs = run_filter(tracker, other, simulate(other, runs=2))
    if "mode" in two_runs.series:
        # The reference filters have one motion, that of the model.
        raise LeftOutError("has several motions: it reports the diagnostic `mode`")
    if has_constant_covariance(two_runs):
        raise LeftOutError("the covariance is constant: its gain is that of one interval")
    # Step 1: its errors, in comparison with reference filters.
    precise_tracker = _with_many_particles(tracker)
    runs = _runs_for(tracker)
    if _compare_with_references(precise_tracker, scenario):
        raise LeftOutError("the errors do not fit at equal intervals, either")
    difference = _compare_with_references(precise_tracker, other)
    if difference:
        raise ContractError(f"fits at equal intervals and not at unequal ones: {difference.text}")
    # Step 2: its estimates, if they equal those of the EKF at equal intervals. They show a wrong Q,
    # which hardly changes the errors.
    if two_runs.random or _difference_from_ekf(precise_tracker, scenario, runs):
        return
    message = _difference_from_ekf(precise_tracker, other, runs)
    if message:
        raise ContractError(f"is the EKF at equal intervals and not at unequal ones: {message}")


@lru_cache(maxsize=8)
def _compare_with_references(tracker: AnyFilter, problem: ModelDraws) -> Misfit | None:
    """Describe how a filter's errors and covariances differ from those of reference filters.

    None if they fit. Two checks ask for the comparison on the problem of a config, so it is
    computed once. A plugin or program that was edited is another filter.
    """
    return misfit(tracker, problem, _runs_for(tracker))


def _runs_for(tracker: AnyFilter) -> int:
    """Return the number of runs on which a filter is compared with reference filters.

    It is smaller if the filter loops over its runs in Python, which takes longer.
    """
    if tracker.loops_over_runs:
        return _LOOPED_RUNS
    return _RUNS


def _with_many_particles(tracker: AnyFilter) -> AnyFilter:
    """Return a particle filter with at least `_LEAST_N` particles: chance then hides fewer mistakes.

    Other filters are returned as they are.
    """
    if tracker.particle_count < _LEAST_N and any(f.name == "N" for f in fields(tracker)):
        return replace(tracker, N=_LEAST_N)
    return tracker


def _check_place(tracker: AnyFilter, scenario: Scenario) -> None:
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
    precise_tracker = _with_many_particles(tracker)
    if "mode" in run_filter(tracker, RADAR, simulate(RADAR, runs=2)).series:
        return
    at_origin = with_sensors_at_origin(PLACED)
    assert at_origin is not None
    if _compare_with_references(precise_tracker, at_origin):
        return
    for name, problem in problems.items():
        difference = _compare_with_references(precise_tracker, ModelDraws(base=problem))
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
            "the sensors of this problem stand at the origin; `check --contract` without `--on` tries "
            "a radar elsewhere"
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
    data = simulate(problem, 3)
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


def _check_motion(tracker: AnyFilter, scenario: Scenario) -> None:
    """Check that a filter that fits one kind of motion also fits another kind with an equal key."""
    name = "radar" if scenario is RADAR else "planar"
    one_motion = ModelDraws(base=ONE_MOTION[name])
    other_motion = ModelDraws(base=OTHER_MOTION[name])
    for problem in (one_motion, other_motion):
        if not runs_on(tracker, problem):
            raise LeftOutError("the filter refuses another motion")
    if "mode" in run_filter(tracker, one_motion, simulate(one_motion, runs=2)).series:
        # The reference filters have one motion, that of the model.
        raise LeftOutError("has several motions: it reports the diagnostic `mode`")
    precise_tracker = _with_many_particles(tracker)
    if _compare_with_references(precise_tracker, one_motion):
        raise LeftOutError("the errors do not fit with the first motion, either")
    difference = _compare_with_references(precise_tracker, other_motion)
    if difference is None:
        return
    # The filter gets the other motion, and data of the first one. If it fits these, it ignores the kind;
    # otherwise it is an approximation that is worse with more noise.
    runs = _runs_for(tracker)
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
    """Check errors and covariance against reference filters, on draws from the filter's model."""
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
    precise_tracker = _with_many_particles(tracker)
    for problem in problems:
        drawn_problem = problem if isinstance(problem, ModelDraws) else ModelDraws(base=problem)
        difference = _compare_with_references(precise_tracker, drawn_problem)
        if difference:
            raise ContractError(difference.text)


def _check_angles(tracker: AnyFilter, scenario: Scenario) -> None:
    """Check that a filter does not go wrong where an angle crosses its cut, such as pi.

    The prior is turned about the sensor until the angles cross it.
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
    message = mistaken_angle(_with_many_particles(tracker), problem)
    # None: the angles could not be tested; empty: no mistake was found.
    if message is None:
        why = (
            "no angle passes its cut, no reference filter runs, or the filter is far off everywhere"
        )
        raise LeftOutError(f"{why}; `--on CONFIG` names an experiment that it is written for")
    if message:
        # A filter with a wrong place counts every angle wrongly.
        difference = _compare_with_references(_with_many_particles(tracker), problem)
        if difference and difference.ignores_place:
            raise LeftOutError(f"cannot be tested, as {PLACE_IGNORED}")
        raise ContractError(message)


def _check_against_kalman(tracker: AnyFilter, scenario: Scenario) -> None:
    """Check that estimates on a linear model equal those of the Kalman filter.

    UNEQUAL is the contract's linear problem whose steps have unequal intervals. A filter that does not
    run on it is checked on PLANAR, with equal intervals.
    """
    problem = UNEQUAL if runs_on(tracker, UNEQUAL) else PLANAR
    # On a linear model the EKF is the Kalman filter.
    message = _difference_from_ekf(tracker, problem, _runs_for(tracker))
    if message:
        raise ContractError(message)


def _difference_from_ekf(tracker: AnyFilter, scenario: Scenario, runs: int) -> str:
    """Describe how estimates differ from the EKF's; empty if rounding or chance explain it.

    If the EKF does not run on the scenario, the text says so. For a filter that draws random numbers
    only a bias of its means counts.
    """
    if why_not(EKF(), scenario):
        return "the EKF does not run there"
    data = with_gaps(simulate(scenario, runs))
    tested = run_filter(tracker, scenario, data)
    exact = run_filter(EKF(), scenario, data)
    sigma = np.sqrt(linalg.diagonal(exact.cov))
    error = near(tested.mean, exact.mean, scenario.angle_rows) - exact.mean
    if tested.random:
        # A filter that draws without particles is given the margin of 100 particles.
        N = tracker.particle_count if tracker.particle_count > 1 else 100
        return _describe_bias(error, sigma, N)
    deviation = float((np.abs(error) / np.maximum(sigma, np.finfo(float).tiny)).max())
    # What rounding leaves is far below 1e-6.
    if deviation > 1e-6:
        return f"the mean is off by up to {deviation:.2g} standard deviations"
    relative_difference = np.abs(tested.cov / exact.cov - 1.0)
    largest = float(relative_difference[exact.cov != 0.0].max())
    if largest > 1e-6:
        return f"the covariance is off by up to {100 * largest:.2g} %"
    return ""


def _describe_bias(error: Array, sigma: Array, N: int) -> str:
    """Describe a bias of a filter with N particles; empty if chance and N explain it.

    ``error`` (n, T + 1, M) is the difference of the means from the exact ones, ``sigma`` (n, T + 1, M)
    the exact standard deviation.
    """
    stderr = error.std(axis=-1, ddof=1) / np.sqrt(error.shape[-1])
    # N particles have a bias of the order of sigma / N.
    allowed_bias = _MAX_DEVIATION * stderr + 3.0 * sigma.mean(axis=-1) / N
    bias = np.abs(error.mean(axis=-1))
    if not (bias > allowed_bias).any():
        return ""
    largest_ratio = float((bias / allowed_bias).max())
    return f"the mean is biased, by {largest_ratio:.1f} times what chance and N allow"


CHECKS: dict[str, tuple[str, Check]] = {
    "shapes": ("shapes", _check_shapes),
    "digits": ("answers have enough digits", _check_digits),
    "purity": ("step leaves its arguments unchanged", _check_purity),
    "repeats": ("equal runs give equal estimates", _check_repeats),
    "independence": ("runs are independent", _check_independence),
    "covariance": ("covariance is symmetric and positive definite", _check_covariance),
    "gaps": ("predicts over a missing measurement", _check_gaps),
    "interval": ("uses the interval between steps", _check_interval),
    "tracks": ("follows the target", _check_tracks),
    "motion": ("uses the motion of the model", _check_motion),
    "place": ("uses the place of the sensor", _check_place),
    "angles": ("wraps angles at their cut", _check_angles),
    "kalman": ("equals the Kalman filter on a linear model", _check_against_kalman),
    "consistency": ("errors and covariance fit reference filters", _check_consistency),
}
"""Title and function of each check, by the name used in `contract_exemptions`.

`digits` checks programs alone.
"""
