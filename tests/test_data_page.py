"""The page on recordings says what its first config gives, and how a plane shortens what is far away."""

from pathlib import Path

import numpy as np
import pytest

from tests.commands import trackbench
from tests.conftest import ROOT
from trackbench import api
from trackbench.core.arrays import Array
from trackbench.core.conversions import Geodetic, earth_centered, east_north_up
from trackbench.report.findings.ranking import rankings

PAGE = (ROOT / "docs" / "your-data.md").read_text(encoding="utf-8")


def test_the_scores_are_those_of_the_written_config(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "experiments").symlink_to(ROOT / "experiments")
    trackbench("new", "experiment", "--from", "experiments/data/solent-ais.csv", cwd=tmp_path)
    report = api.run("solent_ais.yaml", engine="serial", quiet=True, formats=())
    (ranking,) = rankings(report.results)
    assert ranking.metric.metric == "log_score"
    scores = {c.label: c.overall.value for c in ranking.order}
    assert {*scores} == {"KF", "IMM", "RPF"}
    assert f"The IMM is best, with {scores['IMM']:.1f}" in PAGE
    assert f"The Kalman filter is {scores['IMM'] - scores['KF']:.1f} lower" in PAGE
    assert f"The particle filter has {scores['RPF']:.0f}" in PAGE


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


def _on_the_ground(latitude: Array) -> Geodetic:
    return Geodetic(latitude, np.zeros_like(latitude), np.zeros_like(latitude))


def _rounded(percent: float) -> str:
    """Return two digits from 1 % on, else one."""
    return f"{percent:.2g}" if percent >= 1.0 else f"{percent:.1g}"
