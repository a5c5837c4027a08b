"""Sensors whose period is longer than the run."""

from pathlib import Path

import pytest

from trackbench.config.load import load
from trackbench.errors import UserError

CONFIG = """
name: periods
seed: 1
runs: 2
scenario:
  kind: tracking
  last: 60
  target: {kind: driven, motion: {kind: cwna, q: 0.1}}
  sensor: %s
  start: {kind: gaussian, sigma: [10, 1, 10, 1]}
filters:
  KF: {kind: kf}
"""
ONE = "{kind: position, sigma: 10, period: %d, offset: %d}"
TWO = "[{kind: position, sigma: 10}, {kind: velocity, sigma: 1, period: %d, offset: %d}]"


@pytest.mark.parametrize(("sensor", "key"), [(ONE, "sensor.period"), (TWO, "sensor.1.period")])
@pytest.mark.parametrize(("period", "offset"), [(61, 0), (100, 0), (200, 70)])
def test_a_sensor_that_never_measures_is_refused_with_its_line(
    tmp_path: Path, sensor: str, key: str, period: int, offset: int
) -> None:
    path = tmp_path / "c.yaml"
    path.write_text(CONFIG % sensor % (period, offset))
    with pytest.raises(UserError) as caught:
        load(path)
    (problem,) = caught.value.problems
    assert str(problem).startswith(f"{path}:9:")
    assert f": scenario.{key}: this sensor never measures: with `offset: {offset}` " in str(problem)


@pytest.mark.parametrize(("period", "offset"), [(60, 0), (100, 1), (100, 60), (100, 130)])
def test_a_sensor_that_measures_once_is_allowed(tmp_path: Path, period: int, offset: int) -> None:
    path = tmp_path / "c.yaml"
    path.write_text(CONFIG % ONE % (period, offset))
    load(path)


def test_a_longer_run_has_a_measurement_of_a_rare_sensor(tmp_path: Path) -> None:
    path = tmp_path / "c.yaml"
    path.write_text(CONFIG % ONE % (100, 0))
    load(path, overrides=["scenario.last=100"])
