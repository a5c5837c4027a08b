"""The page on recordings says what its commands give, and how a plane shortens what is far away."""

import re
from pathlib import Path

import numpy as np
import pytest
import yaml

from docs.site.blocks import blocks
from tests.commands import trackbench
from tests.conftest import ROOT
from trackbench import api
from trackbench.core.arrays import Array
from trackbench.core.latitude_longitude import Geodetic, earth_centered, east_north_up
from trackbench.report.findings.ranking import rankings

PAGE = (ROOT / "docs" / "your-data.md").read_text(encoding="utf-8")


def test_the_scores_are_those_of_the_written_config(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "experiments").symlink_to(ROOT / "experiments")
    trackbench("new", "experiment", "--from", "experiments/data/solent-ais.csv", cwd=tmp_path)
    # The grid over its runs is a comment.
    (line,) = re.findall(r"^# (grid: .*?)  #", Path("solent_ais.yaml").read_text(), re.MULTILINE)
    assert f"\n{line}\n" in PAGE
    report = api.run("solent_ais.yaml", engine="serial", quiet=True, formats=())
    (ranking,) = rankings(report.results)
    assert ranking.metric.metric == "log_score"
    scores = {c.label: c.overall.value for c in ranking.order}
    assert {*scores} == {"KF", "IMM", "RPF"}
    page = " ".join(PAGE.split())
    assert f"The IMM is best, with {scores['IMM']:.1f}" in page
    assert f"The Kalman filter is {scores['IMM'] - scores['KF']:.1f} lower" in page
    assert f"The particle filter has {scores['RPF']:.0f}" in page


def test_the_plane_shortens_speeds_and_distances_as_the_table_says() -> None:
    # A target flies north from 50 degrees of latitude, 1 m a step.
    latitude = np.deg2rad(np.linspace(50.0, 60.0, 1_200_000))
    path = _on_the_ground(latitude)
    step = np.linalg.norm(np.diff(earth_centered(path)), axis=0)
    distance = np.insert(np.cumsum(step), 0, 0.0)
    origin = Geodetic(latitude[0], np.array(0.0), np.array(0.0))
    north = east_north_up(path, origin)[1]
    for kilometers in (50, 300, 1000):
        i = np.searchsorted(distance, 1e3 * kilometers)
        speed = 100.0 * (1.0 - (north[i + 1] - north[i]) / step[i])
        way = 100.0 * (1.0 - north[i] / distance[i])
        assert f"| {kilometers} km | {_rounded(speed)} % | {_rounded(way)} % |" in PAGE


def test_a_slant_range_is_longer_as_the_page_says() -> None:
    longer = 100.0 * (1.0 / np.cos(np.deg2rad(10.0)) - 1.0)
    assert f"At an elevation of 10 degrees it is {longer:.1f} % longer" in PAGE


def _on_the_ground(latitude: Array) -> Geodetic:
    return Geodetic(latitude, np.zeros_like(latitude), np.zeros_like(latitude))


def _rounded(percent: float) -> str:
    """Return two digits from 1 % on, else one."""
    return f"{percent:.2g}" if percent >= 1.0 else f"{percent:.1g}"


def _write_drive(folder: Path) -> None:
    """Write the files of one drive: a radar, a GPS logger and an RTK receiver that it passes.

    ``my_radar.csv`` has the radar's rows without UNIX times, so that no other file shows how its
    azimuths count.
    """
    radar = ["time_unix_ms;range_m;azimuth_deg"]
    alone = ["time,range_m,azimuth_deg"]
    logger = ["Timestamp (UTC),Latitude,Longitude"]
    truth = ["Timestamp (UTC),Latitude,Longitude,Fix"]
    for k in range(50):
        east = 500.0 + 10.0 * k
        north = 500.0 + 3.0 * k
        distance = np.hypot(east, north) + 2.0 * np.sin(7.0 * k)
        azimuth = np.rad2deg(np.arctan2(east, north)) + 0.1 * np.cos(5.0 * k)
        radar.append(f"{1715679060000 + 1000 * k};{distance:.1f};{azimuth:.2f}")
        alone.append(f"{k},{distance:.1f},{azimuth:.2f}")
        latitude = 48.2651 + north / 111_200.0
        longitude = 11.6689 + east / 74_100.0
        date = f"2024-05-14T09:31:{k:02}.000Z"
        error = 1e-5 * np.sin(11.0 * k)
        logger.append(f"{date},{latitude + error:.7f},{longitude - error:.7f}")
        truth.append(f"{date},{latitude:.9f},{longitude:.9f},4")
    tables = {
        "radar_log.csv": radar,
        "my_radar.csv": alone,
        "gps_logger.csv": logger,
        "rtk_truth.csv": truth,
    }
    for name, lines in tables.items():
        (folder / name).write_text("\n".join(lines) + "\n")


def _following(words: str) -> list[str]:
    """Return the block of the page with these words, without its command."""
    (block,) = (block for block in blocks(PAGE) if block.text.splitlines()[0].endswith(words))
    return block.text.splitlines()[1:]


def test_several_files_and_a_truth_are_given_in_one_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    _write_drive(tmp_path)
    files = "--from radar_log.csv --from gps_logger.csv --truth rtk_truth.csv"
    command = ["new", "experiment", *files.split()]
    done = trackbench(*command, cwd=tmp_path)
    shown = _following(files)
    # The truth's quality is not used.
    assert [line for line in done.stdout.splitlines() if "not used" not in line] == shown
    text = (tmp_path / "radar_log_gps_logger.yaml").read_text()
    lines = [line.strip() for line in text.splitlines()]
    (origin,) = (line for line in lines if line.startswith("origin:"))
    assert f"\n{origin}\n" in PAGE
    first = lines.index('truth: "rtk_truth.csv"')
    filters = yaml.safe_load(text)["filters"]
    words = [f"`{label}`" for label in filters]
    assert f"compares four filters: {', '.join(words[:-1])} and {words[-1]}" in PAGE
    keys = "\n".join(lines[first : first + 3]).replace('"rtk_truth.csv"', "rtk_truth.csv")
    assert f"\n{keys}\n" in PAGE
    # Without the place of the radar it does not run.
    undecided = trackbench("run", "radar_log_gps_logger.yaml", cwd=tmp_path)
    assert undecided.returncode == 2
    assert "'LATITUDE' is not a number" in undecided.stderr
    assert "`'LATITUDE' is not a number`" in PAGE
    # With the place of the radar there is nothing left to write.
    (tmp_path / "radar_log_gps_logger.yaml").unlink()
    assert "`--set 'origin=[48.2651, 11.6689]'`" in PAGE
    done = trackbench(*command, "--set", "origin=[48.2651, 11.6689]", cwd=tmp_path)
    assert "write into it" not in done.stdout
    # The first file has the number 0, and the truth has a key of its own.
    (tmp_path / "radar_log_gps_logger.yaml").unlink()
    for name in ("gps_logger.csv", "rtk_truth.csv"):
        path = tmp_path / name
        path.write_text(path.read_text().replace(" (UTC)", "").replace(".000Z", ".000"))
    options = ["--set", "measurement_naming.1.zone=UTC", "--set", "truth_naming.zone=UTC"]
    assert f"`{' '.join(options[:2])}`" in PAGE
    trackbench(*command, *options, cwd=tmp_path)


def test_the_question_on_azimuths_is_the_one_that_the_page_shows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    _write_drive(tmp_path)
    command = ["new", "experiment", "--from", "my_radar.csv"]
    asked = trackbench(*command, cwd=tmp_path)
    assert asked.returncode == 2
    assert asked.stderr.splitlines() == _following("--from my_radar.csv")
    answered = trackbench(*command, "--set", "clockwise=[azimuth]", cwd=tmp_path)
    assert answered.stdout.splitlines() == _following("--set 'clockwise=[azimuth]'")
