"""A table or figure of one's own that fails costs itself alone, and is said in one line."""

import json
import shutil
from pathlib import Path

import pytest

from tests.commands import trackbench
from tests.conftest import PLANE
from trackbench import api
from trackbench.report.output_errors import PartialReportError

PLUGIN = """
from dataclasses import dataclass

from trackbench.statistics.sample_statistics import Estimate
from trackbench.registry import register
from trackbench.report.plotting import style
from trackbench.report.kinds import FigureKind, TableKind
from trackbench.report.table import Cell, Table


@register("tables", "own-table")
@dataclass(frozen=True, kw_only=True)
class OwnTable(TableKind):
    "Own."

    def table(self, results):
        found = Table("Own", ["Filter"], ["One"], 2)
        found.add(["KF"], [Cell(Estimate(1.0, 0.1), 6, 0)])
        return found


@register("figures", "own-figure")
@dataclass(frozen=True, kw_only=True)
class OwnFigure(FigureKind):
    "Own."

    def draw(self, results):
        figure, axes = style.subplots()
        axes.plot([1, 2], [3, 4])
        return figure
"""
CONFIG = (
    """name: own
runs: 6
plugins: [own.py]
"""
    + PLANE
    + """filters:
  KF: {kind: kf}
tables:
  own: {kind: own-table}
  errors: {kind: metrics, columns: {RMSE: rms(rmse_position)}}
figures:
  mine: {kind: own-figure}
  time: {kind: rmse-vs-time, metric: rmse_position}
"""
)
TABLE, DRAW = "        return found\n", "        return figure\n"
BAD = {
    "a table raises": (
        TABLE, "        1 / 0\n", "table own", "1 / 0", "ZeroDivisionError: division by zero"),
    "a table leaves": (
        TABLE, "        raise SystemExit\n", "table own", "raise", "code of a plugin raised"),
    "a table is nothing": (TABLE, "", "table own", "def table", "table gives a NoneType, not a Table"),
    "a table with a row too short": (
        TABLE, "        found.keys.append(['EKF'])\n" + TABLE, "table own", "def table",
        "the table cannot be written: ValueError: zip()"),
    "a figure raises": (
        DRAW, "        axes.plot([1], [2], colour='red')\n", "figure mine", "colour",
        "AttributeError: Line2D.set() got an unexpected keyword argument 'colour'"),
    "a figure is nothing": (DRAW, "", "figure mine", "def draw", "draw gives a NoneType, not a Figure"),
    "a figure cannot be laid out": (
        DRAW, "        figure.set_size_inches(1e9, 1e9)\n" + DRAW, "figure mine",
        "@register(\"figures", ""),
    "a caption raises": (
        DRAW, DRAW + "\n    def default_caption(self, results):\n        1 / 0\n",
        "caption of figure mine",
        "1 / 0", "ZeroDivisionError"),
}  # fmt: skip


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run in which nothing fails."""
    home = tmp_path_factory.mktemp("whole")
    (home / "own.py").write_text(PLUGIN)
    (home / "c.yaml").write_text(CONFIG)
    assert run(home, "--engine", "serial") == (0, [])
    return home


@pytest.fixture
def home(whole: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(whole, tmp_path / "home"))


def run(home: Path, *words: str) -> tuple[int, list[str]]:
    done = trackbench("run", "c.yaml", "--allow-plugins", *words, cwd=home)
    assert "Traceback" not in done.stderr
    return done.returncode, [x for x in done.stderr.splitlines() if x.startswith("error: ")]


def spoil(home: Path, what: str) -> str:
    """The plugin with a mistake; the line that is to be said."""
    good, bad, part, word, said = BAD[what]
    text = PLUGIN.replace(good, bad)
    (home / "own.py").write_text(text)
    line = max(i for i, row in enumerate(text.splitlines(), 1) if word in row)
    return f"error: {part} failed: own.py:{line}: {said}"


@pytest.mark.parametrize(
    ("what", "engine"), [*((what, "serial") for what in BAD), ("a figure raises", "processes")]
)
def test_all_else_is_written(what: str, engine: str, home: Path) -> None:
    line = spoil(home, what)
    code, [error] = run(home, "--engine", engine, "--workers", "2")
    assert code == 1
    assert error.startswith(line)
    out = home / "results" / "own"
    there = {p.relative_to(out).as_posix() for p in out.rglob("*") if p.is_file()}
    assert {"tables/errors.csv", "figures/time.svg", "report.html", "manifest.json"} <= there
    assert ("tables/own.csv" in there) == ("table" not in BAD[what][2])
    assert ("figures/mine.png" in there) == (not BAD[what][2].startswith("figure"))
    assert set(json.loads((out / "manifest.json").read_text())["files"]) <= there
    page = (out / "report.html").read_text()
    assert f"Failed: {BAD[what][2]} (own.py:" in page
    assert trackbench("compare", out, cwd=home).returncode == 0


def test_of_a_folder_the_old_files_go(home: Path) -> None:
    out = home / "results" / "own"
    line = spoil(home, "a figure raises")
    done = trackbench("plot", "results/own", "--format", "svg", "--allow-plugins", cwd=home)
    assert done.returncode == 1
    assert done.stdout.splitlines() == ["results/own/figures/time.svg"]
    assert [x for x in done.stderr.splitlines() if x.startswith("error")] == [line]
    assert not [*(out / "figures").glob("mine.*")]
    done = trackbench("report", "results/own", "--allow-plugins", cwd=home)
    assert (done.returncode, done.stdout) == (1, "results/own/report.html\n")
    assert line in done.stderr.splitlines()
    (home / "own.py").write_text(PLUGIN)
    assert trackbench("plot", "results/own", "--allow-plugins", cwd=home).returncode == 0
    assert (out / "figures" / "mine.svg").is_file()


def test_a_program_is_told_what_is_missing(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(home)
    spoil(home, "a table raises")
    report = api.run("c.yaml", allow_plugins=True, quiet=True, engine="serial")
    assert [*report.tables] == ["errors"]
    assert len(report.failed) == 1
    assert "ZeroDivisionError" in report.results._repr_html_()
    with pytest.raises(PartialReportError) as caught:
        api.report(report.folder, allow_plugins=True)
    assert caught.value.lines == report.failed
    assert caught.value.written == [report.folder / "report.html"]


def test_verify_says_what_cannot_be_made_again(home: Path) -> None:
    spoil(home, "a table raises")
    done = trackbench("verify", "results/own", "--allow-plugins", cwd=home)
    assert done.returncode == 1
    assert "table own failed: own.py:" in done.stdout


@pytest.mark.parametrize(
    ("line", "said"),
    [("requires = ['nees']",
      "requires is ['nees'], not a mapping of metrics to per_run, per_step, summary"),
     ("requires = {'nees': 'per_rum'}", "requires is {'nees': 'per_rum'}, not a mapping of metrics to "),
     ("label_keys = ('acros', 'up')", "OwnFigure: label_keys is ('acros', 'up'), not a tuple of keys"),
     ("label_keys = ('title')", "OwnFigure: label_keys is 'title', not a tuple of keys"),
     ("shown_runs = property(lambda self: 'a')", "shown_runs is 'a', no whole number"),
     ("shown_runs = property(lambda self: 1 / 0)", "ZeroDivisionError: division by zero"),
     ("shown_components = 5", "shown_components is 5, neither a tuple of numbers nor None")],
)  # fmt: skip
def test_what_a_figure_says_that_it_needs_is_looked_at(line: str, said: str, home: Path) -> None:
    text = PLUGIN.replace("    def draw", f"    {line}\n\n    def draw")
    (home / "own.py").write_text(text)
    done = trackbench("check", "c.yaml", "--allow-plugins", cwd=home)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert said in done.stderr
    assert "own.py:" in done.stderr


def test_what_a_table_is_given_is_read_only(home: Path) -> None:
    """Or it would change other tables' numbers."""
    for spoilt in ("[v.sort() for v in results.runs({}).values()]",
                   "results.columns('summary')['value'][:] = 0"):  # fmt: skip
        text = PLUGIN.replace("        found = Table", f"        {spoilt}\n        found = Table")
        (home / "own.py").write_text(text)
        code, errors = run(home, "--engine", "serial")
        line = next(i for i, row in enumerate(text.splitlines(), 1) if spoilt in row)
        assert code == 1
        assert errors[0].startswith(f"error: table own failed: own.py:{line}: ValueError: ")
        assert "read-only" in errors[0]


@pytest.mark.parametrize(
    ("hook", "said"),
    [("return None", "own.py:{}: conflicts gives a NoneType, not a dict"),
     ("return {'': 1}", "own.py:{}: conflicts and cautions are words, and these are not"),
     ("1 / 0", "own.py:{}: ZeroDivisionError: division by zero")],
)  # fmt: skip
def test_what_it_cannot_show_is_asked_with_care(hook: str, said: str, home: Path) -> None:
    asked = f"    def conflicts(self, points):\n        {hook}\n\n    def table"
    text = PLUGIN.replace("    def table", asked)
    (home / "own.py").write_text(text)
    done = trackbench("check", "c.yaml", "--allow-plugins", cwd=home)
    assert done.returncode == 2
    word = "1 / 0" if hook == "1 / 0" else "def conflicts"
    line = next(i for i, row in enumerate(text.splitlines(), 1) if word in row)
    assert done.stderr == f"c.yaml:13:8: tables.own: {said.format(line)}\n"
