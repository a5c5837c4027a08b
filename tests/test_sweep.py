"""Sweeps: every point validated first, blocks shared, one table, a figure per metric, the best named."""

import json
from pathlib import Path

import pandas as pd
import pytest

from tests.papers import merwe_text
from tests.test_cli import trackbench
from trackbench import api
from trackbench.experiment.problems import Mark, UserError
from trackbench.experiment.reading.axes import axis_values
from trackbench.experiment.reading.config import load

CONFIG = """
name: s
runs: 12
block: 6
scenario: MERWE
filters:
  PF: {kind: pf, N: 20}
  PF (N=5): {kind: pf, N: 5}
""".replace("MERWE", merwe_text(T=8, R=0.1))


@pytest.fixture
def config(tmp_path: Path) -> Path:
    path = tmp_path / "s.yaml"
    path.write_text(CONFIG)
    return path


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("0.5,0.7,0.9", [0.5, 0.7, 0.9]),
        ("systematic, residual", ["systematic", "residual"]),
        ("10..100:4", [10, 40, 70, 100]),
        ("0.1..0.5:5", [0.1, 0.2, 0.3, 0.4, 0.5]),
        ("1..2:3", [1.0, 1.5, 2.0]),
        ("log:1e-5..1e-1:5", [1e-5, 1e-4, 1e-3, 1e-2, 1e-1]),
        ("log:10..1000:3", [10, 100, 1000]),
        ("-1..1:3", [-1, 0, 1]),
        ("5..9:1", [5]),
        ("1e-5", [1e-5]),
    ],
)
def test_axis_values(text: str, values: list[object]) -> None:
    found = axis_values(text, Mark("--grid"))
    assert found == values
    assert [type(v) for v in found] == [type(v) for v in values]


@pytest.mark.parametrize(
    "text", ["1..2", "1..2:0", "log:0..1:3", "log:-1..1:3", "a..b:3", "0..1:" + "9" * 5000]
)
def test_axes_that_are_no_axes(text: str) -> None:
    with pytest.raises(UserError):
        axis_values(text, Mark("--grid"))


def test_every_point_is_validated_before_the_first_starts(config: Path) -> None:
    with pytest.raises(UserError) as caught:
        load(config, grid=["filters.PF.N=10,1,20,0"])
    assert str(caught.value).splitlines() == [
        "--grid filters.PF.N=10,1,20,0: filters.PF.N: 0 is less than 2",
        "--grid filters.PF.N=10,1,20,0: filters.PF.N: 1 is less than 2",
    ]


def test_a_label_with_an_equals_sign(config: Path) -> None:
    experiment = load(config, ["filters.PF (N=5).N=7"], grid=["filters.PF (N=5).N=3,4"])
    assert [p.filters["PF (N=5)"].N for p in experiment.points] == [3, 4]
    assert load(config, ["filters.PF (N=5).N=7"]).points[0].filters["PF (N=5)"].N == 7


def test_a_sweep_over_two_axes(config: Path, tmp_path: Path) -> None:
    report = api.sweep(
        config,
        grid=("filters.PF.N=10,20,80", "filters.PF.resampling=systematic,residual"),
        out=tmp_path / "out",
        workers=1,
        quiet=True,
        formats=("png",),
        fresh=True,
    )
    frame = pd.read_csv(report.folder / "sweep.csv")
    assert list(frame)[:4] == ["filters.PF.N", "filters.PF.resampling", "filter", "metric"]
    errors = frame[frame["metric"] == "rms(rmse)"]
    assert len(errors) == 6 * 2
    # A filter that does not vary is computed once: 6 x 2 blocks of PF and 2 of the other.
    blocks = json.loads((report.folder / "manifest.json").read_text())["blocks"]
    assert blocks["computed"] == 14
    other = errors[errors["filter"] == "PF (N=5)"]["value"]
    assert other.nunique() == 1
    mine = errors[errors["filter"] == "PF"].sort_values("value").iloc[0]
    assert len(report.best) == 1
    where = f"N = {mine['filters.PF.N']}, resampling = {mine['filters.PF.resampling']}"
    best = report.best[0]
    assert best.point == {path: mine[path] for path in best.point}
    assert best.value == mine["value"]
    assert str(best).startswith(f"PF at {where}: rms(rmse)")
    assert (report.folder / "figures" / "sweep-rms-rmse.png").stat().st_size > 10_000


def test_a_point_of_a_sweep_equals_a_run_of_its_own(config: Path, tmp_path: Path) -> None:
    sweep = api.sweep(
        config,
        grid=("scenario.sensor.R=0.1,1.0",),
        out=tmp_path / "a",
        workers=1,
        quiet=True,
        formats=(),
    )
    run = api.run(
        config,
        set=("scenario.sensor.R=1.0",),
        out=tmp_path / "b",
        workers=1,
        quiet=True,
        formats=(),
    )
    frame = sweep.per_run
    mine = (
        frame[frame["scenario.sensor.R"] == 1.0]
        .drop(columns="scenario.sensor.R")
        .reset_index(drop=True)
    )
    pd.testing.assert_frame_equal(mine, run.per_run)
    resolved = api.run(
        tmp_path / "a" / "config.yaml", out=tmp_path / "c", workers=1, quiet=True, formats=()
    )
    for name in ("per_run.csv", "summary.csv"):
        assert (resolved.folder / name).read_bytes() == (sweep.folder / name).read_bytes()


def test_the_command(config: Path) -> None:
    done = trackbench(
        *("sweep", "s.yaml", "--grid", "filters.PF.N=log:10..1000:3", "--format", "svg"),
        cwd=config.parent,
    )
    assert done.returncode == 0, done.stderr
    assert "best: PF at N = " in done.stdout
    assert (config.parent / "results" / "s-sweep" / "figures" / "sweep-rms-rmse.svg").is_file()
    assert not (config.parent / "results" / "s").exists()
