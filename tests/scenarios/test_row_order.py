"""Clocks that fall, several rows of one time, and keys without an effect on a recording."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.scenarios.test_clocks import config, table
from trackbench.config.load import load
from trackbench.errors import UserError

K = np.arange(20)
RADAR = {"kind": "range-azimuth", "sigma_range": 50, "sigma_azimuth_mrad": 3}


def write(folder: Path, times: Any, **changes: Any) -> Path:
    (folder / "m.csv").write_text(table("time,x,y", times, 3.0 * K, 0.5 * K))
    return config(folder, {"measurements": "m.csv"} | changes.pop("target", {}), **changes)


def one_mistake(path: Path) -> str:
    with pytest.raises(UserError) as caught:
        load(path)
    (line,) = str(caught.value).splitlines()
    return line


@pytest.mark.parametrize(
    ("times", "expected"),
    [
        ((86390.0 + K) % 86400.0, "m.csv:12:1: scenario: time falls by 86399 s, where rows"),
        (np.where(K < 7, K, K - 11.5), "m.csv:9:1: scenario: time falls by 10.5 s"),
        (K[::-1], "m.csv:21:1: scenario: time falls by 19 s"),
        # Rows every four hours, from six o'clock on: ten usual intervals are longer than a day.
        ((21600.0 + 14400.0 * K) % 86400.0, "m.csv:7:1: scenario: time falls by 72000 s"),
    ],
)
def test_a_clock_that_falls_is_a_mistake(tmp_path: Path, times: Any, expected: str) -> None:
    line = one_mistake(write(tmp_path, times))
    assert expected in line
    assert "rows come after later ones" in line
    assert ("did the clock pass midnight?" in line) == (times.max() > 43200.0)


def test_late_rows_are_counted(tmp_path: Path) -> None:
    times = np.where((K > 5) & (K < 10), K - 4.5, K + 0.0)
    (note,) = load(write(tmp_path, times)).points[0].scenario.cautions
    assert note == (
        "4 rows that came after later ones were put in order; the largest fall is 3.5 s, at m.csv:8: if "
        "a clock was set back there, correct it"
    )


def test_a_clock_that_was_set_back_a_little_is_named_beside_equal_times(tmp_path: Path) -> None:
    """The rows after it have the times of rows before it, which `same_time` would mix."""
    line = one_mistake(write(tmp_path, np.where(K < 10, K, K - 3)))
    assert (
        "time 7 s is there twice, as are 2 more, and not with the same values: 2 rows that" in line
    )
    assert "the largest fall is 2 s, at m.csv:12: if a clock was set back there, correct it" in line
    assert "; or say `same_time: mean`" in line


@pytest.mark.parametrize(
    ("way", "x", "apart"),
    [
        ("mean", 3.0 * (2.0 * np.arange(1, 10) + 0.5), 1.0),
        ("last", 3.0 * (2.0 * np.arange(1, 10) + 1.0), 1.0),
        ("spread", 3.0 * K[1:], 0.5),
    ],
)
def test_several_rows_of_one_time(tmp_path: Path, way: str, x: Any, apart: float) -> None:
    line = one_mistake(write(tmp_path, K // 2))
    assert "time 0 s is there twice, as are 9 more, and not with the same values" in line
    assert "`same_time: mean`, `last` or `spread`" in line
    scenario = load(write(tmp_path, K // 2, target={"same_time": way})).points[0].scenario
    np.testing.assert_allclose(scenario.target._recording.measurements[0, :, 0], x)
    np.testing.assert_allclose(np.diff(scenario.times), apart)


def test_the_mean_of_angles_is_on_their_arc(tmp_path: Path) -> None:
    azimuth = [0.1, 0.2, np.pi - 0.1, 0.3 - np.pi]
    (tmp_path / "m.csv").write_text(
        table("time,range,azimuth", [0, 1, 2, 2], [9, 9, 9, 9], azimuth)
    )
    target = {"measurements": "m.csv", "same_time": "mean"}
    path = config(tmp_path, target, sensor=RADAR, filters={"EKF": {"kind": "ekf"}})
    mean = load(path).points[0].scenario.target._recording.measurements[1, -1, 0]
    assert mean == pytest.approx(np.pi + 0.1)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("bias", [100, 0]),
        ("outliers", {"share": 0.1}),
        ("detection", 0.5),
        ("period", 2),
        ("offset", 1),
    ],
)
def test_what_no_filter_models_is_not_assumed(tmp_path: Path, key: str, value: Any) -> None:
    (tmp_path / "m.csv").write_text(table("time,range,azimuth", K, 9.0 + K, 0.1 + 0.0 * K))
    assume = {"motion": {"kind": "cwna", "q": 1}, "sensor": RADAR | {key: value}}
    ekf: dict[str, Any] = {"kind": "ekf"}
    for changes in (
        {"assume": assume, "filters": {"EKF": ekf}},
        {"filters": {"EKF": ekf | {"assume": assume}}},
    ):
        line = one_mistake(config(tmp_path, {"measurements": "m.csv"}, sensor=RADAR, **changes))
        assert f"assume.sensor.{key}: has no effect: no filter models it" in line


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        ("hold_out: 1000", "hold_out: holds out none of 19 measurements: give a number from 2"),
        ("until: {rms(rmse): '1_0 %'}", "give a number greater than 0, or a share of the value"),
        ("matters: 'nan%'", "give a number greater than 0, or a share of the value"),
    ],
)
def test_a_number_out_of_place_is_refused(tmp_path: Path, keys: str, expected: str) -> None:
    path = write(tmp_path, K)
    path.write_text(f"{path.read_text()}{keys}\n")
    assert expected in one_mistake(path)


def test_negative_speeds_are_refused(tmp_path: Path) -> None:
    (tmp_path / "m.csv").write_text(
        table("time,x,y,speed,course", K, K, K, np.where(K == 3, -2, 1), 90 + 0 * K)
    )
    sensor = [{"kind": "position", "sigma": 5}, {"kind": "velocity", "sigma": 1}]
    line = one_mistake(config(tmp_path, {"measurements": "m.csv"}, sensor=sensor))
    assert "m.csv:5:1: scenario: speed: -2 m/s is impossible; a speed is at least 0 m/s" in line


def test_the_mean_of_true_headings_is_on_their_arc(tmp_path: Path) -> None:
    """359 and 3 deg at one time are 1 deg, as of measured angles."""
    (tmp_path / "m.csv").write_text(table("time,z", [0, 1, 2], [0.1, 0.1, 0.1]))
    rows = table("time,heading", [0, 1, 1, 2], np.deg2rad([350.0, 359.0, 3.0, 4.0]))
    (tmp_path / "t.csv").write_text(rows)
    (tmp_path / "c.yaml").write_text(
        """
name: compass
seed: 1
scenario:
  kind: tracking
  target: {kind: measured, measurements: m.csv, truth: t.csv, state: [heading], angles: [heading],
    axes: 0, same_time: mean}
  sensor: {kind: function, h: {z: heading}, R: 0.01}
  start: {kind: given, mean: [0], sigma: [1]}
  assume:
    motion: {kind: map, components: [heading], angles: [heading], next: {heading: heading}, Q: 0.01}
filters: {EKF: {kind: ekf}}
"""
    )
    truth = load(tmp_path / "c.yaml").points[0].scenario.target.recorded_truth[0, 1:, 0]
    difference = np.rad2deg(truth) - [350.0, 1.0, 4.0]
    assert (difference + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=1e-9)
