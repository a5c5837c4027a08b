"""Every shipped filter keeps the contract, and every kind of breach is noticed."""

import json
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from tests.commands import trackbench
from tests.conftest import EXPERIMENT_FILES, shipped
from tests.linear_problem import LINEAR
from trackbench.adapters.per_run import PerRun, loop_over_runs
from trackbench.contract import compare_with_references
from trackbench.contract.covariance_check import check_covariance
from trackbench.contract.findings import ContractError
from trackbench.contract.run_contract import check_filter
from trackbench.core.distributions import Gaussian, per_run_moments
from trackbench.filters.base import Steps
from trackbench.filters.bootstrap_pf import PF
from trackbench.filters.ekf import EKF
from trackbench.filters.gaussian_base import Tracked
from trackbench.filters.kf import KF
from trackbench.registry import kinds


@pytest.fixture(scope="module")
def used() -> dict[str, tuple[Any, Any]]:
    """A filter of each kind that an experiment uses, and the shortest scenario that it has there."""
    points = [p for name in EXPERIMENT_FILES for p in shipped(name).points]
    points.sort(key=lambda point: -len(point.scenario.steps))
    return {
        f.kind: (f, p.assumed_scenario(label)) for p in points for label, f in p.filters.items()
    }


OURS = sorted(
    k
    for k, cls in kinds("filters").items()
    if cls.__module__.startswith("trackbench.") and not cls.runs_program
)


@pytest.mark.parametrize("kind", OURS)
def test_shipped_filters_keep_it(
    used: dict[str, tuple[Any, Any]], kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those with particles have 250 here; a user's filter is compared with 1000."""
    monkeypatch.setattr(compare_with_references, "_LEAST_N", 250)
    cls = kinds("filters")[kind]
    needs_keys = any(f.default is f.default_factory is MISSING for f in fields(cls))
    tracker, scenario = used.get(kind, (None, None))
    scenarios = [] if scenario is None else [scenario]
    found = [*check_filter(cls, tracker if needs_keys else None, scenarios)]
    assert [str(f) for f in found if f.verdict == "bad"] == []
    # The contract has no problem of two components; test_grid_2d.py compares with exact answers.
    assert len(found) > 2 or kind == "grid-2d"
    for finding in found:
        assert finding.verdict == "good" or (
            finding.why and kind not in ("ekf", "ukf", "pf", "apf")
        )


@dataclass(frozen=True, kw_only=True)
class Base(EKF):
    pass


class WrongShape(Base):
    def estimate(self, state: Tracked) -> Any:
        found = super().estimate(state)
        return type(found)(found.mean.T, found.cov)


class ForAll(Base):
    """The first run's estimate, in every run."""

    def estimate(self, state: Tracked) -> Any:
        found = super().estimate(state)
        mean = np.repeat(found.mean[:, :1], found.mean.shape[1], axis=1)
        return type(found)(mean, found.cov)


class Reserved(Base):
    def diagnostics(self, state: Tracked) -> dict[str, Any]:
        return {"nees": state.nis}


class WritesState(Base):
    def step(self, model: Any, state: Tracked, z: Any, k: int, rng: Any) -> Any:
        new = super().step(model, state, z, k, rng)
        state.nis[:] = 0.0
        return new


class WritesMeasurement(Base):
    def step(self, model: Any, state: Tracked, z: Any, k: int, rng: Any) -> Any:
        z *= 1.0 + 1e-3
        return super().step(model, state, z, k, rng)


class WritesPrior(Base):
    def init(self, model: Any, prior: Any, rng: Any) -> Any:
        prior.mean[:] += 0.0001
        return super().init(model, prior, rng)


class Leaves(Base):
    def step(self, model: Any, state: Tracked, z: Any, k: int, rng: Any) -> Any:
        raise SystemExit


class OwnNoise(Base):
    def step(self, model: Any, state: Tracked, z: Any, k: int, rng: Any) -> Any:
        return super().step(model, state, z + np.random.default_rng().normal(), k, rng)


class SeesOthers(Base):
    def step(self, model: Any, state: Tracked, z: Any, k: int, rng: Any) -> Any:
        return super().step(model, state, z - 0.1 * z.mean(axis=1, keepdims=True), k, rng)


class FillsGaps(Base):
    def estimate(self, state: Tracked) -> Any:
        found = super().estimate(state)
        return type(found)(np.where(np.isnan(state.nis), np.nan, found.mean), found.cov)

    def init(self, model: Any, prior: Any, rng: Any) -> Any:
        return super().init(model, prior, rng)._replace(nis=np.zeros(prior.mean.shape[1]))


class WrongGain(Base):
    def step(self, model: Any, state: Tracked, z: Any, k: int, rng: Any) -> Any:
        new = super().step(model, state, z, k, rng)
        P = new.posterior
        return new._replace(posterior=type(P)(P.mean, 1.01 * P.cov))


class Biased(PF):
    def estimate(self, state: Any) -> Any:
        found = super().estimate(state)
        return type(found)(found.mean + 10.0, found.cov)


class Backwards(Base):
    """All steps in one call, from the last measurement to the first."""

    def all_steps(self, model: Any, state: Tracked, z: Any, k: int) -> Any:
        states = []
        for i in range(z.shape[1]):
            state = self.step(model, state, z[:, -1 - i], k + i, None)  # type: ignore[arg-type]
            states.append(state)
        return _side_by_side(states)


class TooFew(Base):
    def all_steps(self, model: Any, state: Tracked, z: Any, k: int) -> Any:
        return _side_by_side([state])


class WrongDiagnostics(Base):
    """All steps in one call, with diagnostics of their own."""

    def all_steps(self, model: Any, state: Tracked, z: Any, k: int) -> Any:
        states = []
        for i in range(z.shape[1]):
            state = self.step(model, state, z[:, i], k + i, None)  # type: ignore[arg-type]
            states.append(state)
        steps = _side_by_side(states)
        return steps._replace(diagnostics={"nis": 2.0 * steps.diagnostics["nis"]})


def _side_by_side(states: list[Tracked]) -> Steps:
    found = [per_run_moments(state.posterior) for state in states]
    mean = np.stack([x.mean for x in found], axis=1)
    cov = np.stack([x.cov for x in found], axis=2)
    nis = np.stack([state.nis for state in states])
    return Steps(Gaussian(mean, cov), {"nis": nis}, states.__getitem__)


class Raises(Base):
    def step(self, model: Any, state: Tracked, z: Any, k: int, rng: Any) -> Any:
        raise KeyError("k")


class SharesEstimate(OwnNoise):
    """Writes each estimate into one array, so that two of them are always equal."""

    buffer: ClassVar[dict[tuple[int, ...], Any]] = {}

    def estimate(self, state: Tracked) -> Any:
        found = super().estimate(state)
        mean = self.buffer.setdefault(found.mean.shape, np.empty(found.mean.shape))
        mean[:] = found.mean
        return type(found)(mean, found.cov)


class _Handle:
    """Memory outside of Python, as a library in C has it: a copy of the handle has the same memory."""

    def __init__(self, mean: Any, cov: Any) -> None:
        self.mean, self.cov = mean, cov

    def __deepcopy__(self, memo: Any) -> "_Handle":
        return self


class SharesCopies(PerRun):
    """An EKF whose state is in such memory."""

    def start(self, mean: Any, cov: Any) -> None:
        self.handle = _Handle(mean, cov)

    def step(self, z: Any, dt: float) -> Any:
        m, h = self.functions, self.handle
        F = m.F(h.mean, h.cov)
        h.mean, h.cov = m.f(h.mean), F @ h.cov @ F.T + m.Q(h.mean)
        if z is not None:
            H = m.H(h.mean, h.cov)
            K = h.cov @ H.T @ np.linalg.inv(H @ h.cov @ H.T + m.R(h.mean))
            h.mean = h.mean + K @ m.innovation(z, m.h(h.mean))
            P = (np.eye(len(K)) - K @ H) @ h.cov
            h.cov = 0.5 * (P + P.T)
        return h.mean.copy(), h.cov.copy()


@dataclass(frozen=True, kw_only=True)
class Listed(EKF):
    names: Any = ()

    def __hash__(self) -> int:
        raise TypeError("unhashable type: 'list'")


@dataclass(frozen=True, kw_only=True)
class Needy(EKF):
    gain: float


@pytest.mark.parametrize(
    ("cls", "check", "why"),
    [
        (WrongShape, "shapes", "the mean of the estimate is an array (5, 4) of float64"),
        (ForAll, "runs are indep", "changes the estimates of the others"),
        (Reserved, "shapes", "a diagnostic cannot be named 'nees'"),
        (OwnNoise, "equal runs give", "the estimates differ the second time"),
        (WritesState, "step leaves", "is written to"),
        (WritesMeasurement, "step leaves", "is written to"),
        (WritesPrior, "step leaves", "the prior is written to"),
        (SharesEstimate, "step leaves", "gives another estimate"),
        (loop_over_runs(SharesCopies), "equal runs give", "a copy of a state"),
        (Leaves, "shapes", "raised SystemExit()"),
        (OwnNoise, "step leaves", "gives another estimate"),
        (SeesOthers, "runs are indep", "changes the estimates of the others"),
        (FillsGaps, "predicts over", "not finite where"),
        (WrongGain, "equals the Kalman", "is off by up to"),
        (Biased, "equals the Kalman", "the mean is biased"),
        (Backwards, "shapes", "all_steps gives another estimate than step at step 1"),
        (TooFew, "shapes", "all_steps gives 1 states, not one per measurement"),
        (WrongDiagnostics, "shapes", "all_steps gives another nis than step at step 1"),
        (Raises, "shapes", "KeyError"),
        (Listed, "has a default", "cannot be hashed"),
    ],
)
def test_a_breach_is_noticed(cls: type, check: str, why: str) -> None:
    bad = (f.why for f in check_filter(cls) if f.verdict == "bad" and f.check.startswith(check))
    assert why in next(bad)


def test_the_defaults_of_a_filter_that_is_given_are_not_called_good() -> None:
    """Their check was called good although nothing was checked."""
    name = "has a default for every key"
    checked = next(check_filter(EKF))
    assert (checked.check, checked.verdict) == (name, "good")
    assert next(check_filter(Needy, Needy(gain=1.0))).check != name


def test_the_command(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(
        "from dataclasses import dataclass\n"
        "from trackbench.filters.ekf import EKF\n"
        "from trackbench.registry import register\n\n\n"
        '@register("filters", "mine")\n'
        "@dataclass(frozen=True, kw_only=True)\n"
        "class Mine(EKF):\n"
        '    """The EKF, and nothing new."""\n'
    )
    good = trackbench("check", "--contract", "mine.py", cwd=tmp_path)
    assert good.returncode == 0, good.stderr
    assert "good  equals the Kalman filter on a linear model" in good.stdout
    with (tmp_path / "mine.py").open("a") as file:
        file.write("\n    def estimate(self, state):\n        return 3\n")
    bad = trackbench("check", "--contract", "mine.py", cwd=tmp_path)
    assert bad.returncode == 1
    assert "bad  shapes" in bad.stdout
    as_json = trackbench("check", "--contract", "mine.py", "--json", cwd=tmp_path)
    assert as_json.returncode == 1
    (kind,) = map(json.loads, as_json.stdout.splitlines())
    assert (kind["file"], kind["kind"]) == ("mine.py", "mine")
    assert {"good", "bad"} <= {finding["verdict"] for finding in kind["contract"]}
    (tmp_path / "mine.py").write_text("x = 1\n")
    none = trackbench("check", "--contract", "mine.py", cwd=tmp_path)
    assert none.returncode == 2
    assert "mine.py: registers no filter" in none.stderr
    assert trackbench("check", cwd=tmp_path).returncode == 2


@dataclass(frozen=True, kw_only=True)
class _OneSided(KF):
    """A Kalman filter one of whose covariances has a NaN above the diagonal."""

    def estimate(self, state: Tracked) -> Gaussian:
        cov = per_run_moments(state.posterior).cov.copy()
        cov[0, 1, 0] = np.nan
        return Gaussian(state.posterior.mean, cov)

    def all_steps(self, *_: object) -> None:
        """Return nothing: steps are made one by one."""


def test_a_nan_of_one_side_is_not_symmetric() -> None:
    with pytest.raises(ContractError, match="its mirror image is not"):
        check_covariance(_OneSided(), LINEAR)
