"""Process noise of a written config: that of the usual speed, or what the recording's maneuvers need."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from tests.conftest import EXPERIMENTS, ROOT
from trackbench import api
from trackbench.new_experiment_from_tables import write_config_for
from trackbench.scenarios.recordings.guess_process_noise import usual_process_noise
from trackbench.scenarios.recordings.guess_record import Guess
from trackbench.scenarios.recordings.guess_table import recognized
from trackbench.scenarios.recordings.naming_of_columns import Naming
from trackbench.scenarios.recordings.new_config_filters import LEAST_OUTLIERS

SIGMA = 2.0


def path_of(turn_rate: float, rows: int = 600, seed: int = 4) -> tuple[np.ndarray, ...]:
    """Times and true positions of a target with 15 m/s that turns to and fro every 20 s."""
    time = np.arange(float(rows))
    sign = np.where((time // 20).astype(int) % 2 == 0, 1.0, -1.0)
    heading = np.cumsum(sign * turn_rate)
    return time, np.cumsum(15.0 * np.cos(heading)), np.cumsum(15.0 * np.sin(heading))


def write(path: Path, turn_rate: float, outliers: int = 0, rows: int = 600) -> Path:
    """Write measured positions, of which every ``outliers``-th one is 100 m off."""
    time, x, y = path_of(turn_rate, rows)
    noise = np.random.default_rng(2).normal(size=(2, rows)) * SIGMA
    if outliers:
        noise[:, ::outliers] += 100.0
    lines = [
        f"{t:g},{a:.2f},{b:.2f}" for t, a, b in zip(time, x + noise[0], y + noise[1], strict=True)
    ]
    path.write_text("\n".join(["time,x,y", *lines]) + "\n")
    return path


def guess_at(path: Path) -> Guess:
    return recognized(str(path))


def test_a_steady_target_has_the_process_noise_of_its_speed(tmp_path: Path) -> None:
    guess = guess_at(write(tmp_path / "m.csv", turn_rate=0.0))
    assert guess.process_noise == 0.0


@pytest.mark.parametrize("name", ["solent-ais", "car-measurements"])
def test_shipped_recordings_have_the_process_noise_of_their_speed(name: str) -> None:
    assert guess_at(EXPERIMENTS / "data" / f"{name}.csv").process_noise == 0.0


def test_maneuvers_raise_it_and_outliers_do_not(tmp_path: Path) -> None:
    turning = guess_at(write(tmp_path / "m.csv", turn_rate=0.12))
    assert turning.process_noise >= 10.0 * usual_process_noise(turning.speed)
    with_outliers = guess_at(write(tmp_path / "n.csv", turn_rate=0.12, outliers=97))
    assert with_outliers.outliers > 0.005
    ratio = with_outliers.process_noise / turning.process_noise
    assert 0.5 <= ratio <= 2.0
    steady = guess_at(write(tmp_path / "s.csv", turn_rate=0.0, outliers=97))
    assert steady.process_noise == 0.0


@pytest.mark.parametrize(("outliers", "is_written"), [(0, False), (400, False), (97, True)])
def test_a_gated_and_a_robust_filter_are_written_for_the_share_that_the_page_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, outliers: int, is_written: bool
) -> None:
    """Of 600 rows one is 0.17 %, and six are 1 %; the page says 0.5 %."""
    monkeypatch.chdir(tmp_path)
    table = write(tmp_path / "m.csv", turn_rate=0.0, outliers=outliers)
    text = write_config_for(table, "g", tmp_path).paths[0].read_text()
    assert ("KF with gate: " in text) == is_written
    assert ("KF with Student t: " in text) == is_written
    page = " ".join((ROOT / "docs" / "your-data.md").read_text(encoding="utf-8").split())
    share = f"at least {100 * LEAST_OUTLIERS:g} % of the rows lie far from the line"
    assert share in page


def test_a_kalman_filter_with_it_is_consistent(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The mean squared innovation of the written Kalman filter is about 1, and was above 3."""
    monkeypatch.chdir(tmp_path)
    table = write(tmp_path / "m.csv", turn_rate=0.12)
    usual = usual_process_noise(guess_at(table).speed)
    config = write_config_for(table, "g", tmp_path).paths[0]
    text = config.read_text()
    reason = "guess: squared innovations are about 1 over the recording; for straight motion try"
    assert f"{reason} {usual:g}\n" in text
    content = yaml.safe_load(text)
    content.pop("hold_out")
    content["tables"] = {}
    content["figures"] = {}
    motion = {"kind": "cwna", "q": usual}
    content["filters"] = {
        "KF": {"kind": "kf"},
        "usual": {"kind": "kf", "assume": {"motion": motion}},
    }
    config.write_text(yaml.safe_dump(content))
    report = api.run(config, out=tmp_path / "out", workers=1, quiet=True, formats=())
    anis = report.results.summary.set_index(["filter", "metric"])["value"]
    assert 0.8 < anis["KF", "mean(anis)"] < 1.3
    assert anis["usual", "mean(anis)"] > 3.0


@pytest.mark.parametrize(("speed", "interval"), [(0.14, 600.0), (0.5, 3600.0), (3e-7, 5.0)])
def test_a_slow_target_has_one_by_which_it_is_smoothed(
    tmp_path: Path, speed: float, interval: float
) -> None:
    """The usual process noise lets such targets turn within a step."""
    time = interval * np.arange(100.0)
    sigma = 0.2 * speed * interval
    noise = np.random.default_rng(6).normal(size=(2, 100)) * sigma
    rows = zip(time, speed * time + noise[0], noise[1], strict=True)
    (tmp_path / "m.csv").write_text(
        "time,x,y\n" + "".join(f"{t:g},{x:.15f},{y:.15f}\n" for t, x, y in rows)
    )
    guess = recognized(str(tmp_path / "m.csv"), Naming(units={"x": "m", "y": "m"}))
    assert 0.0 < guess.process_noise < 0.01 * usual_process_noise(guess.speed)
    config = write_config_for(
        tmp_path / "m.csv", "g", tmp_path, changes=["units.x=m", "units.y=m"]
    ).paths[0]
    assert f"q: {guess.process_noise:g}}}" in config.read_text()
    assert "squared innovations are far below 1 over the recording" in config.read_text()
    content = yaml.safe_load(config.read_text())
    motion = {"kind": "cwna", "q": usual_process_noise(guess.speed)}
    content["filters"] = {
        "KF": {"kind": "kf"},
        "usual": {"kind": "kf", "assume": {"motion": motion}},
    }
    for key in ("hold_out", "tables", "figures"):
        content.pop(key)
    config.write_text(yaml.safe_dump(content))
    report = api.run(config, out=tmp_path / "out", workers=1, quiet=True, formats=())
    anis = report.results.summary.set_index(["filter", "metric"])["value"]
    # A guessed sigma has one digit, so that its variance may be twice the true one.
    assert anis["usual", "mean(anis)"] < 0.3
    assert 0.4 < anis["KF", "mean(anis)"] < 1.3


def test_a_long_recording_is_filtered_in_parts(tmp_path: Path) -> None:
    """Evenly spaced parts of 30 000 rows give about the process noise of 600 rows."""
    short = guess_at(write(tmp_path / "m.csv", turn_rate=0.12))
    long = guess_at(write(tmp_path / "n.csv", turn_rate=0.12, rows=30_000))
    assert 0.4 <= long.process_noise / short.process_noise <= 2.5


def test_a_slow_target_that_wanders_keeps_the_process_noise_of_its_wandering(
    tmp_path: Path,
) -> None:
    """The least process noise would not follow it, and the usual one would not smooth it."""
    rng = np.random.default_rng(7)
    interval = 600.0
    q = 1e-8
    velocity = 0.1 + np.cumsum(rng.normal(size=(2, 300)) * np.sqrt(q * interval), axis=1)
    places = np.cumsum(velocity * interval, axis=1) + 5.0 * rng.normal(size=(2, 300))
    rows = [f"{interval * k:g},{x:.2f},{y:.2f}" for k, (x, y) in enumerate(places.T)]
    (tmp_path / "m.csv").write_text("\n".join(["time,x,y", *rows]) + "\n")
    guess = recognized(str(tmp_path / "m.csv"), Naming(units={"x": "m", "y": "m"}))
    assert 0.1 * q <= guess.process_noise <= 10.0 * q
