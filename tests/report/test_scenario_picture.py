"""The picture of a scenario before it is run: `check --picture`."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.commands import trackbench
from trackbench.config.load import load
from trackbench.report.figures.scenario_picture import _draw_scene_over_time, draw_scene

RADAR = """name: c
scenario:
  kind: tracking
  last: 60
  target: {kind: legs, launch: {x: 900, vx: 3, vy: 4}, legs: [{start: 20, end: 30, turn_rate_deg_s: 9}]}
  sensor: {kind: range-azimuth, sigma_range: 1, sigma_azimuth_mrad: 1, at: [50, 10]}
  start: {kind: two-scan}
filters: {E: {kind: ekf, assume: {motion: {kind: cv, q: 0.1}}}}
"""
SERIES = """name: c
scenario:
  kind: tracking
  last: 20
  target: {kind: driven, motion: sine-gamma}
  sensor: square-then-line
  start: known
filters: {P: {kind: pf}}
"""


def config(folder: Path, text: str) -> Path:
    (folder / "c.yaml").write_text(text)
    return folder / "c.yaml"


def lines(ax: Any) -> dict[str, np.ndarray]:
    return {line.get_label(): np.array(line.get_data()) for line in ax.get_lines()}


def test_the_plane_shows_path_sensor_measurements_and_speed(tmp_path: Path) -> None:
    plane, speed = draw_scene(load(config(tmp_path, RADAR))).axes
    drawn = lines(plane)
    assert drawn["Sensor"][:, 0].tolist() == [50.0, 10.0]
    error = drawn["Measurements, first run"] - drawn["Truth"][:, 1:]
    assert np.abs(error).max() < 20.0
    assert plane.get_xlabel() == "x (m)"
    np.testing.assert_allclose(speed.get_lines()[0].get_ydata(), 5.0)


def test_a_long_track_is_in_kilometres(tmp_path: Path) -> None:
    far = load(config(tmp_path, RADAR), ["scenario.target.launch.vx=60"])
    plane, _ = draw_scene(far).axes
    assert plane.get_xlabel() == "x (km)"
    assert lines(plane)["Sensor"][:, 0].tolist() == [0.05, 0.01]


def test_other_states_are_drawn_over_time(tmp_path: Path) -> None:
    state, seen = draw_scene(load(config(tmp_path, SERIES))).axes
    assert len(lines(state)["Truth, first run"][0]) == 21
    assert len(lines(seen)["Measurements, first run"][0]) == 20


def test_the_command_writes_the_picture(tmp_path: Path) -> None:
    path = config(tmp_path, RADAR)
    done = trackbench("check", path, "--picture", tmp_path / "scene.png")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "scene.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("name", ["scene.txt", "no/scene.png"])
def test_a_picture_that_cannot_be_written_is_one_line(name: str, tmp_path: Path) -> None:
    done = trackbench("check", config(tmp_path, RADAR), "--picture", tmp_path / name)
    assert done.returncode in (1, 2)
    assert "Traceback" not in done.stderr
    assert not (tmp_path / name).exists()


def test_many_measured_components_are_six_rows_of_usual_height() -> None:
    scenario: Any = SimpleNamespace(
        components=("a",),
        true_sensor=SimpleNamespace(components=tuple("bcdefghij")),
        times=np.arange(4.0),
    )
    figure = _draw_scene_over_time(scenario, np.zeros((1, 4, 2)), np.zeros((9, 3, 2)))
    assert len(figure.axes) == 7
    assert figure.get_figheight() == pytest.approx(7 * 1.1)
