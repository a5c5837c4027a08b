"""Angles of the state: whole turns are no error, of recordings, equations, particles and scores."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import atan2, cos, pi, sin, sqrt
from pathlib import Path
from random import Random
from typing import ClassVar

import numpy as np
import pytest

from tests.conftest import make_filter, track
from trackbench import api
from trackbench.config.load import load
from trackbench.core.angles import near, particles_together
from trackbench.core.arrays import Array
from trackbench.core.particles import Particles
from trackbench.errors import UserError
from trackbench.evaluation.simulated_runs import simulate
from trackbench.filters.base import AnyFilter
from trackbench.models.motions.map_or_ode import MapMotion
from trackbench.models.motions.nonlinear import NonlinearMotion
from trackbench.models.sensors.function import FunctionSensor
from trackbench.report.tables_and_figures import Results
from trackbench.scenarios.recordings.undeclared_angles_check import has_turns
from trackbench.scenarios.starts.gaussian import GaussianStart
from trackbench.scenarios.targets.driven import Driven
from trackbench.scenarios.tracking import Tracking

pytestmark = pytest.mark.usefixtures("no_report")

T, STEPS, R, Q = 0.5, 240, 0.01, (1e-5, 4e-5)
RECORDED = """
name: compass
scenario:
  kind: tracking
  target: {kind: measured, measurements: z.csv, truth: truth.csv, state: [heading, rate] MORE}
  assume:
    motion: {kind: map, components: [heading, rate], next: {heading: heading + rate*T, rate: rate},
             Q: {heading: 1e-5, rate: 4e-5}}
  sensor: {kind: function, h: {compass: heading}, angles: [compass], R: 0.01}
  start: {kind: given, mean: {heading: 2.0}, sigma: {heading: 0.5, rate: 0.5}}
filters:
  KF: {kind: kf}
  UKF: {kind: ukf}
  PF: {kind: pf, N: 500}
  EnKF: {kind: enkf, N: 40}
metrics: [rmse_heading, rmse_rate, nees, crps_heading]
figures:
  heading: {kind: estimates, filters: [KF]}
"""


def _wrapped(angle: float) -> float:
    return atan2(sin(angle), cos(angle))


def _recorded() -> tuple[list[float], list[float], list[float]]:
    """Headings, rates and compass readings of a target that turns through several cuts."""
    rng, heading, rate = Random(5), 1.9, 0.3
    headings, rates, seen = [], [], []
    for _ in range(STEPS):
        heading += rate * T + sqrt(Q[0]) * rng.gauss(0, 1)
        rate += sqrt(Q[1]) * rng.gauss(0, 1)
        headings.append(heading)
        rates.append(rate)
        seen.append(_wrapped(heading + sqrt(R) * rng.gauss(0, 1)))
    return headings, rates, seen


def _kalman(seen: Sequence[float]) -> list[float]:
    """Headings by a Kalman filter of two components, written out."""
    h, w, a, b, c = 2.0, 0.0, 0.25, 0.0, 0.25
    found = []
    for z in seen:
        h, a, b = h + T * w, a + 2 * T * b + T * T * c + Q[0], b + T * c
        c += Q[1]
        nu, S = _wrapped(z - h), a + R
        h, w = h + a / S * nu, w + b / S * nu
        a, b, c = a - a * a / S, b - a * b / S, c - b * b / S
        found.append(h)
    return found


def _write(folder: Path, turn: float, every: int = 1) -> None:
    """Write the recording, headings in [turn - 2 pi, turn)."""
    headings, rates, seen = _recorded()

    def within(x: float) -> float:
        return (x - turn) % (2 * pi) + turn - 2 * pi

    times = [T * k for k in range(STEPS)]
    rows = [f"{t},{within(z)}" for t, z in zip(times, seen, strict=True)]
    (folder / "z.csv").write_text("\n".join(["time,compass", *rows, ""]))
    truth = zip(times, headings, rates, strict=True)
    lines = [f"{t},{within(h)},{w}" for t, h, w in list(truth)[::every]]
    (folder / "truth.csv").write_text("\n".join(["time,heading,rate", *lines, ""]))


def _results(folder: Path, text: str) -> Results:
    (folder / "c.yaml").write_text(text)
    options = api.Options(engine="serial", quiet=True, out=folder / "out")
    return Results(api.run(folder / "c.yaml", options, formats=()).folder)


@pytest.mark.parametrize("turn", [pi, 2 * pi])
def test_a_recorded_heading_through_the_cut(tmp_path: Path, turn: float) -> None:
    _write(tmp_path, turn)
    results = _results(tmp_path, RECORDED.replace("MORE", ""))
    runs = results.runs({})
    headings, _, seen = _recorded()
    errors = [_wrapped(x - y) ** 2 for x, y in zip(_kalman(seen), headings, strict=True)]
    expected = sqrt(sum(errors) / STEPS)
    for label in ("KF", "UKF"):
        assert runs[label, "rmse_heading"][0] == pytest.approx(expected, rel=1e-6)
    for label in ("PF", "EnKF"):
        assert runs[label, "rmse_heading"][0] < 2.0 * expected
    assert (runs["KF", "nees"] < 4.0).all()
    assert runs["KF", "crps_heading"][0] < expected
    # The figure's curves of the truth and of the estimate go on through the cut.
    curves = [line.get_ydata() for ax in results.figure("heading").axes for line in ax.lines]
    for curve in curves:
        step = np.diff(np.asarray(curve, dtype=float))
        assert np.abs(step[np.isfinite(step)]).max(initial=0.0) < pi


def test_a_truth_is_interpolated_the_shorter_way(tmp_path: Path) -> None:
    _write(tmp_path, pi, every=4)
    results = _results(tmp_path, RECORDED.replace("MORE", ", truth_gap: 3"))
    headings, rates, seen = _recorded()
    found, squares = _kalman(seen), []
    for k in range(STEPS - 3):
        first, share = k - k % 4, k % 4 / 4
        if first + 4 < STEPS:
            truth = headings[first] + share * (headings[first + 4] - headings[first])
            squares.append(_wrapped(found[k] - truth) ** 2)
    squares.append(_wrapped(found[236] - headings[236]) ** 2)
    expected = sqrt(sum(squares) / len(squares))
    assert results.runs({})["KF", "rmse_heading"][0] == pytest.approx(expected, rel=1e-6)
    assert abs(rates[0]) > 0.1  # it turns


def test_a_target_says_what_its_angles_are(tmp_path: Path) -> None:
    _write(tmp_path, pi)
    text = RECORDED.replace("angles: [compass], ", "")
    text = text.replace(
        "h: {compass: heading}", 'h: {compass: "atan2(sin(heading), cos(heading))"}'
    )
    text = text.replace("R: 0.01", "angles: [compass], R: 0.01")
    text = text.replace("{kind: kf}", "{kind: ekf}")
    without = _results(tmp_path, text.replace("MORE", "")).runs({})["EnKF", "rmse_heading"][0]
    named = _results(tmp_path, text.replace("MORE", ", angles: [heading]")).runs({})
    assert without > 1.0
    assert named["EnKF", "rmse_heading"][0] < 0.1
    (tmp_path / "bad.yaml").write_text(text.replace("MORE", ", angles: [course]"))
    with pytest.raises(UserError, match=r"angles.0: 'course' is not one of heading, rate"):
        api.run(tmp_path / "bad.yaml", out=tmp_path / "out")


def _turning(heading: str, more: dict[str, tuple[str, ...]]) -> Tracking:
    names = ("x", "y", "v", "heading", "w")
    moves = {
        "x": "x + v*T*cos(heading)",
        "y": "y + v*T*sin(heading)",
        "v": "v",
        "heading": heading,
        "w": "w",
    }
    motion = MapMotion(components=names, next=moves, Q=(0.01, 0.01, 0.01, 1e-4, 1e-4), **more)
    return Tracking(
        target=Driven(motion=motion, initial={"v": 10.0, "heading": 3.0, "w": 0.2}),
        sensor=(
            FunctionSensor(h={"px": "x", "py": "y"}, R=25.0),
            FunctionSensor(h={"s": "sin(heading)", "c": "cos(heading)"}, R=0.04),
        ),
        start=GaussianStart(sigma=(5.0, 5.0, 1.0, 0.3, 0.05)),
        T=0.5,
        last=60,
    )


CUT = "atan2(sin(heading + w*T), cos(heading + w*T))"


@pytest.mark.parametrize(
    "tracker",
    [
        make_filter("ekf"),
        make_filter("ukf", smooth=True),
        make_filter("enkf", N=20, smooth=True),
        make_filter("pf", N=100),
        make_filter("ekf", smooth=True),
        make_filter("pf", N=50, smooth=True),
    ],
)
def test_equations_with_a_cut_are_those_without(tracker: AnyFilter) -> None:
    """Turns that are taken off change no error and no score."""
    line, cut = _turning("heading + w*T", {}), _turning(CUT, {"angles": ("heading",)})
    assert cut.angles == ("heading",)
    found = []
    for scenario in (line, cut):
        of = track(scenario, tracker, 20, predictive_metrics=("calibration", "crps"))
        truth = simulate(scenario, 1, 0, 20).truth
        error = scenario.errors(of.mean, truth)["heading"]
        found.append(
            [
                error,
                np.minimum(of.nees, 1e6),
                of.diagnostics["crps_heading"],
                of.diagnostics["pit_heading"],
            ]
        )
    for a, b in zip(*found, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-6, atol=1e-8)


@dataclass(frozen=True, kw_only=True)
class _Compass(NonlinearMotion):
    """A motion of a plugin, whose heading is cut or goes on."""

    components: ClassVar[tuple[str, ...]] = ("heading", "rate")
    angles: tuple[str, ...] = ("heading",)
    cut: bool = True

    def f(self, x: Array, k: int, T: float) -> Array:
        heading = x[0] + T * x[1]
        return np.stack([np.mod(heading, 2.0 * pi) if self.cut else heading, x[1]])

    def Q(self, T: float) -> Array:
        return np.diag([1e-4, 1e-4])


@pytest.mark.parametrize("kind", ["ekf", "ukf"])
def test_a_motion_in_python_with_a_cut(kind: str) -> None:
    found = []
    for cut in (False, True):
        scenario = Tracking(
            target=Driven(motion=_Compass(cut=cut), initial={"heading": 6.0, "rate": 0.3}),
            sensor=FunctionSensor(h={"s": "sin(heading)", "c": "cos(heading)"}, R=0.04),
            start=GaussianStart(sigma=(0.3, 0.1)),
            last=60,
        )
        assert scenario.angles == ("heading",)
        of = track(scenario, make_filter(kind, smooth=True), 20)
        error = scenario.errors(of.mean, simulate(scenario, 1, 0, 20).truth)["heading"]
        found.append([error, of.nees])
    for a, b in zip(*found, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-6, atol=1e-8)


def test_particles_on_both_sides_of_the_cut_have_their_mean_direction() -> None:
    rng = np.random.default_rng(4)
    turns = 2.0 * pi * rng.integers(-2, 3, (1, 3, 400))
    angle = rng.normal(3.1, 0.2, (1, 3, 400))
    w = np.full((3, 400), 1 / 400)
    together = particles_together(Particles(angle + turns, w), np.zeros((1, 3)), [0])
    moments, plain = together.moments(), Particles(angle, w).moments()
    np.testing.assert_allclose(near(moments.mean, plain.mean, [0]), plain.mean, rtol=1e-9)
    np.testing.assert_allclose(moments.cov, plain.cov, rtol=1e-9)


def test_a_uniform_start_of_a_heading() -> None:
    """Particles of all headings meet at the cut: the error is that of a heading elsewhere."""
    errors = []
    for truth in (pi, 0.0):
        text = {"heading": truth}
        scenario = Tracking(
            target=Driven(
                motion=MapMotion(
                    components=("heading", "rate"),
                    next={"heading": "heading + rate*T", "rate": "rate"},
                    Q=(1e-4, 1e-8),
                ),
                initial=text,
            ),
            sensor=FunctionSensor(h={"compass": "heading"}, angles=("compass",), R=0.01),
            start=GaussianStart(sigma=(2.0, 0.001)),
            last=20,
        )
        found = track(scenario, make_filter("pf", N=2000), 50)
        data = simulate(scenario, 1, 0, 50).truth
        error = scenario.errors(found.mean, data)["heading"][0, 1:]
        errors.append(np.sqrt(np.square(error).mean()))
    assert errors[0] == pytest.approx(errors[1], rel=0.2)
    assert max(errors) < 0.06


UNDECLARED = """
name: u
scenario:
  kind: tracking
  T: 1
  last: 9
  target:
    kind: driven
    motion:
      {kind: map, components: [a, NAME], next: {a: a + cos(NAME), NAME: NAME}, Q: [[1, 0], [0, 1]]ANGLES}
  sensor: {kind: function, h: {z: a}, R: 1}
  start: {kind: given, mean: [0, 0], cov: [[1, 0], [0, 1]]}
filters: {EKF: {kind: ekf}}
"""


@pytest.mark.parametrize(
    ("name", "angles", "is_noted"),
    [
        ("heading", "", True),
        ("yaw_rad", "", True),
        ("heading", ", angles: [heading]", False),
        ("yaw_rate", "", False),
        ("depth", "", False),
    ],
)
def test_a_component_with_the_name_of_an_angle_is_noted(
    tmp_path: Path, name: str, angles: str, is_noted: bool
) -> None:
    (tmp_path / "u.yaml").write_text(UNDECLARED.replace("ANGLES", angles).replace("NAME", name))
    (point,) = load(tmp_path / "u.yaml").points
    notes = [note for note in point.scenario.cautions if "angle" in note]
    assert len(notes) == is_noted
    assert all(f"write `angles: [{name}]` into the motion" in note for note in notes)


@pytest.mark.parametrize("h", ["heading", "heading + 0*rate", "-(-heading)"])
def test_a_sensor_of_an_angle_of_the_state_wraps_without_its_key(tmp_path: Path, h: str) -> None:
    """A compass that jumps from 360 to 0 deg is not off by a turn, unless it is said to count on."""
    _write(tmp_path, pi)
    named = RECORDED.replace("MORE", ", angles: [heading]")
    unnamed = named.replace(", angles: [compass]", "").replace("compass: heading", f"compass: {h}")
    errors = {}
    for key, text in {
        "named": named,
        "unnamed": unnamed,
        "counts on": named.replace("angles: [compass]", "angles: []"),
    }.items():
        errors[key] = _results(tmp_path, text).runs({})["KF", "rmse_heading"][0]
    assert errors["unnamed"] == pytest.approx(errors["named"], rel=1e-9)
    assert errors["counts on"] > 0.5


def test_a_multiple_of_an_angle_of_the_state_is_noted(tmp_path: Path) -> None:
    """A compass in degrees: trackbench wraps angles in rad alone."""
    _write(tmp_path, pi)
    degrees = RECORDED.replace("MORE", ", angles: [heading]").replace("compass: heading", "NAME")
    degrees = degrees.replace("NAME", "compass: heading*180/pi")
    for angles, is_noted in ((", angles: [compass]", True), (", angles: []", False)):
        text = degrees.replace(", angles: [compass]", "" if is_noted else angles)
        (tmp_path / "c.yaml").write_text(text)
        (point,) = load(tmp_path / "c.yaml").points
        notes = [note for note in point.scenario.cautions if "measures a multiple of an" in note]
        assert len(notes) == is_noted
        assert all("compass measures a multiple of an angle" in note for note in notes)


def test_a_recorded_truth_that_jumps_by_a_turn_is_noted(tmp_path: Path) -> None:
    angle = np.mod(0.2 * np.arange(80) + pi, 2.0 * pi) - pi
    rows = [f"{k},{cos(a):.4f},{a:.4f}" for k, a in enumerate(angle.tolist())]
    (tmp_path / "m.csv").write_text("time,z,psi\n" + "\n".join(rows) + "\n")
    keys = "measurements: m.csv, truth: m.csv, state: [psi]"
    text = f"""
name: u
scenario:
  kind: tracking
  target: {{kind: measured, {keys}}}
  sensor: {{kind: function, h: {{z: cos(psi)}}, R: 1}}
  start: {{kind: given, mean: [0], cov: [[1]]}}
  assume: {{motion: {{kind: map, components: [psi], next: {{psi: psi + 0.2*T}}, Q: 0.01}}}}
filters: {{EKF: {{kind: ekf}}}}
"""
    (tmp_path / "u.yaml").write_text(text)
    (point,) = load(tmp_path / "u.yaml").points
    notes = [note for note in point.scenario.cautions if "turn" in note]
    assert len(notes) == 1
    assert notes[0].startswith("the truth of psi jumps by a turn of 2 pi, and no key says")
    assert notes[0].endswith("write `angles: [psi]` into the target")
    (tmp_path / "u.yaml").write_text(text.replace("[psi]}\n", "[psi], angles: [psi]}\n", 1))
    (point,) = load(tmp_path / "u.yaml").points
    assert not [note for note in point.scenario.cautions if "turn" in note]


def test_numbers_with_a_long_step_are_no_angles() -> None:
    steps = np.array([0.0, 0.3, 0.6, 6.9, 7.2, 13.5])[:, None]
    assert not has_turns(steps)  # they go on, and come not back
    turning = np.array([3.0, 3.1, np.nan, -3.0, -2.9, 2.9 - 2.0 * pi])[:, None]
    assert not has_turns(turning)  # the jump is at a missing number
    assert has_turns(np.array([3.0, 3.1, -3.1, -3.0])[:, None])
