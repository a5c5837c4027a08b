"""One filter that fails does not stop the others, and the table says what happened."""

from pathlib import Path

import pytest

from tests.test_cli import trackbench

PLUGIN = """
from dataclasses import dataclass, replace

import numpy as np

from trackbench.filters.bootstrap import PF
from trackbench.filters.reference import PriorMean
from trackbench.registry import register


@register("filters", "raises")
@dataclass(frozen=True, kw_only=True)
class Raises(PF):
    def step(self, model, state, z, k, rng):
        if k == 5:
            raise ValueError("no fifth step")
        return super().step(model, state, z, k, rng)


@register("filters", "not-a-number")
@dataclass(frozen=True, kw_only=True)
class NotANumber(PriorMean):
    def estimate(self, state):
        return replace(state, mean=np.full_like(state.mean, np.nan))


@register("filters", "far-away")
@dataclass(frozen=True, kw_only=True)
class FarAway(PriorMean):
    def estimate(self, state):
        return replace(state, mean=state.mean + 1e6)
"""
CONFIG = """
name: failing
runs: 20
block: 10
scenario: {kind: merwe, T: 10}
plugins: [bad.py]
filters:
  PF: {kind: pf, N: 20}
  Raises: {kind: raises}
  NaN: {kind: not-a-number}
  Far: {kind: far-away}
  UKF: {kind: ukf}
tables:
  t: {kind: metrics, columns: {RMSE: rms(rmse)}}
"""


@pytest.mark.parametrize("engine", ["serial", "processes"])
def test_the_others_finish(tmp_path: Path, engine: str) -> None:
    (tmp_path / "bad.py").write_text(PLUGIN)
    (tmp_path / "c.yaml").write_text(CONFIG)
    done = trackbench(
        *("run", "c.yaml", "--allow-plugins", "--engine", engine, "--workers", "2", "--fresh"),
        cwd=tmp_path,
    )
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    reason = "Raises failed: ValueError: no fifth step (runs "  # either block may come first
    assert f"error: {reason}" in done.stderr
    assert "error: NaN failed: 20 of 20 runs lost, 20 because the estimate left" in done.stderr
    assert "note: Far: 20 of 20 runs lost, 20 because the error passed the limit" in done.stderr
    rows = {line.split(" | ")[0].strip("| "): line for line in done.stdout.splitlines()}
    assert "±" in rows["PF"]
    assert "±" in rows["UKF"]
    assert "20 of 20" in rows["NaN"]
    assert "all runs lost" in rows["Far"]
    assert reason in done.stdout
    table = (tmp_path / "results" / "failing" / "tables" / "t.md").read_text()
    assert reason in table


def test_every_filter_fails(tmp_path: Path) -> None:
    (tmp_path / "bad.py").write_text(PLUGIN)
    text = "".join(
        line
        for line in CONFIG.splitlines(keepends=True)
        if "PF:" not in line and "UKF:" not in line
    )
    text = text.replace("  NaN: {kind: not-a-number}\n", "").replace(
        "  Far: {kind: far-away}\n", ""
    )
    kinds = ("rmse-vs-time", "rmse-per-run", "bars", "critical-difference", "heat-map", "estimates")
    text += "figures:\n" + "".join(f"  f{i}: {{kind: {k}}}\n" for i, k in enumerate(kinds))
    text += "  g: {kind: rmse-vs-parameter, metric: mean(rmse)}\n"
    text += "grid: {scenario.R: [0.1, 1.0]}\n"
    (tmp_path / "c.yaml").write_text(text)
    done = trackbench("run", "c.yaml", "--allow-plugins", "--format", "svg", cwd=tmp_path)
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    assert "Raises failed: ValueError: no fifth step" in done.stdout


def test_every_filter_fails_at_every_point_of_a_sweep(tmp_path: Path) -> None:
    (tmp_path / "bad.py").write_text(PLUGIN)
    (tmp_path / "c.yaml").write_text(CONFIG.replace("filters:", "only: [Raises]\nfilters:"))
    done = trackbench(
        *("sweep", "c.yaml", "--allow-plugins", "--grid", "scenario.R=0.1,1", "--format", "svg"),
        cwd=tmp_path,
    )
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    (header,) = (tmp_path / "results" / "failing-sweep" / "sweep.csv").read_text().splitlines()
    assert header.startswith("scenario.R,filter,metric")
