"""A bug in an output of the package costs that output alone; everything else is written."""

import json
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.conftest import PLANE
from trackbench import api
from trackbench.commands import run_experiment
from trackbench.plugins.stop_signals import Interrupted
from trackbench.report import render
from trackbench.report.figures.bars import Bars
from trackbench.report.figures.rmse_vs_time import RmseVsTime
from trackbench.report.html import report_page
from trackbench.report.tables.metrics import Metrics

CONFIG = f"""name: small
runs: 6
{PLANE}
filters: {{KF: {{kind: kf}}, UKF: {{kind: ukf}}}}
tables:
  errors: {{kind: metrics, columns: {{RMSE: rms(rmse_position)}}}}
figures:
  bars: {{kind: bars, metric: mean(rmse_position)}}
  time: {{kind: rmse-vs-time, metric: rmse_position}}
"""
FAILING: dict[str, tuple[Any, str]] = {
    "table errors": (Metrics, "table"),
    "figure bars": (Bars, "draw"),
    "caption of figure time": (RmseVsTime, "default_caption"),
    "conclusions": (render, "answer"),
    "ranking": (render, "ranking_tables"),
    "pairs": (render, "write_paired"),
    "verdicts": (render, "compare"),
    "report.html": (run_experiment, "write_report"),
    "sweep.csv": (run_experiment, "write_sweep"),
}


def broken(*values: object, **keys: object) -> None:
    raise ZeroDivisionError("of its own")


@pytest.mark.parametrize("what", FAILING)
def test_a_bug_costs_one_output(
    what: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    config = tmp_path / "c.yaml"
    config.write_text(CONFIG)
    if what == "sweep.csv":
        config.write_text(CONFIG.split("tables")[0] + "grid: {scenario.sensor.sigma: [10, 20]}\n")
    monkeypatch.setattr(*FAILING[what], broken)
    run = api.sweep if what == "sweep.csv" else api.run
    keys: dict[str, Any] = {"engine": "serial", "quiet": True, "formats": ("svg",)}
    report = run(config, out=tmp_path / "out", fresh=True, **keys)
    assert any(report.ranking()) == (what != "ranking")
    [line] = report.failed
    assert line.startswith(f"{what} failed: ")
    assert line.endswith("ZeroDivisionError: of its own")
    # All other files are there, and the manifest names what is there.
    out, there = tmp_path / "out", set()
    for path in out.rglob("*"):
        there |= {path.relative_to(out).as_posix()} if path.is_file() else set()
    wanted = {"summary.csv", "tables/errors.csv", "figures/bars.svg", "figures/time.svg"}
    wanted |= {"paired.csv", "report.html", "manifest.json"}
    missing = {"table errors": "tables/errors.csv", "figure bars": "figures/bars.svg"}
    missing |= {"pairs": "paired.csv", "report.html": "report.html"}
    if what != "sweep.csv":
        assert wanted - there == ({missing[what]} if what in missing else set())
    assert set(json.loads((out / "manifest.json").read_text())["files"]) <= there
    monkeypatch.undo()
    assert not api.load(out).failed


def test_a_killed_report_leaves_the_data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The next command draws it; the next run removes what the killed one wrote."""
    config, out = tmp_path / "c.yaml", tmp_path / "out"
    words = yaml.safe_load(CONFIG)
    config.write_text(yaml.safe_dump(words | {"tables": {}}))

    def killed(*_: object) -> None:
        raise Interrupted

    monkeypatch.setattr(report_page, "drawings", killed)
    with pytest.raises(Interrupted):
        api.run(config, engine="serial", quiet=True, out=out, formats=("svg",))
    monkeypatch.undo()
    assert (out / "figures" / "bars.svg").is_file()
    assert api.load(out).ranking()
    api.report(out)
    assert (out / "report.html").is_file()
    monkeypatch.setattr(report_page, "drawings", killed)
    with pytest.raises(Interrupted):
        api.run(config, engine="serial", quiet=True, out=out, formats=("svg",))
    monkeypatch.undo()
    del words["figures"]["bars"]
    config.write_text(yaml.safe_dump(words))
    api.run(config, engine="serial", quiet=True, out=out, formats=("svg",))
    assert not (out / "figures" / "bars.svg").exists()
    assert (out / "figures" / "time.svg").is_file()
