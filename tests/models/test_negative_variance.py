"""A variance that is an expression of the state is an error where it is negative."""

from pathlib import Path

import pytest

from trackbench import api

CONFIG = """
name: negative
runs: 3
scenario:
  kind: tracking
  T: 1
  last: 20
  target:
    kind: driven
    motion: {{kind: map, components: [x], next: {{x: 0.9*x}}, Q: {Q}}}
    launch: {{x: 0}}
  sensor: {{kind: function, h: {{z: x}}, R: {R}}}
  start: {{kind: gaussian, sigma: [1]}}
filters:
  Filter: {filter}
"""
ASSUMED_R = "assume: {sensor: {kind: function, h: {z: x}, R: 0.5*x}}"
ASSUMED_Q = "assume: {motion: {kind: map, components: [x], next: {x: 0.9*x}, Q: 0.5*x}}"


def failure_of(folder: Path, **keys: object) -> str:
    """Run the config; return the line on its failing filter, or nothing."""
    (folder / "c.yaml").write_text(CONFIG.format(**keys))
    report = api.run(folder / "c.yaml", quiet=True, out=folder / "out", formats=())
    return "".join(report.failed)


@pytest.mark.parametrize("kind", ["ekf", "ukf", "pf, N: 20", "enkf, N: 20"])
@pytest.mark.parametrize(("assumed", "key"), [(ASSUMED_R, "R"), (ASSUMED_Q, "Q")])
def test_a_filter_that_assumes_one_fails(kind: str, assumed: str, key: str, tmp_path: Path) -> None:
    """An extended Kalman filter took a negative variance as it was; a particle filter lost its runs."""
    line = failure_of(tmp_path, Q=1, R=1, filter=f"{{kind: {kind}, {assumed}}}")
    component = {"R": "z", "Q": "x"}[key]
    assert f"{key}: step" in line
    assert f"the variance of {component} is -" in line
    assert "write it so that it is never negative, as `max(0, ...)`" in line


@pytest.mark.parametrize(("Q", "R", "key"), [("1", "0.5*x", "R"), ("0.5*x - 0.1", "1", "Q")])
def test_so_does_a_simulation(Q: str, R: str, key: str, tmp_path: Path) -> None:
    line = failure_of(tmp_path, Q=Q, R=R, filter="{kind: ekf}")
    assert f"{key}: step" in line
    assert "never negative" in line


def test_the_way_on_that_it_names_is_one(tmp_path: Path) -> None:
    assert not failure_of(tmp_path, Q=1, R='"max(0.1, 0.5*x)"', filter="{kind: ekf}")
