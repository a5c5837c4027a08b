"""The contract of a filter, held against a class: shapes, purity, independence of runs, the KF.

Every check says what it found in one line. A filter that cannot pass one by its nature says why in a
class attribute: ``excused = {"kalman": "looks at no measurement"}``; the other names are ``shapes``,
``purity``, ``independence`` and ``gaps``.
"""

import pickle
from collections.abc import Callable, Iterator, Sequence
from copy import deepcopy
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.random import SFC64, Generator

from trackbench.core import kalman, linalg
from trackbench.core.arrays import Array, Index, Mask, with_trailing
from trackbench.core.distributions import Gaussian
from trackbench.core.streams import RunStreams, Streams
from trackbench.experiment.checks import has
from trackbench.experiment.plugins import load_plugin, read_plugin
from trackbench.experiment.problems import UserError
from trackbench.models.base import Model
from trackbench.models.linear import CWNA
from trackbench.registry import kinds
from trackbench.scenarios.base import Simulation, simulate_markov
from trackbench.scenarios.merwe import Merwe

_RUNS = 200
_OUTLIER = 4.5  # standard errors; of a few dozen comparisons none should be beyond


class Finding(NamedTuple):
    """One check of the contract: what was looked at, how it went, and why."""

    check: str
    verdict: Literal["good", "bad", "left out"]
    why: str = ""

    def __str__(self) -> str:
        return f"{self.verdict:>8}  {self.check}" + (f": {self.why}" if self.why else "")


class BrokenError(Exception):
    """The filter does not do what it promised."""


@dataclass(frozen=True)
class PositionSensor:
    """Two positions with independent noise of standard deviation sigma, m."""

    sigma: float
    components: tuple[str, ...] = ("x", "y")

    def measurement(self, x: Array, k: int) -> Gaussian:
        """N((px, py), sigma^2 I)."""
        return Gaussian(x[[0, 2]], self.sigma**2 * np.eye(2))

    def innovation(self, z: Array, z_pred: Array) -> Array:
        """``z - z_pred``."""
        return z - z_pred

    def jacobian(self, x: Array, k: int) -> Array:
        """H (2, 4)."""
        return np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]])


@dataclass(frozen=True, kw_only=True)
class Linear:
    """Constant velocity in the plane, seen through two noisy positions: the Kalman filter is exact."""

    T: int = 6
    kind = "linear"

    @property
    def model(self) -> Model:
        """CWNA and positions."""
        return Model(CWNA(T=1.0, q=1.0), PositionSensor(2.0))

    @property
    def steps(self) -> Index:
        """0 to T."""
        return np.arange(self.T + 1)

    @property
    def times(self) -> Array:
        """One second per step."""
        return self.steps.astype(float)

    @property
    def windows(self) -> dict[str, Mask]:
        """All but the prior's step."""
        return {"": self.steps > 0}

    def simulate(self, rng: Streams, runs: int) -> Simulation:
        """Runs of the model from a Gaussian prior."""
        mean = np.repeat(np.array([[10.0], [1.0], [-5.0], [2.0]]), runs, axis=1)
        prior = Gaussian(mean, np.diag([4.0, 1.0, 4.0, 1.0]))
        truth, seen = simulate_markov(self.model, prior.sample(rng), self.steps, rng)
        return Simulation(truth, seen, prior)

    def errors(self, mean: Array, truth: Array) -> dict[str, Array]:
        """Position errors, m."""
        return {"position": (mean - truth)[[0, 2]]}


def check_file(path: Path) -> dict[str, list[Finding]]:
    """Every filter that a Python file registers, by its kind; runs the file's code."""
    kinds("filters")
    try:
        plugin = read_plugin(path)
        load_plugin(plugin)
    except OSError as error:
        raise UserError(f"{path}: {(error.strerror or str(error)).lower()}") from None
    except Exception as error:
        raise UserError(f"{path}: {type(error).__name__}: {error}") from None
    own = {k: cls for k, cls in kinds("filters").items() if cls.__module__ == plugin.module}
    if not own:
        raise UserError(f'{path}: registers no filter (@register("filters", "my-kind"))')
    return {kind: check_filter(cls) for kind, cls in own.items()}


def check_filter(
    cls: type[Any], tracker: Any = None, scenarios: Sequence[Any] = ()
) -> list[Finding]:
    """Hold a filter class against the contract: with its default keys, or as it is given.

    ``scenarios`` are further ones to run it on, if it does not run on the linear one.
    """
    try:
        tracker = _made(cls) if tracker is None else tracker
    except BrokenError as error:
        return [Finding("can be made without any key", "bad", str(error))]
    found = [Finding("can be made without any key", "good")]
    scenario, why_not = _playground(tracker, scenarios)
    if scenario is None:
        return [*found, Finding("everything else", "left out", why_not)]
    excused: dict[str, str] = dict(getattr(cls, "excused", {}))
    if scenario.kind != "linear":
        excused.setdefault("kalman", why_not)
    for key, (name, check) in _CHECKS.items():
        if key in excused:
            found.append(Finding(name, "left out", excused[key]))
        else:
            found.append(_tried(name, check, tracker, scenario))
    return found


def _tried(name: str, check: Callable[[Any, Any], None], tracker: Any, scenario: Any) -> Finding:
    try:
        with np.errstate(all="ignore"):
            check(tracker, scenario)
    except BrokenError as error:
        return Finding(name, "bad", str(error))
    except Exception as error:
        return Finding(name, "bad", f"{type(error).__name__}: {error}")
    return Finding(name, "good")


def _made(cls: type[Any]) -> Any:
    if not is_dataclass(cls):
        raise BrokenError("is not a dataclass (frozen=True, kw_only=True)")
    required = [f.name for f in fields(cls) if f.init and not _has_default(f)]
    if required:
        raise BrokenError(
            f"give {', '.join(required)} a default, so that a first run needs no keys"
        )
    one, other = cls(), cls()
    try:
        if hash(one) != hash(other) or one != other:
            raise BrokenError("two equal filters differ: make it @dataclass(frozen=True)")
    except TypeError as error:
        raise BrokenError(
            f"cannot be hashed ({error}): frozen=True, tuples and not lists"
        ) from None
    if pickle.loads(pickle.dumps(one)) != one:
        raise BrokenError("does not survive the way to another process")
    return one


def _has_default(field: Any) -> bool:
    from dataclasses import MISSING

    return field.default is not MISSING or field.default_factory is not MISSING


def _playground(tracker: Any, scenarios: Sequence[Any]) -> tuple[Any, str]:
    """The first scenario the filter runs on, and why not on the linear one."""
    reasons: list[str] = []
    for scenario in (Linear(), Merwe(T=8, R=0.1), *scenarios):
        lacking = [n for n in getattr(tracker, "needs", ()) if not has(scenario.model, n)]
        conflicts = getattr(tracker, "conflicts", None)
        mistakes = list(conflicts(scenario).values()) if conflicts and not lacking else []
        if not lacking and not mistakes:
            return scenario, "; ".join(reasons)
        reasons.append(mistakes[0] if mistakes else f"needs {lacking[0]}")
    return None, "; ".join(reasons)


class _Pass(NamedTuple):
    """Estimates of every step: mean (n_x, T + 1, M), cov (n_x, n_x, T + 1, M); draws made or not."""

    mean: Array
    cov: Array
    random: bool


def _noise() -> Generator:
    return Generator(SFC64(20260101))


def _data(scenario: Any, runs: int) -> Simulation:
    data: Simulation = scenario.simulate(RunStreams(1, range(runs)), runs)
    return data


def _filtered(tracker: Any, scenario: Any, data: Simulation) -> _Pass:
    rng, runs = _noise(), data.truth.shape[-1]
    state = tracker.init(scenario.model, data.prior, rng)
    found = [tracker.estimate(state)]
    for i, k in enumerate(scenario.steps[1:]):
        state = tracker.step(scenario.model, state, data.measurements[:, i], int(k), rng)
        found.append(tracker.estimate(state))
    n = found[0].mean.shape[0]
    covs = [
        np.broadcast_to(with_trailing(np.asarray(g.cov), 1, leading=2), (n, n, runs)) for g in found
    ]
    is_random = rng.bit_generator.state["state"]["state"].tolist() != _start()
    return _Pass(np.stack([g.mean for g in found], axis=1), np.stack(covs, axis=2), is_random)


def _start() -> list[int]:
    state: list[int] = _noise().bit_generator.state["state"]["state"].tolist()
    return state


def _shapes(tracker: Any, scenario: Any) -> None:
    runs, rng = 5, _noise()
    data = _data(scenario, runs)
    n = data.truth.shape[0]
    state = tracker.init(scenario.model, data.prior, rng)
    for i, k in enumerate(scenario.steps):
        if i:
            state = tracker.step(scenario.model, state, data.measurements[:, i - 1], int(k), rng)
        found = tracker.estimate(state)
        for name, array, expected in (
            ("mean", found.mean, [(n, runs)]),
            ("cov", found.cov, [(n, n), (n, n, runs)]),
        ):
            if np.shape(array) not in expected:
                raise BrokenError(f"{name} at step {k} is {np.shape(array)}, not {expected[-1]}")
            if np.asarray(array).dtype != np.float64:
                raise BrokenError(f"{name} at step {k} is of {np.asarray(array).dtype}")
            if not np.isfinite(array).all():
                raise BrokenError(f"{name} at step {k} is not finite")
        for name, values in getattr(tracker, "diagnostics", lambda state: {})(state).items():
            if np.shape(values) != (runs,):
                raise BrokenError(f"diagnostic {name} is {np.shape(values)}, not {(runs,)}")


def _purity(tracker: Any, scenario: Any) -> None:
    data = _data(scenario, 5)
    state = tracker.init(scenario.model, data.prior, _noise())
    z, k = data.measurements[:, 0], int(scenario.steps[1])
    kept = deepcopy((state, z))
    first = tracker.estimate(tracker.step(scenario.model, state, z, k, _noise()))
    if not _same(kept, (state, z)):
        raise BrokenError("the state or the measurement is written to; make a new array")
    again = tracker.estimate(tracker.step(scenario.model, state, z, k, _noise()))
    if not np.array_equal(first.mean, again.mean, equal_nan=True):
        raise BrokenError("the same step with the same noise gives another estimate")


def _same(a: Any, b: Any) -> bool:
    if isinstance(a, np.ndarray):
        return bool(np.array_equal(a, b, equal_nan=a.dtype.kind == "f"))
    if isinstance(a, tuple | list):
        return all(_same(x, y) for x, y in zip(a, b, strict=True))
    if is_dataclass(a) and not isinstance(a, type):
        return all(_same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
    return True


def _independence(tracker: Any, scenario: Any) -> None:
    runs = 6
    data = _data(scenario, runs)
    whole = _filtered(tracker, scenario, data)
    other = data.measurements.copy()
    other[..., -1] += 1.0
    moved = _filtered(tracker, scenario, data._replace(measurements=other))
    if not np.array_equal(whole.mean[..., :-1], moved.mean[..., :-1], equal_nan=True):
        raise BrokenError("another measurement in one run changes the estimates of the others")
    if not whole.random:
        alone = _filtered(tracker, scenario, _data(scenario, 1))
        if not np.allclose(alone.mean, whole.mean[..., :1], rtol=1e-10, atol=1e-10, equal_nan=True):
            raise BrokenError("the first run comes out differently without the others")


def _gaps(tracker: Any, scenario: Any) -> None:
    data = _data(scenario, 5)
    seen = data.measurements.copy()
    seen[:, 1, ::2] = np.nan
    if not np.isfinite(_filtered(tracker, scenario, data._replace(measurements=seen)).mean).all():
        raise BrokenError("the estimate is not finite where a measurement is missing (NaN)")


def _equals_kalman(tracker: Any, scenario: Any) -> None:
    data = _data(scenario, _RUNS)
    mine, exact = _filtered(tracker, scenario, data), _kalman(scenario, data)
    error, sigma = mine.mean - exact.mean, np.sqrt(linalg.diagonal(exact.cov))
    if not mine.random:
        off = float(np.abs(error / sigma).max())
        if off > 1e-6:
            raise BrokenError(f"the mean is off by up to {off:.2g} standard deviations")
        ratio = float(np.abs(mine.cov / exact.cov - 1.0)[exact.cov != 0.0].max())
        if ratio > 1e-6:
            raise BrokenError(f"the covariance is off by up to {100 * ratio:.2g} %")
        return
    stderr = error.std(axis=-1, ddof=1) / np.sqrt(_RUNS)
    # A cloud of N points has a bias of the order of sigma / N.
    allowed = _OUTLIER * stderr + 3.0 * sigma.mean(axis=-1) / getattr(tracker, "N", 100)
    bias = np.abs(error.mean(axis=-1))
    if (bias > allowed).any():
        worst = float((bias / allowed).max())
        raise BrokenError(f"the mean is biased, by {worst:.1f} times what chance and N allow")


def _kalman(scenario: Any, data: Simulation) -> _Pass:
    motion, sensor = scenario.model
    n, runs = data.prior.mean.shape
    cov = np.broadcast_to(with_trailing(data.prior.cov, 1, leading=2), (n, n, runs))
    found = [Gaussian(data.prior.mean, np.asarray(cov))]
    for i, k in enumerate(scenario.steps[1:]):
        predicted = kalman.predict(found[-1], motion.F, motion.Q)
        nu = data.measurements[:, i] - sensor.measurement(predicted.mean, int(k)).mean
        H, R = sensor.jacobian(predicted.mean, int(k)), sensor.measurement(predicted.mean, 0).cov
        found.append(kalman.update(predicted, nu, H, R)[0])
    mean, cov = (np.stack(a, axis=-2) for a in ([g.mean for g in found], [g.cov for g in found]))
    return _Pass(mean, cov, random=False)


_CHECKS: dict[str, tuple[str, Callable[[Any, Any], None]]] = {
    "shapes": ("shapes", _shapes),
    "purity": ("step changes nothing it is given", _purity),
    "independence": ("a run does not see the others", _independence),
    "gaps": ("a missing measurement is predicted over", _gaps),
    "kalman": ("equals the Kalman filter on a linear model", _equals_kalman),
}


def report(found: dict[str, list[Finding]]) -> Iterator[str]:
    """Lines for people."""
    for kind, findings in found.items():
        yield f"{kind}:"
        yield from (f"  {finding}" for finding in findings)
