"""The regions of the figure `posterior`."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.commands import ran
from tests.papers import banana_text
from trackbench.api import run
from trackbench.core.distributions import Gaussian
from trackbench.report.figures.banana import ellipse, predicted_position
from trackbench.report.plotting import file_formats

EXPERIMENT = """name: one
runs: 4
scenario: BANANA
filters: {EKF: {kind: ekf}}
tables: {}
figures: {f: {kind: posterior, step: 3, predicted: EKF}}
""".replace("BANANA", banana_text(scans=4))


def test_the_prediction_against_draws(rng: np.random.Generator) -> None:
    """A state one step on, under white noise acceleration written out as two integrals of one noise."""
    mean, A = np.array([1.0, -2.0, 3.0, 0.5]), rng.standard_normal((4, 4))
    T, q, n = 2.0, 0.7, 400_000
    found = predicted_position(Gaussian(mean, A @ A.T), {"T": T, "target": {"motion": {"q": q}}})
    x = mean[:, None] + A @ rng.standard_normal((4, n))
    walked = np.sqrt(q * T**3 / 3.0) * rng.standard_normal((2, n))
    moved = x[0::2] + T * x[1::2] + walked
    scale = np.sqrt(np.diagonal(found.cov))
    assert (np.abs(moved.mean(axis=1) - found.mean) < 4.0 * scale / np.sqrt(n)).all()
    off = (np.cov(moved) - found.cov) / np.outer(scale, scale)
    assert np.abs(off).max() < 4.0 * np.sqrt(2.0 / n)


def test_it_is_drawn(tmp_path: Path) -> None:
    path = tmp_path / "one.yaml"
    path.write_text(EXPERIMENT)
    run(path, out=tmp_path / "out", formats=("svg",))
    drawn = next((tmp_path / "out").rglob("f.svg")).read_text()
    assert "Predicted, 2" in drawn


@pytest.mark.parametrize(
    "place", [{"at": [9e5, 4e5]}, {"platform": {"steps": [0, 4], "x": [8e5, 1e6], "y": [3e5, 5e5]}}]
)
def test_the_measurement_is_seen_from_the_place_of_the_sensor(
    tmp_path: Path, place: dict[str, Any]
) -> None:
    """The middle of its region is within some deviations of the target, which is at the origin."""
    scenario = json.loads(banana_text(scans=4))
    scenario["sensor"] |= place
    text = EXPERIMENT.replace(banana_text(scans=4), json.dumps(scenario))
    results = ran(tmp_path, text).results
    figure = results.parts("figures")["f"].draw(results)
    across_km, along_m = figure.axes[0].patches[0].get_xy().mean(axis=0)
    assert figure.axes[0].get_xlabel() == "Across the line of sight (km)"
    assert figure.axes[0].get_ylabel() == "Along it (m)"
    deviation_across_km = 1e-6 * scenario["sensor"]["sigma_azimuth_mrad"] * 3e6
    assert abs(across_km) < 4.0 * deviation_across_km
    assert abs(along_m) < 50.0
    file_formats.close(figure)


def test_an_ellipse_may_be_a_line_or_a_point() -> None:
    line = ellipse(np.array([1.0, 2.0]), np.array([[4.0, 0.0], [0.0, 0.0]]), 2.0)
    np.testing.assert_allclose(line[1], 2.0)
    np.testing.assert_allclose([line[0].min(), line[0].max()], [-3.0, 5.0], atol=1e-3)
    point = ellipse(np.array([1.0, 2.0]), np.zeros((2, 2)), 2.0)
    np.testing.assert_array_equal(point.T, np.tile([1.0, 2.0], (201, 1)))
