"""A target, sensor or start of one's own that is wrong: said in a line with its file and line."""

import sys
from pathlib import Path
from typing import Generic

import pytest

from tests.commands import trackbench
from tests.conftest import make_filter
from trackbench.cli import main
from trackbench.config import requested_metrics
from trackbench.plugins.errors import location_of

HEAD = """
from dataclasses import dataclass
import numpy as np
from trackbench.core.distributions import Gaussian
from trackbench.models.motions.kinematic import ConstantVelocity
from trackbench.models.sensors.position import PositionSensor as Position
from trackbench.registry import register
from trackbench.scenarios.starts.without_scans import GaussianStart
from trackbench.scenarios.targets.driven import Driven
"""
BASES = {
    "motions": "ConstantVelocity",
    "targets": "Driven",
    "sensors": "Position",
    "starts": "GaussianStart",
}
CONFIG = """name: own
runs: 6
plugins: [mine.py]
scenario:
  kind: tracking
  last: 8
  target: {kind: TARGETS, motion: {kind: cv, q: 1}, launch: {x: 10, vx: 1}}
  sensor: {kind: SENSORS, sigma: 2}
  start: {kind: STARTS, sigma: [2, 1, 2, 1]}
  score: {lost_sigmas: 10}
filters:
  KF: {kind: ekf}
tables:
  errors: {kind: metrics, columns: {RMSE: rms(rmse_position)}}
"""
DIVIDED = "ZeroDivisionError: division by zero"
BAD = {
    "start raises": ("targets", "def start(self, timeline)", "1 / 0", DIVIDED),
    "fly raises": (
        "targets", "def fly(self, start, timeline, sensor, rng, scans)", "1 / 0", DIVIDED),
    "fly leaves": (
        "targets", "def fly(self, start, timeline, sensor, rng, scans)", "raise SystemExit",
        "raised SystemExit()"),
    "start gives too few": (
        "targets", "def start(self, timeline)", "return super().start(timeline)[:3]", ""),
    "windows raises": ("targets", "def windows(self, times, scored)", "1 / 0", DIVIDED),
    "a window too long": (
        "targets", "def windows(self, times, scored)", "return {'late': np.ones(40, dtype=bool)}",
        "the window 'late' is an array (40,) of bool, not an array (9,) of bool"),
    "a window of numbers": (
        "targets", "def windows(self, times, scored)", "return {'late': [1, 2]}",
        "the window 'late' is a list, not an array (9,) of bool"),
    "run_metrics raises": ("targets", "def run_metrics(self, values, scored)", "1 / 0", DIVIDED),
    "a metric of one number": (
        "targets", "def run_metrics(self, values, scored)", "return {'late_s': 3.0}",
        "metric 'late_s' is a float, not an array (2,) of real numbers"),
    "a metric that would be broadcast": (
        "targets", "def run_metrics(self, values, scored)", "return {'late_s': np.ones(1)}",
        "metric 'late_s' is an array (1,) of float64, not an array (2,) of real numbers"),
    "a metric that is not real": (
        "targets", "def run_metrics(self, values, scored)", "return {'late_s': np.ones(2) + 0j}",
        "metric 'late_s' is an array (2,) of complex128, not an array (2,) of real numbers"),
    "no metrics": (
        "targets", "def run_metrics(self, values, scored)", "return None",
        "TypeError: unsupported operand"),
    "a metric without a name": (
        "targets", "def run_metrics(self, values, scored)", "return {3: np.ones(2)}",
        "the name of a metric is 3, no word"),
    "a metric called an expression": (
        "targets", "def run_metrics(self, values, scored)", "return {'late(s)': np.ones(2)}",
        "a metric cannot be named 'late(s)': use letters"),
    "a metric called as errors are": (
        "targets", "def run_metrics(self, values, scored)", "return {'rmse_position': np.ones(2)}",
        "'rmse_position' is a metric of every scenario: rename it"),
    "axes raises": ("targets", "@property\n    def axes(self)", "1 / 0", DIVIDED),
    "spans raises": ("targets", "@property\n    def spans(self)", "1 / 0", DIVIDED),
    "measurement raises": ("sensors", "def measurement(self, x, k)", "1 / 0", DIVIDED),
    "measurement is nothing": (
        "sensors", "def measurement(self, x, k)", "return None",
        "measurement gives a NoneType, not a Gaussian"),
    "a covariance too large": (
        "sensors", "def measurement(self, x, k)", "return Gaussian(x[0::2], np.eye(3))",
        "its covariance is an array (3, 3) of float64, not an array (2, 2)"),
    "information raises": (
        "sensors", "def information(self, x, k, certain=False)", "1 / 0", DIVIDED),
    "prior raises": ("starts", "def prior(self, opening, sensor, nominal, rng)", "1 / 0", DIVIDED),
    "a prior of another shape": (
        "starts", "def prior(self, opening, sensor, nominal, rng)",
        "return Gaussian(opening.truth, np.eye(3))",
        "the prior's covariance is an array (3, 3) of float64, not an array (4, 4)"),
    "check raises": ("starts", "def check(self, components, sensor)", "1 / 0", DIVIDED),
}  # fmt: skip


def write(folder: Path, group: str, method: str) -> None:
    """A config with one part of one's own."""
    kinds = {"TARGETS": "driven", "SENSORS": "position", "STARTS": "gaussian"}
    config = CONFIG
    for word, kind in (kinds | {group.upper(): "mine"}).items():
        config = config.replace(word, kind)
    (folder / "c.yaml").write_text(config)
    head = f'@register("{group}", "mine")\n@dataclass(frozen=True, kw_only=True)\n'
    body = f"class Mine({BASES[group]}):\n    'Mine.'\n{method}"
    (folder / "mine.py").write_text(HEAD + head + body)


@pytest.mark.parametrize("command", ["check", "run", "list"])
@pytest.mark.parametrize("what", BAD)
def test_it_is_said(what: str, command: str, tmp_path: Path) -> None:
    group, head, body, said = BAD[what]
    write(tmp_path, group, f"\n    {head}:\n        {body}\n")
    words = ["list", "metrics"] if command == "list" else [command]
    done = trackbench(*words, "c.yaml", "--allow-plugins", cwd=tmp_path)
    (line,) = done.stderr.splitlines()
    assert done.returncode == 2
    assert line.startswith("c.yaml:")
    assert "mine.py:" in line
    assert said in line
    place = int(line.partition("mine.py:")[2].partition(":")[0])
    named = (tmp_path / "mine.py").read_text().splitlines()[place - 1]
    assert any(word in named for word in (body, head.rpartition("\n")[2].strip(), "@register"))
    assert not (tmp_path / "results").exists()


@pytest.mark.parametrize("body", ["1 / 0", "return None"])
def test_a_motion_that_is_assumed(body: str, tmp_path: Path) -> None:
    write(tmp_path, "motions", f"\n    def sampled(self, T, axes=2):\n        {body}\n")
    config = (tmp_path / "c.yaml").read_text()
    assumed = "{kind: ekf, assume: {motion: {kind: mine, q: 1}}}"
    (tmp_path / "c.yaml").write_text(config.replace("{kind: ekf}", assumed))
    done = trackbench("check", "c.yaml", "--allow-plugins", cwd=tmp_path)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert line.startswith("c.yaml:12:27: filters.KF.assume: mine.py:")


WHOLE = {
    "windows": ('"": self.steps > 0', '"": self.steps[1:] > 0', "the window '' is an array (40,)"),
    "times": ("self.steps * self.interval", "[1, 2]", "times is a list, not an array (41,)"),
    "errors": ("error[[0, 2]]", "error[[0, 2]][:, :1]", "the error 'position' is an array (2, 1, 2)"),
    "simulate": ("Simulation(truth, ", "Simulation(truth.T, ", "the truth is an array (2, 41, 4)"),
}  # fmt: skip


@pytest.mark.parametrize("method", WHOLE)
def test_a_scenario_of_ones_own(method: str, tmp_path: Path) -> None:
    sys.modules.pop("own_radar", None)  # of the test before
    made = trackbench("new", "scenario", "own-radar", cwd=tmp_path)
    good, bad, said = WHOLE[method]
    assert made.returncode == 0, made.stderr
    text = (tmp_path / "own_radar.py").read_text()
    (tmp_path / "own_radar.py").write_text(text.replace(good, bad))
    done = trackbench("check", "own_radar.yaml", "--allow-plugins", cwd=tmp_path)
    (line,) = done.stderr.splitlines()
    assert done.returncode == 2
    assert said in line
    place = int(line.partition("own_radar.py:")[2].partition(":")[0])
    rows = text.splitlines()[place - 1 : place + 1]  # of a property the decorator
    assert any(f"def {method}(" in row for row in rows)


def test_pythons_own_files_are_nobodys() -> None:
    """Every filter is a `Generic`, whose file is none of a plugin's."""
    assert location_of(_raised_in_typing(), make_filter("pf", N=5)) == ""


def _raised_in_typing() -> TypeError:
    with pytest.raises(TypeError) as caught:
        Generic[int]
    return caught.value


def test_a_good_one_runs(tmp_path: Path) -> None:
    write(tmp_path, "targets", "")
    assert trackbench("run", "c.yaml", "--allow-plugins", cwd=tmp_path).returncode == 0


def test_what_is_found_only_in_the_run_is_a_line(tmp_path: Path) -> None:
    """Here in the sixth run; a scenario is asked for two."""
    body = "        assert max(rng.runs) < 5\n"
    rest = "        return super().fly(start, timeline, sensor, rng, scans)\n"
    fly = "\n    def fly(self, start, timeline, sensor, rng, scans):\n"
    write(tmp_path, "targets", fly + body + rest)
    done = trackbench("run", "c.yaml", "--allow-plugins", cwd=tmp_path)
    assert done.returncode == 1
    assert "error: KF failed: mine.py:16: AssertionError" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_bug_of_our_own_stays_a_traceback(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(tmp_path, "targets", "")
    monkeypatch.setattr(requested_metrics, "requests_of", lambda parts: 1 / 0)
    monkeypatch.setattr("sys.argv", ["trackbench", "check", "c.yaml", "--allow-plugins"])
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ZeroDivisionError):
        main()
