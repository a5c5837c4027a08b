"""Contract of a filter: shapes, purity, independence of the runs, agreement with the Kalman filter.

Every check reports in one line. A filter that cannot pass a check by its nature gives the reason in
a class attribute: ``contract_exemptions = {"kalman": "uses no measurement"}``. The other names are
``shapes``, ``purity``, ``repeats``, ``independence`` and ``gaps``.
"""

import pickle
from collections.abc import Callable, Iterator, Sequence
from copy import deepcopy
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from typing import Literal, NamedTuple, TypeAlias, cast

import numpy as np
from numpy.random import SFC64, Generator

from trackbench.config.checks import has
from trackbench.config.plugin_checks import load_file
from trackbench.core import kalman, linalg
from trackbench.core.arrays import Array
from trackbench.core.distributions import per_run_moments
from trackbench.core.random_streams import RunStreams
from trackbench.errors import UserError, in_line
from trackbench.evaluation.validate_output import check_estimate, check_names, checked_numbers
from trackbench.extension_points import field_values
from trackbench.filters.base import AnyFilter, Filter, declares_diagnostics, has_likelihood
from trackbench.models.base import Differentiable
from trackbench.models.motions.kinematic import WhiteAcceleration
from trackbench.models.motions.scalar import SineGamma
from trackbench.models.sensors.position import PositionSensor
from trackbench.models.sensors.range_azimuth import RangeAzimuth
from trackbench.models.sensors.square_then_line import SquareThenLine
from trackbench.plugins.checks import filter_conflicts
from trackbench.plugins.errors import PluginError, guarded, located_message
from trackbench.registry import kinds
from trackbench.scenarios.base import Scenario, Simulation
from trackbench.scenarios.starts.without_scans import GaussianStart, Known
from trackbench.scenarios.targets.base import Launch
from trackbench.scenarios.targets.driven import Driven
from trackbench.scenarios.tracking import Tracking

Check: TypeAlias = Callable[[AnyFilter, Scenario], None]
"""A check of the contract, which raises ContractError."""

_RUNS = 200
_MAX_DEVIATION = 4.5  # standard errors; none of a few dozen comparisons should exceed it

LINEAR = Tracking(
    target=Driven(motion=WhiteAcceleration(q=1.0), launch=Launch(x=10.0, vx=1.0, y=-5.0, vy=2.0)),
    sensor=PositionSensor(sigma=2.0),
    start=GaussianStart(sigma=(2.0, 1.0, 2.0, 1.0)),
    last=6,
)
"""Constant velocity in the plane with measured positions: the Kalman filter is exact."""

SCALAR = Tracking(
    target=Driven(motion=SineGamma(), launch=Launch(x=1.0)),
    sensor=SquareThenLine(R=0.1),
    start=Known(),
    first=1,
    last=8,
)
"""Van der Merwe's scalar model, for filters that need one."""

RADAR = Tracking(
    target=Driven(
        motion=WhiteAcceleration(q=1.0), launch=Launch(x=6000.0, vx=-80.0, y=3000.0, vy=40.0)
    ),
    sensor=RangeAzimuth(sigma_range=20.0, sigma_azimuth_mrad=2.0),
    start=GaussianStart(sigma=(40.0, 4.0, 40.0, 4.0)),
    last=6,
)
"""Constant velocity with a radar, for filters that need range and azimuth."""


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
    try:
        plugin = load_file(path)
    except PluginError as error:
        raise UserError(*error.args) from None
    registered = {k: c for k, c in kinds("filters").items() if c.__module__ == plugin.module}
    if not registered:
        raise UserError(f'{path}: registers no filter (@register("filters", "my-kind"))')
    return {k: check_filter(c) for k, c in registered.items() if issubclass(c, Filter)}


def check_filter(
    cls: type[AnyFilter], tracker: AnyFilter | None = None, scenarios: Sequence[Scenario] = ()
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


def _run_check(name: str, check: Check, tracker: AnyFilter, scenario: Scenario) -> Finding:
    try:
        with guarded(), np.errstate(all="ignore"):
            check(tracker, scenario)
    except ContractError as error:
        return Finding(name, "bad", str(error))
    except Exception as error:
        return Finding(name, "bad", in_line(located_message(error, tracker)))
    return Finding(name, "good")


def _with_defaults(cls: type[AnyFilter]) -> AnyFilter:
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


def _choose_scenario(
    tracker: AnyFilter, scenarios: Sequence[Scenario]
) -> tuple[Scenario | None, str]:
    """Return the first scenario that the filter can run on, and why not the ones before it."""
    reasons: list[str] = []
    for scenario in (LINEAR, SCALAR, RADAR, *scenarios):
        lacking = [n for n in tracker.all_requirements if not has(scenario, n)]
        mistakes = list(filter_conflicts(tracker, scenario).values()) if not lacking else []
        if not lacking and not mistakes:
            return scenario, "; ".join(reasons)
        reasons.append(mistakes[0] if mistakes else f"needs {lacking[0]}")
    return None, "; ".join(reasons)


class Estimates(NamedTuple):
    """Mean (n_x, T + 1, M) and cov (n_x, n_x, T + 1, M) of every step; whether numbers were drawn."""

    mean: Array
    cov: Array
    random: bool


def new_rng() -> Generator:
    """Return the same random numbers every time."""
    return Generator(SFC64(20260101))


def simulate(scenario: Scenario, runs: int, step: int = 1) -> Simulation:
    """Simulate the first runs of the scenario, in their order or the last one first (step -1)."""
    return scenario.simulate(RunStreams(1, range(runs)[::step]), runs)


def run_filter(tracker: AnyFilter, scenario: Scenario, data: Simulation) -> Estimates:
    """Return the filter's estimates, by `init` and one `step` after another."""
    rng = new_rng()
    first_words = _words(rng)
    state = tracker.init(scenario.model, data.prior, rng)
    estimates = [tracker.estimate(state)]
    for i, k in enumerate(scenario.steps[1:]):
        state = tracker.step(scenario.model, state, data.measurements[:, i], int(k), rng)
        estimates.append(tracker.estimate(state))
    covs = [per_run_moments(g).cov for g in estimates]
    means = np.stack([g.mean for g in estimates], axis=1)
    return Estimates(means, np.stack(covs, axis=2), random=_words(rng) != first_words)


def _words(rng: Generator) -> list[int]:
    return rng.bit_generator.state["state"]["state"].tolist()


def kalman_filtered(scenario: Scenario, data: Simulation) -> Estimates:
    """Return the exact posterior of a linear Gaussian scenario."""
    motion, sensor = cast(Differentiable, scenario.model)
    posteriors = [per_run_moments(data.prior)]
    for i, k in enumerate(scenario.steps[1:]):
        # Prediction with F and Q of the motion, which is linear.
        x = posteriors[-1].mean
        F, Q = motion.jacobian(x, int(k)), np.asarray(motion.transition(x, int(k)).cov)
        predicted = kalman.predict(posteriors[-1], F, Q)
        # Update with the innovation z - H x.
        nu = data.measurements[:, i] - sensor.measurement(predicted.mean, int(k)).mean
        H, R = sensor.jacobian(predicted.mean, int(k)), sensor.measurement(predicted.mean, 0).cov
        posteriors.append(kalman.update(predicted, nu, H, R)[0])
    mean = np.stack([g.mean for g in posteriors], axis=-2)
    return Estimates(mean, np.stack([g.cov for g in posteriors], axis=-2), random=False)


def _check_shapes(tracker: AnyFilter, scenario: Scenario) -> None:
    runs, rng = 5, new_rng()
    data = simulate(scenario, runs)
    n = data.truth.shape[0]
    state = tracker.init(scenario.model, data.prior, rng)
    # Step through the scenario; check the estimate and what else the filter gives at each step.
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
    first, second = (run_filter(tracker, scenario, data) for _ in range(2))
    if not np.array_equal(first.mean, second.mean, equal_nan=True):
        raise ContractError("the estimates differ the second time: noise comes from `rng` alone")


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


def _check_gaps(tracker: AnyFilter, scenario: Scenario) -> None:
    data = simulate(scenario, 5)
    z = data.measurements.copy()
    z[:, 1, ::2] = np.nan
    if not np.isfinite(run_filter(tracker, scenario, data._replace(measurements=z)).mean).all():
        raise ContractError("the estimate is not finite where a measurement is missing (NaN)")


def _check_against_kalman(tracker: AnyFilter, scenario: Scenario) -> None:
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


CHECKS: dict[str, tuple[str, Check]] = {
    "shapes": ("shapes", _check_shapes),
    "purity": ("step leaves its arguments unchanged", _check_purity),
    "repeats": ("equal runs give equal estimates", _check_repeats),
    "independence": ("runs are independent", _check_independence),
    "gaps": ("predicts over a missing measurement", _check_gaps),
    "kalman": ("equals the Kalman filter on a linear model", _check_against_kalman),
}
"""Checks by the name used in `contract_exemptions`: what a report calls them, and the function."""
