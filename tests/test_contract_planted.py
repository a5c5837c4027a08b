"""The contract finds mistakes planted in filters written by hand, and accuses none without."""

import inspect
import re
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import pytest

from tests import planted
from tests.commands import trackbench
from tests.planted import HandEKF, HandKF, HandPF, HandUKF, problem, with_bug
from trackbench.adapters import PerRun
from trackbench.contract.compare_with_references import misfit
from trackbench.contract.findings import Finding
from trackbench.contract.other_sensors import with_sigma_as_variance
from trackbench.contract.problems import PLANAR, RADAR, UNEQUAL, ModelDraws
from trackbench.contract.run_contract import check_filter
from trackbench.contract.why_not_running import why_not
from trackbench.models.sensors.position import PositionSensor
from trackbench.registry import kinds

COMMON = ("missing is zero", "not definite", "not symmetric", "sigma", "dt ignored", "axes swapped")
COMMON = (*COMMON, "global noise", "late", "prior ignored", "Q times dt", "Q forgotten")
KALMAN = ("F transposed", "sign of innovation", "stale covariance", "R forgotten", "float32")
KALMAN = (*KALMAN, "half Joseph", "gain forgotten")
EKF = ("degrees", "no wrap", "runs mixed", "in place", "uncorrelated", "speed limit")
EKF = (*EKF, "place ignored", "place added", "sensor stays", "kind of motion ignored")
PARTICLES = ("degrees", "no wrap", "runs mixed", "weights not normalized", "weights stay")
PARTICLES = (*PARTICLES, "weights squared", "weights ignored", "mean of squares")
BUGS: dict[type[Any], tuple[str, ...]] = {
    HandEKF: (*COMMON, *KALMAN, *EKF, "other interval"),
    HandPF: (*COMMON, *PARTICLES, "velocity without noise"),
    HandKF: (*COMMON, *KALMAN, "fixed gain"),
    HandUKF: ("degrees", "no wrap", "axes swapped", "sigma"),  # else the code of HandKF
}
MODEL_NEEDED = {"sigma", "Q times dt", "Q forgotten", "R forgotten", "half Joseph", "no wrap"}
"""Mistakes in constants, which no problem but the filter's shows."""


def found(cls: type[Any], on: ModelDraws | None = None) -> dict[str, str]:
    return {f.check: f.why for f in findings(cls, on) if f.verdict == "bad"}


def is_bad(cls: type[Any], on: ModelDraws | None = None) -> bool:
    """Whether any check finds a mistake; the checks after it are left out."""
    return any(f.verdict == "bad" for f in findings(cls, on))


def findings(cls: type[Any], on: ModelDraws | None) -> Iterator[Finding]:
    return check_filter(cls, None if on is None else cls(), on=on)


def problem_of(base: type[Any]) -> ModelDraws | None:
    """The problem of a filter with constants of its own."""
    text = planted.OWN_RADAR if base is HandUKF else planted.OWN
    return problem(text) if issubclass(base, PerRun) else None


@pytest.mark.parametrize("base", BUGS)
def test_a_right_filter_is_good(base: type[Any]) -> None:
    assert not found(with_bug(base, ""))
    assert not found(with_bug(base, ""), problem_of(base))


@pytest.mark.parametrize(("base", "bug"), [(b, bug) for b, bugs in BUGS.items() for bug in bugs])
def test_a_mistake_is_found(base: type[Any], bug: str) -> None:
    """A mistake in constants on the filter's own problem, others on those of the contract."""
    on = problem_of(base) if bug in MODEL_NEEDED or base is HandUKF else None
    assert is_bad(with_bug(base, bug), on)


@pytest.mark.parametrize(
    ("base", "bug", "cause"),
    [
        (HandEKF, "late", "fit the truth one step earlier: returned before the update?"),
        (HandPF, "late", "fit the truth one step earlier: returned before the update?"),
        (HandKF, "axes swapped", "fit the truth with x and y exchanged"),
        (HandKF, "missing is zero", "is taken as zero"),
        (HandKF, "dt ignored", "do not depend on the interval dt"),
        (HandUKF, "gain forgotten", "is the same with and without a measurement"),
        (HandEKF, "not symmetric", "not symmetric"),
        (HandPF, "not definite", "not positive definite"),
        (HandPF, "global noise", "global np.random"),
        (HandPF, "sigma", "the filter takes sigma for sigma^2, as it fits noise"),
        (HandEKF, "sigma", "the filter takes sigma for sigma^2, as it fits noise"),
        (HandEKF, "Q times dt", "the covariance is too large"),
        (HandEKF, "place ignored", "with a radar at [-1500, 2000] the estimates equal those"),
        (HandEKF, "place added", "fits with a radar at the origin, and not with a radar at"),
        (HandEKF, "sensor stays", "and not with a radar that moves on a `platform`"),
        (
            HandEKF,
            "kind of motion ignored",
            "with the motion `cwna`, and not with `cv` of the same",
        ),
        (HandEKF, "NIS doubled", "are the innovation and S those before the update?"),
    ],
)
def test_the_cause_is_named(base: type[Any], bug: str, cause: str) -> None:
    assert any(f.verdict == "bad" and cause in f.why for f in findings(with_bug(base, bug), None))


def test_the_digits_of_a_start_are_not_taken_for_those_of_float32() -> None:
    verdicts = {f.check: f.verdict for f in findings(with_bug(HandEKF, "returns its start"), None)}
    assert verdicts["shapes"] == "good"


def test_the_errors_of_an_angle_without_wrap_name_it() -> None:
    """As a cause of large errors, whatever the check of the angles says."""
    unwrapped = misfit(with_bug(HandEKF, "no wrap")(), ModelDraws(base=RADAR), 40)
    assert unwrapped
    what = unwrapped.text
    assert "the innovation of azimuth is not wrapped" in what
    of_other_cause = misfit(with_bug(HandEKF, "sigma")(), ModelDraws(base=RADAR), 40)
    assert of_other_cause
    assert "not wrapped" not in of_other_cause.text


@pytest.mark.parametrize("base", [HandKF, HandUKF])
def test_sigma_for_variance_is_named_if_the_filter_fits_such_noise(base: type[Any]) -> None:
    """Also of constants of a filter; other mistakes that make the covariance wrong are not called so."""
    on = problem_of(base)
    consistency = "errors and covariance fit reference filters"
    assert "takes sigma for sigma^2" in found(with_bug(base, "sigma"), on)[consistency]
    for bug in ("axes swapped", "Q times dt", "R forgotten", "Q forgotten"):
        if bug in BUGS[base]:
            assert "takes sigma for sigma^2" not in found(with_bug(base, bug), on)[consistency]
    # Sigma and its square are alike near one.
    near_one = replace(PLANAR, sensor=PositionSensor(sigma=1.2))
    assert with_sigma_as_variance(near_one) is None


def test_the_errors_of_a_filter_at_the_origin_name_the_place() -> None:
    """On the problem of a config, whose place may be a constant of the filter."""
    at = "at: [-1500, 400], sigma_range"
    on = problem(planted.OWN_RADAR.replace("sigma_range", at))
    reasons = found(with_bug(HandEKF, "place ignored"), on)
    assert "ignores the place" in reasons["errors and covariance fit reference filters"]
    assert "uses the place of the sensor" not in reasons
    assert not found(with_bug(HandEKF, ""), on)
    # Other mistakes are not called one of the place.
    other = found(with_bug(HandEKF, "degrees"), on)
    assert "ignores the place" not in other["errors and covariance fit reference filters"]
    # A config whose sensors stand at the origin cannot show it, and says what config does.
    at_origin = list(findings(with_bug(HandEKF, ""), problem(planted.OWN_RADAR)))
    (place,) = [f for f in at_origin if f.check == "uses the place of the sensor"]
    assert place.verdict == "left out"
    assert "give `--on` a config whose sensor stands elsewhere, as by `at: [" in place.why


RANDOM = ("apf", "enkf", "pf")


@pytest.mark.parametrize("kind", [*RANDOM, "ckf", "cmkf", "ekf", "iekf", "iplf", "ukf"])
def test_shipped_filters_fit_at_another_seed(kind: str) -> None:
    tracker: Any = kinds("filters")[kind]()
    tracker = replace(tracker, N=1000) if kind in RANDOM else tracker
    for scenario in (UNEQUAL, ModelDraws(base=RADAR)):
        if not why_not(tracker, scenario):
            assert not misfit(tracker, scenario, 200, seed=31)


def test_a_copy_of_the_packaged_imm_is_good(tmp_path: Any) -> None:
    source = inspect.getsource(inspect.getmodule(kinds("filters")["imm"]))  # type: ignore[arg-type]
    (tmp_path / "mine.py").write_text(source.replace('"filters", "imm"', '"filters", "mine"'))
    config = planted.OWN.replace("filters: {}", "plugins: [mine.py]\nfilters:")
    motions = "[{kind: cwna, q: 1}, {kind: cwna, q: 100}], transition: [[0.9, 0.1], [0.1, 0.9]]"
    (tmp_path / "c.yaml").write_text(config + f"  Mine: {{kind: mine, motions: {motions}}}\n")
    alone = trackbench("check", "--contract", "mine.py", cwd=tmp_path)
    assert alone.returncode == 0, alone.stdout
    assert "motions, transition have none" in alone.stdout
    on = trackbench("check", "--contract", "mine.py", "--on", "c.yaml", cwd=tmp_path)
    assert on.returncode == 0, on.stdout + on.stderr
    assert on.stdout.startswith("Mine:")
    assert "good  predicts over a missing measurement" in on.stdout


def test_a_filter_with_constants_is_checked_on_its_config(tmp_path: Any) -> None:
    text = """from trackbench.adapters import PerRun
from tests.planted import HandKF

class Mine(HandKF, kind="mine"):
    bug = "sigma"
"""
    (tmp_path / "mine.py").write_text(text)
    (tmp_path / "c.yaml").write_text(
        planted.OWN.replace("filters: {}", "filters: {KF: {kind: kf}}")
    )
    alone = trackbench("check", "--contract", "mine.py", cwd=tmp_path)
    assert "has constants of its own: `--on CONFIG`" in alone.stdout
    on = trackbench("check", "--contract", "mine.py", "--on", "c.yaml", cwd=tmp_path)
    assert on.returncode == 1, on.stdout + on.stderr
    assert "ANEES" in on.stdout
    tuned = "filters: {Mine: {kind: mine}, Loose: {kind: mine, q: 40}}"
    (tmp_path / "c.yaml").write_text(planted.OWN.replace("filters: {}", tuned))
    (tmp_path / "mine.py").write_text(text.replace("sigma", ""))
    other = trackbench("check", "--contract", "mine.py", "--on", "c.yaml", cwd=tmp_path)
    assert other.returncode == 0, other.stdout + other.stderr
    assert "fits with other keys; with these" in other.stdout
    lone = trackbench("check", "--on", "c.yaml", cwd=tmp_path)
    assert lone.returncode == 2


OTHER_METHOD = '''\
import numpy as np
from trackbench.adapters import PerRun


class Mine(PerRun, kind="mine"):
    """A Kalman filter with R at the measured position, where the references take the predicted one."""

    def start(self, mean, cov):
        self.x, self.P = mean, cov

    def step(self, z, dt):
        m = self.functions
        F = m.F(self.x, self.P)
        self.x, self.P = m.f(self.x), F @ self.P @ F.T + m.Q(self.x)
        if z is None:
            return self.x, self.P
        H = m.H(self.x, self.P)
        measured = self.x + H.T @ (z - H @ self.x)
        S = H @ self.P @ H.T + m.R(measured)
        K = np.linalg.solve(S, H @ self.P).T
        self.x, self.P = self.x + K @ (z - H @ self.x), self.P - K @ S @ K.T
        return self.x, self.P
'''


def test_a_misfit_has_its_limit_and_the_way_on(tmp_path: Any) -> None:
    """Without a limit nobody could judge it, and another method was called bad like a mistake."""
    (tmp_path / "mine.py").write_text(OTHER_METHOD)
    done = trackbench("check", "--contract", "mine.py", "--on", "lidar", cwd=tmp_path)
    assert done.returncode == 1
    (line,) = [line for line in done.stdout.splitlines() if line.split()[0] == "bad"]
    # Both references are equal: the squared limit is 0.05.
    assert re.search(r": distance from the reference 0\.\d+ of its standard deviations \(", line)
    assert "limit: 0.224); no usual mistake explains it: a method that differs on purpose" in line
    assert line.endswith("(docs/extending.md#the-contract)")
