"""Checks of the contract of a filter, and their run on a class or on every filter of a file."""

import pickle
from collections.abc import Callable, Iterator, Sequence
from copy import deepcopy
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from trackbench.config.checks import has
from trackbench.config.plugin_checks import check_kind
from trackbench.contract.fixtures import (
    LINEAR,
    RADAR,
    SCALAR,
    kalman_filtered,
    new_rng,
    run_filter,
    simulate,
)
from trackbench.core import linalg
from trackbench.core.arrays import Array
from trackbench.errors import UserError, in_line
from trackbench.evaluation.validate_output import check_estimate, check_names, checked_numbers
from trackbench.filters.base import declares_diagnostics, has_likelihood
from trackbench.plugins.checks import filter_conflicts
from trackbench.plugins.errors import PluginError, guarded, located_message
from trackbench.plugins.load import load_plugin, read_plugin
from trackbench.registry import kinds

_RUNS = 200
_MAX_DEVIATION = 4.5  # standard errors; none of a few dozen comparisons should exceed it


class Finding(NamedTuple):
    """Result of one check: its name, the verdict, and the reason."""

    check: str
    verdict: Literal["good", "bad", "left out"]
    why: str = ""

    def __str__(self) -> str:
        return f"{self.verdict:>8}  {self.check}" + (f": {self.why}" if self.why else "")


class ContractError(Exception):
    """Breach of the contract, in one line."""


def check_file(path: Path) -> dict[str, list[Finding]]:
    """Check every filter that a Python file registers; this runs the file's code.

    Parameters
    ----------
    path : Path
        The Python file.

    Returns
    -------
    dict
        Findings of each filter, by its kind.

    Raises
    ------
    UserError
        If the file cannot be read or loaded, or registers no filter.
    """
    kinds("filters")
    try:
        plugin = read_plugin(path)
        load_plugin(plugin, check_kind)
    except OSError as error:
        raise UserError(f"{path}: {(error.strerror or str(error)).lower()}") from None
    except PluginError as error:
        raise UserError(*error.args) from None
    of_file = {k: cls for k, cls in kinds("filters").items() if cls.__module__ == plugin.module}
    if not of_file:
        raise UserError(f'{path}: registers no filter (@register("filters", "my-kind"))')
    return {kind: check_filter(cls) for kind, cls in of_file.items()}


def check_filter(
    cls: type[Any], tracker: Any = None, scenarios: Sequence[Any] = ()
) -> list[Finding]:
    """Check a filter class.

    Parameters
    ----------
    cls : type
        The registered class.
    tracker : Filter, optional
        An instance to check; default: one with the default keys.
    scenarios : sequence of Scenario
        Further scenarios to try, if the filter cannot run on the linear one.

    Returns
    -------
    list of Finding
    """
    name = "has a default for every key"
    try:
        tracker = _with_defaults(cls) if tracker is None else tracker
    except ContractError as error:
        return [Finding(name, "bad", str(error))]
    findings = [Finding(name, "good")]
    scenario, why_not_linear = _choose_scenario(tracker, scenarios)
    if scenario is None:
        return [*findings, Finding("everything else", "left out", why_not_linear)]
    exempt: dict[str, str] = dict(cls.contract_exemptions)
    if scenario is not LINEAR:
        exempt.setdefault("kalman", why_not_linear)
    for key, (name, check) in CHECKS.items():
        if key in exempt:
            findings.append(Finding(name, "left out", exempt[key]))
        else:
            findings.append(_run_check(name, check, tracker, scenario))
    return findings


def report(findings: dict[str, list[Finding]]) -> Iterator[str]:
    """Yield the lines of a report on each kind."""
    for kind, of_kind in findings.items():
        yield f"{kind}:"
        yield from (f"  {finding}" for finding in of_kind)


def _run_check(
    name: str, check: Callable[[Any, Any], None], tracker: Any, scenario: Any
) -> Finding:
    try:
        with guarded(), np.errstate(all="ignore"):
            check(tracker, scenario)
    except ContractError as error:
        return Finding(name, "bad", str(error))
    except Exception as error:
        return Finding(name, "bad", in_line(located_message(error, tracker)))
    return Finding(name, "good")


def _with_defaults(cls: type[Any]) -> Any:
    """Return the filter with its default keys, which must be hashable, comparable and picklable."""
    if not is_dataclass(cls):
        raise ContractError("is not a dataclass (frozen=True, kw_only=True)")
    required = [f.name for f in fields(cls) if f.init and f.default is f.default_factory is MISSING]
    if required:
        what = ", ".join(required)
        raise ContractError(f"give {what} a default, so that a first run needs no keys")
    one, other = cls(), cls()
    try:
        if hash(one) != hash(other) or one != other:
            raise ContractError("two equal filters differ: make it @dataclass(frozen=True)")
    except TypeError as error:
        what = f"cannot be hashed ({error}): frozen=True, tuples and not lists"
        raise ContractError(what) from None
    if pickle.loads(pickle.dumps(one)) != one:
        raise ContractError("does not survive the way to another process")
    return one


def _choose_scenario(tracker: Any, scenarios: Sequence[Any]) -> tuple[Any, str]:
    """Return the first scenario that the filter can run on, and why not the ones before it."""
    reasons: list[str] = []
    for scenario in (LINEAR, SCALAR, RADAR, *scenarios):
        lacking = [n for n in tracker.all_requirements if not has(scenario, n)]
        mistakes = list(filter_conflicts(tracker, scenario).values()) if not lacking else []
        if not lacking and not mistakes:
            return scenario, "; ".join(reasons)
        reasons.append(mistakes[0] if mistakes else f"needs {lacking[0]}")
    return None, "; ".join(reasons)


def _check_shapes(tracker: Any, scenario: Any) -> None:
    runs, rng = 5, new_rng()
    data = simulate(scenario, runs)
    n = data.truth.shape[0]
    state = tracker.init(scenario.model, data.prior, rng)
    for i, k in enumerate(scenario.steps):
        if i:
            state = tracker.step(scenario.model, state, data.measurements[:, i - 1], int(k), rng)
        estimate = tracker.estimate(state)
        check_estimate(estimate, (n, n), runs)
        for name, array in (("mean", estimate.mean), ("cov", estimate.cov)):
            if np.asarray(array).dtype != np.float64:
                raise ContractError(f"{name} at step {k} is of {np.asarray(array).dtype}")
            if not np.isfinite(array).all():
                raise ContractError(f"{name} at step {k} is not finite")
        diagnostics = checked_numbers("diagnostic", tracker.diagnostics(state), runs)
        check_names(diagnostics)
        names = sorted(tracker.diagnostic_names)
        if i and declares_diagnostics(type(tracker)) and sorted(diagnostics) != names:
            raise ContractError(
                f"diagnostic_names is {names}, diagnostics gives {sorted(diagnostics)}"
            )
        if i and has_likelihood(tracker):
            checked_numbers("series", {"log_likelihood": tracker.log_likelihood(state)}, runs)


def _check_purity(tracker: Any, scenario: Any) -> None:
    data = simulate(scenario, 5)
    prior = deepcopy(data.prior)
    state = tracker.init(scenario.model, data.prior, new_rng())
    if not _equal(prior, data.prior):
        raise ContractError("the prior is written to; make a new array")
    z, k = data.measurements[:, 0], int(scenario.steps[1])
    before = deepcopy((state, z))
    first = tracker.estimate(tracker.step(scenario.model, state, z, k, new_rng()))
    if not _equal(before, (state, z)):
        raise ContractError("the state or the measurement is written to; make a new array")
    second = tracker.estimate(tracker.step(scenario.model, state, z, k, new_rng()))
    if not np.array_equal(first.mean, second.mean, equal_nan=True):
        raise ContractError("the same step with the same noise gives another estimate")


def _equal(a: Any, b: Any) -> bool:
    if isinstance(a, np.ndarray):
        return bool(np.array_equal(a, b, equal_nan=a.dtype.kind == "f"))
    if isinstance(a, tuple | list):
        return all(_equal(x, y) for x, y in zip(a, b, strict=True))
    if is_dataclass(a) and not isinstance(a, type):
        return all(_equal(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
    return True


def _check_repeats(tracker: Any, scenario: Any) -> None:
    data = simulate(scenario, 3)
    first, second = (run_filter(tracker, scenario, data) for _ in range(2))
    if not np.array_equal(first.mean, second.mean, equal_nan=True):
        raise ContractError("the estimates differ the second time: noise comes from `rng` alone")


def _check_independence(tracker: Any, scenario: Any) -> None:
    runs = 6
    data = simulate(scenario, runs)
    whole = run_filter(tracker, scenario, data)
    # Another measurement in the first or the last run changes this run alone.
    for run, others in ((0, slice(1, None)), (-1, slice(None, -1))):
        changed = data.measurements.copy()
        changed[..., run] += 1.0
        moved = run_filter(tracker, scenario, data._replace(measurements=changed))
        if not np.array_equal(whole.mean[..., others], moved.mean[..., others], equal_nan=True):
            raise ContractError(
                "another measurement in one run changes the estimates of the others"
            )
    # Without random numbers neither the order of the runs nor their number matters.
    if not whole.random:
        turned = run_filter(tracker, scenario, simulate(scenario, runs, step=-1)).mean[..., ::-1]
        if not np.allclose(turned, whole.mean, rtol=1e-10, atol=1e-10, equal_nan=True):
            raise ContractError("the estimates depend on the order of the runs")
        alone = run_filter(tracker, scenario, simulate(scenario, 1))
        if not np.allclose(alone.mean, whole.mean[..., :1], rtol=1e-10, atol=1e-10, equal_nan=True):
            raise ContractError("the first run has another estimate without the other runs")


def _check_gaps(tracker: Any, scenario: Any) -> None:
    data = simulate(scenario, 5)
    z = data.measurements.copy()
    z[:, 1, ::2] = np.nan
    if not np.isfinite(run_filter(tracker, scenario, data._replace(measurements=z)).mean).all():
        raise ContractError("the estimate is not finite where a measurement is missing (NaN)")


def _check_against_kalman(tracker: Any, scenario: Any) -> None:
    data = simulate(scenario, _RUNS)
    tested, exact = run_filter(tracker, scenario, data), kalman_filtered(scenario, data)
    error, sigma = tested.mean - exact.mean, np.sqrt(linalg.diagonal(exact.cov))
    if tested.random:
        N = tracker.particle_count if tracker.particle_count > 1 else 100
        _check_bias(error, sigma, N)
        return
    off = float(np.abs(error / sigma).max())
    if off > 1e-6:
        raise ContractError(f"the mean is off by up to {off:.2g} standard deviations")
    ratio = float(np.abs(tested.cov / exact.cov - 1.0)[exact.cov != 0.0].max())
    if ratio > 1e-6:
        raise ContractError(f"the covariance is off by up to {100 * ratio:.2g} %")


def _check_bias(error: Array, sigma: Array, N: int) -> None:
    stderr = error.std(axis=-1, ddof=1) / np.sqrt(_RUNS)
    # N particles have a bias of the order of sigma / N.
    allowed = _MAX_DEVIATION * stderr + 3.0 * sigma.mean(axis=-1) / N
    bias = np.abs(error.mean(axis=-1))
    if (bias > allowed).any():
        worst = float((bias / allowed).max())
        raise ContractError(f"the mean is biased, by {worst:.1f} times what chance and N allow")


CHECKS: dict[str, tuple[str, Callable[[Any, Any], None]]] = {
    "shapes": ("shapes", _check_shapes),
    "purity": ("step leaves its arguments unchanged", _check_purity),
    "repeats": ("equal runs give equal estimates", _check_repeats),
    "independence": ("runs are independent", _check_independence),
    "gaps": ("predicts over a missing measurement", _check_gaps),
    "kalman": ("equals the Kalman filter on a linear model", _check_against_kalman),
}
"""Checks by the name used in `contract_exemptions`: what a report calls them, and the function."""
