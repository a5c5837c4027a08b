"""Plot, report and compare know a results folder and nothing else: no scenario, no plugin, no data."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.commands import ran, trackbench
from tests.conftest import ROOT
from tests.papers import merwe_text
from trackbench import api
from trackbench.report.tables_and_figures import Results

COMMANDS = ("plot", "report", "compare")


def alone(
    *words: object, cwd: Path, before: tuple[str, ...] = ()
) -> subprocess.CompletedProcess[str]:
    """A command in a process that has loaded nothing yet."""
    run = [*before, sys.executable, "-m", "trackbench", *map(str, words)]
    env = os.environ | {"PYTHONPATH": str(ROOT)}
    return subprocess.run(run, capture_output=True, text=True, cwd=cwd, env=env, check=False)


def test_no_scenario_is_loaded_to_read_a_folder(made: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(made, tmp_path / "made")
    script = "import sys; from trackbench import api; folder = sys.argv[1]; api.compare(folder); "
    script += "api.plot(folder, ['svg'], ['time', 'pairs']); api.report(folder); "
    script += "print(*(m for m in sys.modules if '.scenarios.' in m))"
    done = subprocess.run(
        [sys.executable, "-c", script, folder], capture_output=True, text=True, check=True
    )
    loaded = {name.removeprefix("trackbench.scenarios.") for name in done.stdout.split()}
    assert loaded <= {"base", "scored_truth", "position_from_one_scan"}


def test_on_the_scenario_that_new_scenario_writes(tmp_path: Path) -> None:
    assert trackbench("new", "scenario", "my-radar", cwd=tmp_path).returncode == 0
    config = (tmp_path / "my_radar.yaml").read_text()
    more = "  c: {kind: consistency}\nfigures:\n  e: {kind: estimates}\n"
    more += "  t: {kind: track, filters: [EKF]}"
    (tmp_path / "my_radar.yaml").write_text(config.replace("figures:", more))
    run = ("my_radar.yaml", "--allow-plugins", "--runs", 3, "--workers", 1, "--set", "block=fit")
    assert trackbench("run", *run, cwd=tmp_path).returncode == 0
    (tmp_path / "my_radar.py").unlink()
    for command in COMMANDS:
        done = trackbench(command, "results/my-radar", cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        assert "note" not in done.stderr


OWN = """
from dataclasses import dataclass
from trackbench.registry import register
from trackbench.report.plotting import style
from trackbench.report.table import Table

@register("tables", "own-table")
@dataclass(frozen=True, kw_only=True)
class OwnTable:
    'Nothing.'
    def table(self, results):
        return Table("Mine alone", ["Filter"], [], 3)

@register("figures", "own-figure")
@dataclass(frozen=True, kw_only=True)
class OwnFigure:
    'Nothing.'
    def draw(self, results):
        return style.subplots()[0]
"""
PLUGIN = f"""
name: own
runs: 3
plugins: [own.py]
scenario: {merwe_text(T=3)}
filters: {{PF: {{kind: pf, N: 5}}}}
tables: {{t: {{kind: own-table}}}}
figures: {{f: {{kind: own-figure}}, g: {{kind: rmse-vs-time}}}}
"""


def test_tables_and_figures_of_a_plugin(tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(OWN)
    (tmp_path / "own.yaml").write_text(PLUGIN)
    run = ("own.yaml", "--allow-plugins", "--workers", 1, "--format", "svg")
    assert trackbench("run", *run, cwd=tmp_path).returncode == 0
    folder = tmp_path / "results" / "own"
    for command in COMMANDS:
        done = trackbench(command, folder, cwd=tmp_path)
        assert done.returncode == 0
        notes = [line for line in done.stderr.splitlines() if line.startswith("note: ")]
        assert len(notes) == 2
        assert "tables.t is left as it is: 'own-table' is not a kind of table" in notes[0]
    page = (folder / "report.html").read_text()
    assert "Mine alone" not in page
    assert 'id="figure-f"' in page  # as the run drew it
    drawn = trackbench("plot", folder, cwd=tmp_path).stdout.split()
    assert [Path(path).stem for path in drawn] == ["g", "g"]  # png and svg
    drawn = trackbench("plot", folder, "--allow-plugins", cwd=tmp_path).stdout.split()
    assert [Path(path).stem for path in drawn] == ["f", "f", "g", "g"]
    done = trackbench("report", folder, "--allow-plugins", cwd=tmp_path)
    assert done.stderr == ""
    assert "Mine alone" in (folder / "report.html").read_text()
    (tmp_path / "own.py").write_text(OWN + "\n")
    done = trackbench("report", folder, "--allow-plugins", cwd=tmp_path)
    assert "own.py was changed after the run" in done.stderr
    (tmp_path / "own.py").unlink()
    done = trackbench("plot", folder, "--allow-plugins", cwd=tmp_path)
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert trackbench("plot", folder, cwd=tmp_path).returncode == 0


RECORDED = """
name: r
scenario:
  kind: tracking
  target: {kind: measured, measurements: z.csv}
  sensor: {kind: position, sigma: 10}
  start: {kind: one-scan, sigma_velocity: 10}
  assume: {motion: {kind: cwna, q: 1}}
filters: {EKF: {kind: ekf}}
tables: {c: {kind: innovations}}
figures: {t: {kind: track, filters: [EKF]}, e: {kind: estimates}}
"""


def test_moved_recorded_data(tmp_path: Path) -> None:
    home = tmp_path / "a"
    home.mkdir()
    lines = [f"1,{k},{10 * k:.1f},{5 * k:.1f}" for k in range(6)]
    (home / "z.csv").write_text("run,time,x,y\n" + "\n".join(lines) + "\n")
    results = ran(home, RECORDED, formats=("svg",)).results
    assert results.facts({}).scenario["target"]["measurements"] == "../z.csv"
    folder = Path(shutil.move(home / "out", tmp_path / "moved"))
    shutil.rmtree(home)
    for command in (api.plot, api.report, api.compare):
        command(folder)


def test_a_folder_that_cannot_be_written(made: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(made, tmp_path / "small")
    for path in (*folder.rglob("*"), folder):
        path.chmod(0o555 if path.is_dir() else 0o444)
    before: tuple[str, ...] = ()
    if os.access(folder, os.W_OK):  # as root, unless this of its rights is taken away
        if not shutil.which("setpriv"):
            pytest.skip("root may write everywhere")
        before = ("setpriv", "--bounding-set=-dac_override")
    done = alone("compare", folder, cwd=tmp_path, before=before)
    assert done.returncode == 0, done.stderr
    assert done.stdout == trackbench("compare", made, cwd=tmp_path).stdout
    done = alone("report", folder, cwd=tmp_path, before=before)
    assert (done.returncode, done.stdout) == (0, "small-report.html\n")
    assert (tmp_path / "small-report.html").stat().st_size > 10_000
    done = alone("plot", folder, cwd=tmp_path, before=before)
    assert (done.returncode, done.stderr) == (2, f"{folder}/: may not be written in\n")


TURNS = """
name: t
runs: 3
scenario:
  kind: tracking
  last: 40
  target: {kind: legs, launch: {x: 0, y: 0, vx: 10}, legs: [{start: 10, end: 20, ax: 1}]}
  sensor: {kind: position, sigma: 10}
  start: two-scan
  assume: {motion: {kind: cv, q: 1}}
filters: {EKF: {kind: ekf}}
grid: {scenario.target.legs: [[{start: 10, end: 20, ax: 1}], [{start: 15, end: 30, ax: 1}]]}
"""


def test_what_is_shaded_is_of_the_point(tmp_path: Path) -> None:
    results = ran(tmp_path, TURNS).results
    found = [results.facts(point).spans for point in results.points()]
    assert found == [[[10.0, 20.0]], [[15.0, 30.0]]]


TWO = "{kind: position, sigma: 10}"


def test_a_table_counts_the_components_of_each_point(tmp_path: Path) -> None:
    grid = f"grid: {{scenario.sensor: [{TWO}, [{TWO}, {TWO}]]}}\n"
    grid += "tables: {c: {kind: consistency}}\n"
    results = ran(tmp_path, TURNS.partition("grid:")[0] + grid).results
    table = results.tables["c"]
    notes = [note.partition(" over")[0] for note in table.notes]
    four = "95 % band of ANIS of 4 components"
    assert notes == ["95 % band of ANEES", "95 % band of ANIS of 2 components", four]
    frame = results.per_step[results.per_step["metric"] == "nis"]
    medians = frame.groupby("scenario.sensor", sort=False)["value"].median()
    found = [cells[2].estimate.value for cells in table.cells]
    np.testing.assert_allclose(found, medians / [2, 4])


def test_a_folder_without_the_points_or_with_others_is_said(made: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(made, tmp_path / "small")
    text = (folder / "points.json").read_text()
    (folder / "points.json").write_text(text.replace('"N": 10', '"N": 11'))
    done = trackbench("compare", folder, cwd=tmp_path)
    assert done.returncode == 2
    assert "points.json was changed after the run" in done.stderr
    assert Results(made).facts({}).filters["PF"]["N"] == 10


def test_checking_a_config_imports_only_the_files_of_its_kinds() -> None:
    """Most of the time of `check` goes into imports."""
    script = "import sys; from trackbench.cli.app import app; "
    script += "app(['check', 'bearings-two'], standalone_mode=False); "
    script += "print(*(m for m in sys.modules if m.startswith('trackbench.')))"
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    loaded = {name.removeprefix("trackbench.") for name in done.stdout.split()}
    assert "filters.ekf" in loaded
    others = {
        "filters.hdepf",
        "report.figures.rank_histograms",
        "report.render",
        "execution.run_plans",
    }
    assert not loaded & others
