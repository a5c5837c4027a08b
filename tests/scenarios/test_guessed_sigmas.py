"""Guessed standard deviations of new configs: of two digits, as one digit changes them by a third."""

from pathlib import Path

import numpy as np
import pytest

from trackbench.scenarios.recordings.guess_table import recognized
from trackbench.scenarios.recordings.naming_of_columns import Naming

STRAIGHT_RADAR = Naming(clockwise=("azimuth",), units={"range": "m", "azimuth": "deg"})


def write_radar(path: Path, sigma_range: float) -> Path:
    """Write 400 rows of a radar that sees a target fly straight away, with errors of the range."""
    time = 2.0 * np.arange(400)
    noise = np.random.default_rng(3).normal(size=(2, len(time)))
    ranges = 5000.0 + 12.0 * time + sigma_range * noise[0]
    azimuths = 40.0 + 0.2 * noise[1]
    rows = [f"{t:g},{r:.1f},{a:.3f}" for t, r, a in zip(time, ranges, azimuths, strict=True)]
    path.write_text("\n".join(["time,range_m,azimuth_deg", *rows]) + "\n")
    return path


@pytest.mark.parametrize("sigma", [1.4, 11.0, 13.0, 15.0, 17.0, 19.0, 30.0])
def test_a_guessed_sigma_is_near_the_true_one(tmp_path: Path, sigma: float) -> None:
    # The estimate of 400 rows has a standard error of some 6 %.
    guess = recognized(str(write_radar(tmp_path / "m.csv", sigma)), STRAIGHT_RADAR)
    (sensor,) = guess.sensors
    assert sensor.sigmas[0] == pytest.approx(sigma, rel=0.12)
    assert sensor.sigmas[1] == pytest.approx(np.deg2rad(0.2), rel=0.12)
    assert guess.speed == pytest.approx(12.0, rel=0.05)
