"""Runs of a recording with too few rows: out of the grid of a new config, and named in messages."""

from pathlib import Path

import numpy as np
import pytest

from tests.commands import trackbench
from tests.scenarios.test_clocks import config, table
from trackbench import api
from trackbench.config.load import load
from trackbench.errors import UserError

pytestmark = pytest.mark.usefixtures("no_report")


def write(folder: Path, rows_by_ship: dict[str, int]) -> Path:
    """Write a table of ships that sail beside each other, with so many rows each."""
    noise = np.random.default_rng(7).normal(size=(2, 40))
    rows = [
        [name, 10 * k, 50 * k + 5 * noise[0, k], 400 * number + 20 * k + 5 * noise[1, k]]
        for number, (name, count) in enumerate(rows_by_ship.items())
        for k in range(count)
    ]
    path = folder / "m.csv"
    path.write_text(table("ship,time,x,y", *zip(*rows, strict=True)))
    return path


def test_the_grid_of_a_new_config_has_no_run_that_stops_it(tmp_path: Path) -> None:
    write(tmp_path, {"A": 40, "B": 1, "C": 30, "D": 2, "E": 3})
    trackbench("new", "experiment", "g", "--from", "m.csv", cwd=tmp_path)
    text = (tmp_path / "g.yaml").read_text()
    comment = "runs, each on a clock of its own; without D, B: fewer than 3 rows"
    line = f"grid: {{scenario.target.runs: [[A], [C], [E]]}}  # {comment}"
    assert f"\n# {line}\n" in text
    (tmp_path / "g.yaml").write_text(text.replace("# grid", "grid"))
    assert len(load(tmp_path / "g.yaml").points) == 3
    # Two runs, of which one is too short, are no grid.
    write(tmp_path, {"A": 40, "B": 1})
    options = ("--from", "m.csv", "--set", "columns.run=ship")
    trackbench("new", "experiment", "h", *options, cwd=tmp_path)
    assert "grid" not in (tmp_path / "h.yaml").read_text()


def test_a_run_of_one_row_is_named_with_the_way_on(tmp_path: Path) -> None:
    write(tmp_path, {"A": 40, "B": 1, "C": 1})
    keys = {"measurements": "m.csv", "columns": {"run": "ship"}}
    for runs, subject in (
        (["B"], "run B has"),
        (["B", "C"], "each of the runs B, C has at most"),
    ):
        path = config(tmp_path, {**keys, "runs": runs})
        with pytest.raises(UserError) as caught:
            load(path)
        reason = "rows at 1 time, so that nothing is left to measure after the start"
        remedy = "choose longer runs by `runs`, also in a `grid`"
        assert f"m.csv:1:1: scenario: {subject} {reason}: {remedy}" in str(caught.value)


def test_the_ranking_names_the_run_that_it_leaves_out(tmp_path: Path) -> None:
    write(tmp_path, {"A": 12, "B": 12, "C": 1})
    columns = {"measurements": "m.csv", "columns": {"run": "ship"}}
    path = config(tmp_path, {**columns, "runs": ["B", "C", "A"]})
    report = api.run(path, out=tmp_path / "out", workers=1, quiet=True, formats=())
    (ranking,) = report.ranking()
    assert ranking.title.startswith("Ranking over 2 of 3 runs")
    reason = "no filter got a measurement at a scored step after the start"
    assert f"Not ranked: run 1 (C), counted from 0, as {reason}." in ranking.notes
    path = config(tmp_path, {**columns, "runs": ["B", "A"]})
    report = api.run(path, out=tmp_path / "both", workers=1, quiet=True, formats=())
    (ranking,) = report.ranking()
    assert not any("Not ranked" in note for note in ranking.notes)
