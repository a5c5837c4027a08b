"""Tables as people's programs write them (tables/): a config that reads them right, or what to write.

The target is at x = 20 t, y = 0.1 t^2 - 10 t in meters, from 47 N 8.5 E on, t in seconds.
"""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from tests.commands import trackbench
from trackbench.config.load import load

TABLES = Path(__file__).parent / "tables"
EXPECTED: dict[str, Any] = yaml.safe_load((TABLES / "expected.yaml").read_text())
PLACES = {"A1": (0, 0), "A2": (1500, 100), "A3": (300, -1200)}
NAMES = re.compile(r"[XY]_(\w+)")


def new(folder: Path, name: str, *options: str) -> Any:
    (folder / name).write_bytes((TABLES / name).read_bytes())
    return trackbench("new", "experiment", "m", "--from", name, *options, cwd=folder)


def filled(text: str) -> str:
    """Return a config with the anchors' places, and the target's first one."""
    anchors = [*PLACES]
    for name, number in re.findall(r"X_((\d)|\w+)", text):
        x, y = PLACES.get(anchors[int(number) - 1] if number else name, (0, 0))
        text = text.replace(f"X_{name}, Y_{name}", f"{x}, {y}")
    return text.replace("[X, 0, Y, 0]", "[0, 0, 0, 0]")


def test_each_table_has_its_line() -> None:
    assert {path.name for path in TABLES.iterdir()} == {*EXPECTED, "expected.yaml"}


@pytest.mark.parametrize("name", EXPECTED)
def test_a_table(tmp_path: Path, name: str) -> None:
    expected = EXPECTED[name]
    made = new(tmp_path, name)
    if isinstance(expected, str):
        assert (made.returncode, made.stderr) == (2, f"{name}:{expected}\n")
        return
    assert made.returncode == 0, made.stderr
    text = filled((tmp_path / "m.yaml").read_text())
    (tmp_path / "m.yaml").write_text(text)
    scenario = yaml.safe_load(text)["scenario"]
    target = {k: v for k, v in scenario["target"].items() if k not in ("kind", "measurements")}
    assert target == expected["target"]
    assert [sensor["kind"] for sensor in scenario["sensor"]] == expected["sensors"]
    check_positions(tmp_path / "m.yaml", expected)


@pytest.mark.parametrize(
    ("name", "option", "every"),
    [
        ("ambiguous_days.csv", 'time_format="%d/%m/%Y"', 86400.0),
        ("ambiguous_days.csv", 'time_format="%m/%d/%Y"', 86400.0 * 334 / 11),
        ("nohead_latlon.csv", "format.names=[time, latitude, longitude]", 1.0),
        ("other_day_clock.csv", "columns.date=flown", 1.0),
        ("samesec.csv", "same_time=mean", 1.0),
        ("piraeus.csv", 'columns.run=""', 1.0),
        ("radar.csv", "clockwise=[azimuth]", 1.0),
        ("swapped.csv", 'columns.vx=""', 1.0),
    ],
)
def test_what_it_asks_is_answered(tmp_path: Path, name: str, option: str, every: float) -> None:
    made = new(tmp_path, name, "--set", option)
    assert made.returncode == 0, made.stderr
    times = load(tmp_path / "m.yaml").points[0].scenario.times
    np.testing.assert_allclose(np.diff(times).mean(), every)


def test_a_truth_has_a_format_of_its_own(tmp_path: Path) -> None:
    assert new(tmp_path, "french_xy.csv").returncode == 0
    rows = [f"{k},{20 * k},{0.1 * k * k - 10 * k}" for k in range(14)]
    (tmp_path / "truth.csv").write_text("\n".join(["Temps (s),X (m),Y (m)", *rows]) + "\n")
    text = (tmp_path / "m.yaml").read_text()
    (tmp_path / "m.yaml").write_text(
        text.replace("    format:", "    truth: truth.csv\n    format:")
    )
    scenario: Any = load(tmp_path / "m.yaml").points[0].scenario
    recording = scenario.target._recording
    np.testing.assert_allclose(recording.truth[[0, 2], 1:], recording.measurements, atol=1e-3)


@pytest.mark.parametrize(
    ("option", "expected"),
    [
        ("format.separator=ab", "format.separator: is one character, `tab` or `space`"),
        ("format.encoding=utf-88", "format.encoding: is no encoding that Python knows"),
        ("format={header: 1, names: [a]}", "format.names: names replace the line of the header: "),
        ("column.x=a", "column: unknown key; did you mean columns?"),
    ],
)
def test_mistaken_options(tmp_path: Path, option: str, expected: str) -> None:
    made = new(tmp_path, "tum.txt", "--set", option)
    assert made.returncode == 2
    assert made.stderr.startswith(f"--set {option}: {expected}"), made.stderr


@pytest.mark.parametrize(
    ("option", "owner"),
    [("runs=[5]", "the target"), ("resample=3", "the target"), ("at=[0,0]", "a sensor")],
)
def test_options_that_are_keys_of_the_written_config(
    tmp_path: Path, option: str, owner: str
) -> None:
    made = new(tmp_path, "tum.txt", "--set", option)
    assert made.returncode == 2
    key = option.partition("=")[0]
    way = "write it into the config when this command has written it"
    assert f"{key}: is a key of {owner}: {way}" in made.stderr
    assert ("Guesses are those of the longest run" in made.stderr) == (key == "runs")


def check_positions(path: Path, expected: dict[str, Any]) -> None:
    """Compare measurements with the formulas of the path."""
    scenario: Any = load(path).points[0].scenario
    recording = scenario.target._recording
    z = np.concatenate([recording.scans, recording.measurements], axis=1)[..., 0]
    times, kind = scenario.times[-z.shape[1] :], expected["sensors"][0]
    # A second is a row; three anchors of one table take turns within it.
    several = "sensors" in expected["target"]
    t = np.floor(times - times[0] + 0.01) if several else np.arange(float(len(times)))
    if kind != "range":
        np.testing.assert_allclose(np.diff(times).mean(), expected.get("every", 1.0), rtol=1e-4)
    t[expected.get("empty", [])] = np.nan
    x, y = 20.0 * t, 0.1 * t * t - 10.0 * t
    if kind == "range":
        for row, (px, py) in zip(z, PLACES.values(), strict=True):
            away = np.hypot(x - px, y - py)
            np.testing.assert_allclose(row, np.where(np.isnan(row), np.nan, away), atol=0.01)
        return
    if kind == "range-azimuth":
        z = np.stack([z[0] * np.cos(z[1]) - 9000.0, z[0] * np.sin(z[1])])
    np.testing.assert_allclose(z[0] - z[0, 0], x, atol=0.4)
    np.testing.assert_allclose(z[1] - z[1, 0], y, atol=0.4)
    if "velocity" in expected["sensors"]:
        v = np.stack([np.full_like(x, 20.0), 0.2 * t - 10.0])
        np.testing.assert_allclose(z[-2:, 1:], v[:, 1:], atol=0.6)  # the first row is the start
