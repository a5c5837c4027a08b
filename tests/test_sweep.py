"""Sweeps: every point validated first, blocks shared, one table, a figure per metric, the best named."""

import itertools
import re
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from tests.commands import trackbench
from tests.papers import merwe_text
from trackbench import api
from trackbench.config.grid import combinations, number_of_points
from trackbench.config.grid_option import axis_values
from trackbench.config.load import load
from trackbench.errors import Mark, UserError
from trackbench.report.findings.ranking import rankings
from trackbench.results.manifest import read_manifest

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
        ("[0.5, 0.7]", [0.5, 0.7]),
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
    ("text", "what"),
    [
        ("1..2", r"a range is a\.\.b:n"),
        ("1..2:0", "0 values: write 1 to 1000"),
        ("log:0..1:3", "a logarithmic range has ends above zero"),
        ("log:-1..1:3", "a logarithmic range has ends above zero"),
        ("a..b:3", r"a range is a\.\.b:n"),
        ("0..1:" + "9" * 5000, r"a range is a\.\.b:n"),
    ],
    ids=lambda text: text[:12],
)
def test_axes_that_are_no_axes(text: str, what: str) -> None:
    with pytest.raises(UserError, match=what):
        axis_values(text, Mark("--grid"))


def test_an_item_of_a_list_is_named_by_its_number(config: Path) -> None:
    mistakes = {
        "only.5=PF": "only.5: no such item; the list has 1 item, numbered from 0",
        "only.x.y=PF": "only is a list: name one of its items by number, from 0: only.0.x.y",
    }
    config.write_text(config.read_text() + "only: [PF]\n")
    for assignment, expected in mistakes.items():
        with pytest.raises(UserError) as caught:
            load(config, [assignment])
        assert expected in str(caught.value)


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
    blocks = read_manifest(report.folder)["blocks"]
    assert blocks["computed"] == 14
    other = errors[errors["filter"] == "PF (N=5)"]["value"]
    assert other.nunique() == 1
    runs = report.per_run.query("metric == 'rmse' and filter == 'PF'")
    squares = runs.assign(square=runs["value"] ** 2)
    rms = squares.groupby(["filters.PF.N", "filters.PF.resampling"])["square"].mean() ** 0.5
    N, resampling = rms.idxmin()
    (best,) = report.best
    assert best.point == {"filters.PF.N": N, "filters.PF.resampling": resampling}
    assert (best.metric, best.value) == ("rms(rmse)", pytest.approx(rms.min()))
    where = f"PF at (N = {N}, resampling = {resampling})"
    assert str(best).startswith(f"{where}: RMSE {rms.min():.3f}")
    assert len(best.ties) + bool(best.next) >= 1
    (row,) = pd.read_csv(report.folder / "tables" / "best-settings.csv").to_dict("records")
    assert row["Best at"] == f"(N = {N}, resampling = {resampling})"
    assert row["RMSE"] == pytest.approx(rms.min())
    figure = report.folder / "figures" / "sweep-PF-N-PF-resampling.png"
    assert figure.stat().st_size > 10_000


@pytest.mark.parametrize(
    ("tables", "number"),
    [
        ("", "rms(rmse)"),
        ("figures: {f: {kind: rmse-per-run}}\n", "rms(rmse)"),
        ("tables: {t: {kind: metrics, columns: {E: mean(rmse)}}}\n", "mean(rmse)"),
        ("tables: {t: {kind: metrics, columns: {S: mean(log_score)}}}\n", "mean(log_score)"),
    ],
)
def test_filters_and_their_values_are_ranked_by_one_number(
    config: Path, tmp_path: Path, tables: str, number: str
) -> None:
    """A sweep ranked by the mean what a run ranked by the rms, and values by another metric."""
    config.write_text(CONFIG + "metrics: [rmse, log_score]\n" + tables)
    options = api.Options(engine="serial", quiet=True, formats=())
    run = api.run(config, options, out=tmp_path / "run")
    sweep = api.sweep(config, options, out=tmp_path / "sweep", grid=("filters.PF.N=10,20",))
    found = {best.metric for best in sweep.best}
    for report in (run, sweep):
        (ranking,) = rankings(report.results)
        found.add(f"{ranking.order[0].sample.statistic}({ranking.metric})")
    assert found == {number}


def test_of_one_value_none_is_the_best(config: Path, tmp_path: Path) -> None:
    done = trackbench(
        "sweep", config, "--grid", "filters.PF.N=7", "--out", tmp_path / "o", "--engine", "serial"
    )
    assert done.returncode == 0, done.stderr
    table = (tmp_path / "o" / "tables" / "best-settings.md").read_text()
    assert table.endswith("No filter has two values to compare.\n")


def test_a_sweep_of_the_scenario_has_no_best_values(config: Path, tmp_path: Path) -> None:
    grid = ("--grid", "scenario.last=5,6", "--runs", "5", "--engine", "serial", "--all")
    done = trackbench("sweep", config, *grid, "--out", tmp_path / "o")
    assert done.returncode == 0, done.stderr
    assert "best values" not in done.stdout
    assert "two values" not in done.stdout
    assert not [*(tmp_path / "o" / "tables").glob("best-settings*")]


GRIDS = {
    "two filters": (["filters.A.x", "filters.B.x"], [["filters.A.x"], ["filters.B.x"]]),
    "a filter's two keys": (
        ["filters.A.x", "filters.B.x", "filters.A.y"],
        [["filters.A.x", "filters.A.y"], ["filters.B.x"]],
    ),
    "joined": (
        ["filters.A.x", "filters.B.x", "filters.A.y & filters.B.y", "filters.C.x"],
        [["filters.A.x", "filters.B.x", "filters.A.y & filters.B.y"], ["filters.C.x"]],
    ),
    "with the scenario": (
        ["scenario.R", "filters.A.x", "filters.B.x", "scenario.T & filters.B.T"],
        [["filters.A.x"], ["filters.B.x"]],
    ),
    "with the reference": (
        ["filters.R.x", "filters.A.x", "filters.A.b.x"],
        [["filters.A.x"], ["filters.A.b.x"]],
    ),
    "the scenario": (["scenario.R", "scenario.T"], []),
}


@pytest.mark.parametrize("paths", GRIDS)
def test_keys_of_different_filters_are_varied_one_after_the_other(paths: str) -> None:
    """Of all combinations those in which at most one group of filters has other than first values."""
    found, apart = GRIDS[paths]
    grid = {path: list(range(2 + i)) for i, path in enumerate(found)}
    labels = ["A", "B", "C", "R", "A.b"]

    def moved(places: tuple[int, ...]) -> int:
        at = dict(zip(grid, places, strict=True))
        return sum(any(at[path] for path in group) for group in apart)

    every = list(itertools.product(*(range(len(values)) for values in grid.values())))
    wanted = [places for places in every if moved(places) <= 1]
    assert combinations(grid, labels, "R", all_combinations=False) == wanted
    assert number_of_points(grid, labels, "R", all_combinations=False) == len(wanted)
    assert combinations(grid, labels, "R", all_combinations=True) == every
    assert number_of_points(grid, labels, "R", all_combinations=True) == len(every)


def test_two_one_dimensional_sweeps(config: Path, tmp_path: Path) -> None:
    """One figure each, best values of each, and the numbers of the product at a point of it."""
    grid = ("filters.PF.N=10,20,40", "filters.PF (N=5).N=4,6")
    options = api.Options(engine="serial", quiet=True, grid=grid, formats=("svg",))
    report = api.sweep(config, options, out=tmp_path / "out")
    product = api.sweep(config, options, out=tmp_path / "product", product=True, formats=())
    points = ["filters.PF.N", "filters.PF (N=5).N"]
    assert report.summary[points].drop_duplicates().to_numpy().tolist() == [
        *([10, 4], [10, 6]),
        *([20, 4], [40, 4]),
    ]
    assert len(product.summary[points].drop_duplicates()) == 6
    merged = report.per_run.merge(product.per_run, on=[*points, "filter", "run", "metric"])
    assert (merged["value_x"] == merged["value_y"])[merged["value_x"].notna()].all()
    assert [best.filter for best in report.best] == ["PF", "PF (N=5)"]
    assert list(map(str, report.best)) == list(map(str, product.best))  # no setting beside itself
    names = {path.name for path in (report.folder / "figures").iterdir()}
    assert names == {"sweep-PF-N.svg", "sweep-PF-N-5-N.svg"}
    again = api.run(report.folder / "config.yaml", options, out=tmp_path / "again", grid=())
    for name in ("per_run.csv", "summary.csv", "tables/best-settings.csv"):
        assert (again.folder / name).read_bytes() == (report.folder / name).read_bytes()


def test_the_product_is_what_a_config_says(config: Path) -> None:
    grid = ["filters.PF.N=10,20,40", "filters.PF (N=5).N=4,6"]
    assert len(load(config, grid=grid).points) == 4
    assert len(load(config, ["product=true"], grid=grid).points) == 6
    config.write_text(CONFIG + "grid: {filters.PF.N: [10, 20, 40]}\n")
    assert len(load(config, grid=grid[1:]).points) == 6  # the file's own grid is a product
    assert len(load(config, ["product=false"], grid=grid[1:]).points) == 4


def test_a_point_of_a_sweep_equals_a_run_of_its_own(config: Path, tmp_path: Path) -> None:
    quiet: dict[str, Any] = {"engine": "serial", "quiet": True, "formats": ()}
    sweep = api.sweep(config, grid=("scenario.sensor.R=0.1,1.0",), out=tmp_path / "a", **quiet)
    run = api.run(config, set=("scenario.sensor.R=1.0",), out=tmp_path / "b", **quiet)
    frame = sweep.per_run
    mine = frame[frame["scenario.sensor.R"] == 1.0].drop(columns="scenario.sensor.R")
    pd.testing.assert_frame_equal(mine.reset_index(drop=True), run.per_run)
    resolved = api.run(tmp_path / "a" / "config.yaml", out=tmp_path / "c", **quiet)
    for name in ("per_run.csv", "summary.csv"):
        assert (resolved.folder / name).read_bytes() == (sweep.folder / name).read_bytes()


def test_the_command(config: Path) -> None:
    done = trackbench(
        *("sweep", "s.yaml", "--grid", "filters.PF.N=log:10..1000:3", "--format", "svg"),
        cwd=config.parent,
    )
    assert done.returncode == 0, done.stderr
    first, settings = done.stdout.split("PF: RMSE of its settings")
    assert re.search(r"^PF at N = \d+ ", first, re.MULTILINE)
    assert sorted(re.findall(r"^N = (\d+) ", settings, re.MULTILINE)) == ["10", "100", "1000"]
    folder = config.parent / "results" / "s-sweep"
    assert (folder / "figures" / "sweep-PF-N.svg").is_file()
    page = (folder / "report.html").read_text()
    assert "figure-sweep-PF-N" in page
    assert "Each filter&#39;s best values" in page
    again = trackbench("verify", "results/s-sweep", cwd=config.parent)
    assert again.returncode == 0, again.stdout + again.stderr
    assert "the same bytes" in again.stdout
    assert not (config.parent / "results" / "s").exists()
