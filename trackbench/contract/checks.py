"""Checks of the contract: each raises ContractError with a breach in one line."""

import random
from collections.abc import Callable
from copy import deepcopy
from dataclasses import fields, is_dataclass, replace
from typing import TypeAlias

import numpy as np

from trackbench.contract.angles import angles_of, mistaken_angle
from trackbench.contract.diagnosis import misfit, mistaken_track
from trackbench.contract.problems import (
    PLANAR,
    PRECISE,
    RADAR,
    UNEQUAL,
    Estimates,
    ModelDraws,
    at_unequal_intervals,
    new_rng,
    planar,
    radar,
    run_filter,
    runs_on,
    simulate,
    why_not,
    with_gaps,
)
from trackbench.core import linalg
from trackbench.core.angles import near
from trackbench.core.arrays import Array, with_trailing
from trackbench.evaluation.validate_output import check_estimate, check_names, checked_numbers
from trackbench.extension_points import field_values
from trackbench.filters.base import AnyFilter, declares_diagnostics, has_likelihood
from trackbench.filters.ekf import EKF
from trackbench.filters.external import PRINT_ALL_DIGITS, External
from trackbench.scenarios.base import Scenario

Check: TypeAlias = Callable[[AnyFilter, Scenario], None]
"""A check of the contract, which raises ContractError."""

_RUNS = 200
_LOOPED_RUNS = 80  # of a filter that loops over its runs in Python
_LEAST_N = 1000  # particles with which a particle filter is compared with the package's
_MAX_DEVIATION = 4.5  # standard errors; none of a few dozen comparisons should exceed it


class ContractError(Exception):
    """Breach of the contract, in one line."""


class LeftOutError(Exception):
    """Reason why a check does not apply."""


def alike(a: Estimates, b: Estimates) -> bool:
    """Test whether two estimates are equal."""
    return np.array_equal(a.mean, b.mean) and np.array_equal(a.cov, b.cov)


def _check_shapes(tracker: AnyFilter, scenario: Scenario) -> None:
    runs, rng, single = 5, new_rng(), True
    data = simulate(scenario, runs)
    n = data.truth.shape[0]
    state = tracker.init(scenario.model, data.prior, rng)
    first = int(scenario.steps[0]) + 1
    known = tracker.all_steps(scenario.model, state, data.measurements, first)
    if known is not None and known.estimate.mean.shape[1] != len(scenario.steps) - 1:
        what = f"{known.estimate.mean.shape[1]} states, not one per measurement"
        raise ContractError(f"all_steps gives {what}")
    # Step through the scenario; check the estimate and what else the filter gives at each step.
    for i, k in enumerate(scenario.steps):
        if i:
            state = tracker.step(scenario.model, state, data.measurements[:, i - 1], int(k), rng)
        estimate = tracker.estimate(state)
        if i and known is not None:
            after = known.state(i - 1)
            of_state, of_steps = tracker.estimate(after), known.estimate
            # One covariance of all runs may stand for equal ones.
            known_cov, cov = (with_trailing(x.cov, 1, leading=2) for x in (of_state, estimate))
            pairs = [(of_state.mean, estimate.mean), (known_cov, cov)]
            pairs += [(of_steps.mean[:, i - 1], estimate.mean), (of_steps.cov[:, :, i - 1], cov)]
            if not all(np.allclose(a, b, rtol=1e-6, atol=0.0, equal_nan=True) for a, b in pairs):
                raise ContractError(f"all_steps gives another estimate than step at step {k}")
        check_estimate(estimate, (n, n), runs)
        for name, array in (("mean", estimate.mean), ("cov", estimate.cov)):
            if np.asarray(array).dtype != np.float64:
                raise ContractError(f"{name} at step {k} is of {np.asarray(array).dtype}")
            is_left_out = tracker.runs_program and np.isnan(array).all()
            if not np.isfinite(array).all() and not (name == "cov" and is_left_out):
                raise ContractError(f"{name} at step {k} is not finite")
            single &= not i or np.array_equal(array, np.float32(array))
        diagnostics = checked_numbers("diagnostic", tracker.diagnostics(state), runs)
        if i and known is not None:
            for name, value in diagnostics.items():
                rows = known.diagnostics.get(name)
                if rows is None or not np.allclose(rows[i - 1], value, equal_nan=True):
                    what = f"another {name} than step at step {k}"
                    raise ContractError(f"all_steps gives {what}")
        check_names(diagnostics)
        names = sorted(tracker.diagnostic_names)
        if i and declares_diagnostics(type(tracker)) and sorted(diagnostics) != names:
            gives = f"diagnostics gives {sorted(diagnostics)}"
            raise ContractError(f"diagnostic_names is {names}, {gives}")
        if i and has_likelihood(tracker):
            checked_numbers("series", {"log_likelihood": tracker.log_likelihood(state)}, runs)
    digits = ""
    if isinstance(tracker, External):
        digits = tracker.few_digits(scenario.model, data.prior, data.measurements, first)
    if digits:
        raise ContractError(f"answers have {digits}: {PRINT_ALL_DIGITS}")
    if single:
        raise ContractError("the estimates have the digits of float32: compute in float64")


def _check_purity(tracker: AnyFilter, scenario: Scenario) -> None:
    data = simulate(scenario, 5)
    prior = deepcopy(data.prior)
    state = tracker.init(scenario.model, data.prior, new_rng())
    if not _equal(prior, data.prior):
        raise ContractError("the prior is written to; make a new array")
    # The same step twice, from equal arguments.
    z, k = data.measurements[:, 0], int(scenario.steps[1])
    before = deepcopy((state, z))
    first = tracker.estimate(tracker.step(scenario.model, state, z, k, new_rng()))
    if not _equal(before, (state, z)):
        raise ContractError("the state or the measurement is written to; make a new array")
    second = tracker.estimate(tracker.step(scenario.model, state, z, k, new_rng()))
    if not np.array_equal(first.mean, second.mean, equal_nan=True):
        raise ContractError("the same step with the same noise gives another estimate")


def _equal(a: object, b: object) -> bool:
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return bool(np.array_equal(a, b, equal_nan=a.dtype.kind == "f"))
    if isinstance(a, tuple | list) and isinstance(b, tuple | list):
        return all(_equal(x, y) for x, y in zip(a, b, strict=True))
    if is_dataclass(a) and not isinstance(a, type):
        return all(_equal(value, getattr(b, key)) for key, value in field_values(a).items())
    return True


def _check_repeats(tracker: AnyFilter, scenario: Scenario) -> None:
    data = simulate(scenario, 3)
    before = random.getstate(), np.random.get_state(legacy=False)
    first, second = (run_filter(tracker, scenario, data) for _ in range(2))
    if repr(before) != repr((random.getstate(), np.random.get_state(legacy=False))):
        what = "draws from the global np.random or random"
        raise ContractError(f"{what}: noise comes from `rng` alone")
    if not np.array_equal(first.mean, second.mean, equal_nan=True):
        source = "SEED" if tracker.runs_program else "`rng`"
        what = "the estimates differ the second time"
        raise ContractError(f"{what}: noise comes from {source} alone")


def _check_independence(tracker: AnyFilter, scenario: Scenario) -> None:
    runs = 6
    data = simulate(scenario, runs)
    whole = run_filter(tracker, scenario, data)
    # Another measurement in the first or the last run changes this run alone.
    for run, others in ((0, slice(1, None)), (-1, slice(None, -1))):
        changed = data.measurements.copy()
        changed[..., run] += 1.0
        moved = run_filter(tracker, scenario, data._replace(measurements=changed))
        if not np.array_equal(whole.mean[..., others], moved.mean[..., others], equal_nan=True):
            what = "another measurement in one run changes the estimates of the others"
            raise ContractError(what)
    # Without random numbers neither the order of the runs nor their number matters.
    if not whole.random:
        turned = run_filter(tracker, scenario, simulate(scenario, runs, step=-1)).mean[..., ::-1]
        if not np.allclose(turned, whole.mean, rtol=1e-10, atol=1e-10, equal_nan=True):
            raise ContractError("the estimates depend on the order of the runs")
        alone = run_filter(tracker, scenario, simulate(scenario, 1))
        if not np.allclose(alone.mean, whole.mean[..., :1], rtol=1e-10, atol=1e-10, equal_nan=True):
            raise ContractError("the first run has another estimate without the other runs")


def _check_covariance(tracker: AnyFilter, scenario: Scenario) -> None:
    P = run_filter(tracker, scenario, simulate(scenario, 20)).cov
    known = np.isfinite(P)
    if (known != np.swapaxes(known, 0, 1)).any():
        raise ContractError(
            "not symmetric: an entry is NaN or infinite, and its mirror image is not"
        )
    # Correlations, so that units do not matter; a component that is known or collapsed has none.
    sd = np.sqrt(np.abs(linalg.diagonal(P)))
    sd = np.maximum(sd, 1e-6 * np.nanmax(sd, axis=(1, 2), keepdims=True))
    scale = np.where(sd > 0.0, sd, 1.0)
    C = np.moveaxis(P / (scale[:, None] * scale), (0, 1), (-2, -1))
    C = C[np.isfinite(C).all(axis=(-2, -1))]
    asymmetry = np.abs(C - np.swapaxes(C, -2, -1)).max()
    if asymmetry > 1e-7:
        raise ContractError(f"not symmetric: correlations differ by {asymmetry:.2g}; P - K S K' is")
    if (least := np.linalg.eigvalsh(C).min()) < -1e-7:
        what = f"the correlations have an eigenvalue {least:.2g}"
        raise ContractError(f"not positive definite: {what}")


def _check_gaps(tracker: AnyFilter, scenario: Scenario) -> None:
    data = simulate(scenario, 6)
    z = data.measurements
    gaps = np.zeros(z.shape, dtype=bool)
    gaps[:, 1, ::2] = True

    def estimates(fill: Array | float) -> Estimates:
        filled = data._replace(measurements=np.where(gaps, fill, z))
        of = run_filter(tracker, scenario, filled)
        return of._replace(mean=of.mean[:, 2, ::2], cov=of.cov[:, :, 2, ::2])

    missing, measured = estimates(np.nan), estimates(z)
    if not np.isfinite(missing.mean).all():
        raise ContractError("the estimate is not finite where a measurement is missing (NaN)")
    if np.array_equal(missing.mean, measured.mean):
        return  # uses no measurement
    # A filter with a gate ignores what is far away, and perhaps zero.
    far_away = estimates(1e3 * (1.0 + float(np.nanmax(np.abs(z)))))
    has_gate = np.array_equal(missing.mean, far_away.mean)
    for what, fill in (("zero", 0.0), ("the one before", np.roll(z, 1, axis=1))):
        if np.array_equal(missing.mean, estimates(fill).mean) and not has_gate:
            nothing = "NaN" if tracker.runs_program else "NaN, or None per run"
            raise ContractError(f"a missing measurement ({nothing}) is taken as {what}")
    if np.allclose(missing.cov, measured.cov, rtol=1e-9, atol=0.0):
        what = "the covariance is the same with and without a measurement"
        raise ContractError(f"{what}: does the update reduce it?")


def _check_interval(tracker: AnyFilter, scenario: Scenario) -> None:
    if isinstance(scenario, ModelDraws):
        _check_unequal_intervals(tracker, scenario)
        return
    problem = radar if scenario is RADAR else planar
    data = simulate(problem(), 3)
    first = run_filter(tracker, problem(), data)
    others = {"the interval dt": problem(T=4.0), "intervals after the first": UNEQUAL}
    for which, other in others.items():
        if (other is not UNEQUAL or (scenario is PLANAR and runs_on(tracker, other))) and alike(
            first, run_filter(tracker, other, data)
        ):
            what = f"the estimates do not depend on {which}: is it ignored?"
            raise ContractError(f"{what} A filter of one interval is checked with `--on CONFIG`")


def _check_unequal_intervals(tracker: AnyFilter, scenario: ModelDraws) -> None:
    """Check that a filter that fits a config's problem fits it at unequal intervals, too."""
    other = at_unequal_intervals(scenario)
    if other is None:
        raise LeftOutError("the steps of this problem cannot be unequal")
    if not runs_on(tracker, other):
        raise LeftOutError("the filter refuses unequal intervals")
    brief = run_filter(tracker, other, simulate(other, 2))
    if "mode" in brief.series:
        raise LeftOutError("has several motions: it reports the diagnostic `mode`")
    tracker, runs = _of_many_particles(tracker), _runs_for(tracker)
    if misfit(tracker, scenario, runs):
        raise LeftOutError("the errors do not fit at equal intervals, either")
    if what := misfit(tracker, other, runs):
        raise ContractError(f"fits at equal intervals and not at unequal ones: {what}")
    # A wrong Q alone hardly shows in the errors, but a filter that is the EKF is it at any intervals.
    if brief.random or _off_ekf(tracker, scenario, runs):
        return
    if what := _off_ekf(tracker, other, runs):
        raise ContractError(f"is the EKF at equal intervals and not at unequal ones: {what}")


def _runs_for(tracker: AnyFilter) -> int:
    return _LOOPED_RUNS if tracker.loops_over_runs else _RUNS


def _of_many_particles(tracker: AnyFilter) -> AnyFilter:
    """Give the filter so many particles that they leave less room for mistakes."""
    if tracker.particle_count < _LEAST_N and any(f.name == "N" for f in fields(tracker)):
        return replace(tracker, N=_LEAST_N)
    return tracker


def _check_tracks(tracker: AnyFilter, scenario: Scenario) -> None:
    # A filter that names no components may be one of positions or of a radar.
    causes = [mistaken_track(tracker, p) for p in (PLANAR, PRECISE) if runs_on(tracker, p)]
    if causes and all(causes):
        raise ContractError(causes[0])


def _check_consistency(tracker: AnyFilter, scenario: Scenario) -> None:
    if "mode" in run_filter(tracker, scenario, simulate(scenario, 2)).series:
        raise LeftOutError("has several motions: it reports the diagnostic `mode`")
    problems = [scenario]
    if scenario is PLANAR:
        problems = [UNEQUAL if runs_on(tracker, UNEQUAL) else PLANAR]
        # A filter of the runner's sensor is one of a radar, too, also where the azimuth jumps.
        if runs_on(tracker, PRECISE) and not mistaken_track(tracker, PRECISE):
            problems.append(RADAR)
    tracker = _of_many_particles(tracker)
    for problem in problems:
        drawn = problem if isinstance(problem, ModelDraws) else ModelDraws(base=problem)
        if what := misfit(tracker, drawn, _runs_for(tracker)):
            raise ContractError(what)


def _check_angles(tracker: AnyFilter, scenario: Scenario) -> None:
    if scenario is PLANAR and runs_on(tracker, RADAR):
        scenario = RADAR
    problem = scenario if isinstance(scenario, ModelDraws) else ModelDraws(base=scenario)
    if not angles_of(problem):
        where = "this problem" if isinstance(scenario, ModelDraws) else "the contract's problem"
        raise LeftOutError(f"{where} has no angle; `--on CONFIG` names an experiment with one")
    # The prior is turned as a normal distribution.
    if needed := [name for name in tracker.all_requirements if name.startswith("prior.")]:
        raise LeftOutError(f"needs {needed[0]}, which a turned problem has not")
    what = mistaken_angle(_of_many_particles(tracker), problem)
    if what is None:
        why = (
            "no angle passes its cut, no reference filter runs, or the filter is far off everywhere"
        )
        raise LeftOutError(f"{why}; `--on CONFIG` names an experiment that it is written for")
    if what:
        raise ContractError(what)


def _check_against_kalman(tracker: AnyFilter, scenario: Scenario) -> None:
    problem = UNEQUAL if runs_on(tracker, UNEQUAL) else PLANAR
    # On a linear model the EKF is the Kalman filter.
    if what := _off_ekf(tracker, problem, _runs_for(tracker)):
        raise ContractError(what)


def _off_ekf(tracker: AnyFilter, scenario: Scenario, runs: int) -> str:
    """Describe how far estimates are from the EKF's, beyond rounding or what chance allows."""
    if why_not(EKF(), scenario):
        return "the EKF does not run there"
    data = with_gaps(simulate(scenario, runs))
    tested, exact = run_filter(tracker, scenario, data), run_filter(EKF(), scenario, data)
    sigma = np.sqrt(linalg.diagonal(exact.cov))
    error = near(tested.mean, exact.mean, scenario.angle_rows) - exact.mean
    if tested.random:
        return _bias(error, sigma, tracker.particle_count if tracker.particle_count > 1 else 100)
    off = float((np.abs(error) / np.maximum(sigma, np.finfo(float).tiny)).max())
    if off > 1e-6:
        return f"the mean is off by up to {off:.2g} standard deviations"
    ratio = float(np.abs(tested.cov / exact.cov - 1.0)[exact.cov != 0.0].max())
    return f"the covariance is off by up to {100 * ratio:.2g} %" if ratio > 1e-6 else ""


def _bias(error: Array, sigma: Array, N: int) -> str:
    """Describe a bias (n, T + 1, M) of a filter with N particles that chance does not allow."""
    stderr = error.std(axis=-1, ddof=1) / np.sqrt(error.shape[-1])
    # N particles have a bias of the order of sigma / N.
    allowed = _MAX_DEVIATION * stderr + 3.0 * sigma.mean(axis=-1) / N
    bias = np.abs(error.mean(axis=-1))
    if not (bias > allowed).any():
        return ""
    worst = float((bias / allowed).max())
    return f"the mean is biased, by {worst:.1f} times what chance and N allow"


CHECKS: dict[str, tuple[str, Check]] = {
    "shapes": ("shapes", _check_shapes),
    "purity": ("step leaves its arguments unchanged", _check_purity),
    "repeats": ("equal runs give equal estimates", _check_repeats),
    "independence": ("runs are independent", _check_independence),
    "covariance": ("covariance is symmetric and positive definite", _check_covariance),
    "gaps": ("predicts over a missing measurement", _check_gaps),
    "interval": ("uses the interval between steps", _check_interval),
    "tracks": ("follows the target", _check_tracks),
    "angles": ("wraps angles at their cut", _check_angles),
    "kalman": ("equals the Kalman filter on a linear model", _check_against_kalman),
    "consistency": ("errors and covariance fit reference filters", _check_consistency),
}
"""Checks by the name used in `contract_exemptions`: what a report calls them, and the function."""
