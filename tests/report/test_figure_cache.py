"""Figures that were drawn before are taken with their values, if nothing changed that they show."""

import shutil
from pathlib import Path
from typing import Any

import matplotlib
import pytest

from trackbench import api
from trackbench.execution.cache import cache_folder
from trackbench.execution.clear_cache import cache_size, clear_cache
from trackbench.plugins import loaded_and_changed_plugins
from trackbench.plugins.plugin_content import Plugin
from trackbench.report import drawing_pool as drawing
from trackbench.report.drawing_pool import drawing_pool
from trackbench.report.figure_cache import FigureCache
from trackbench.report.figure_drawing import draw_figure
from trackbench.report.mean_or_rms_of_metric import compared_statistics
from trackbench.report.tables_and_figures import Results


@pytest.fixture
def folder(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("TRACKBENCH_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("MPLCONFIGDIR", str(tmp_path / "matplotlib"))
    return Path(shutil.copytree(made, tmp_path / "results"))


def files(folder: Path, processes: int = 2, **how: Any) -> dict[str, list[tuple[str, bytes]]]:
    results = api.load(folder).results
    with drawing_pool(results, ["svg"], processes, **how) as draw:
        return {name: draw(name, spec) for name, spec in results.parts("figures").items()}


@pytest.mark.parametrize("processes", [1, 2])
def test_what_was_drawn_is_not_drawn_again(
    folder: Path, processes: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    results = api.load(folder).results
    first = files(folder, processes, fresh=False)
    assert first == {
        n: draw_figure(s, results, ["svg"]) for n, s in results.parts("figures").items()
    }
    monkeypatch.setattr(drawing, "pool", None)  # nobody who draws
    assert files(folder, fresh=False) == first
    with pytest.raises(TypeError, match="object is not callable"):
        files(folder, fresh=True)
    assert cache_size(cache_folder()).figures.number == len(first)
    clear_cache(cache_folder())
    assert cache_size(cache_folder()).figures == (0, 0)
    with pytest.raises(TypeError, match="object is not callable"):
        files(folder, fresh=False)


def keys(folder: Path) -> dict[str, Path]:
    """Where each figure would be kept."""
    results = Results(folder)
    kept = FigureCache.from_results(results)
    assert kept is not None
    return {n: kept._path(spec, "svg") for n, spec in results.parts("figures").items()}


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("per_run.csv", "\nPF,0,", "\nPF,1,"),
        ("per_step.csv", "PF,1,", "PF,2,"),
        ("config.yaml", "seed: 7", "seed: 8"),
        ("manifest.json", '"steps": ', '"steps": 1'),
        ("published/numbers.csv", "9.9", "9.8"),
    ],
)
def test_what_a_figure_shows_is_looked_at(folder: Path, name: str, old: str, new: str) -> None:
    before = keys(folder)
    content = (folder / name).read_text()
    assert old in content
    (folder / name).write_text(content.replace(old, new, 1))
    assert set(keys(folder).values()).isdisjoint(before.values())


def test_a_figure_with_other_keys_is_another_one(folder: Path) -> None:
    before = keys(folder)
    config = (folder / "config.yaml").read_text()
    (folder / "config.yaml").write_text(config.replace("RMSE <i>over</i> time", "Errors", 1))
    after = keys(folder)
    assert [name for name in before if after[name] != before[name]] == ["time"]


def test_the_looks_of_lines_are_those_that_any_figure_gives_them(folder: Path) -> None:
    """`floor` and `baseline` of one figure are the looks of these filters in every other figure."""
    before = keys(folder)
    config = (folder / "config.yaml").read_text()
    for key, old in (("floor", "Exact"), ("baseline", "No data")):
        assert config.count(f"{key}: {old}") == 2
        changed = config.replace(f"{key}: {old}", f"{key}: PF")
        (folder / "config.yaml").write_text(changed)
        assert set(keys(folder).values()).isdisjoint(before.values())


def test_of_other_figures_and_tables_a_figure_takes_looks_and_statistics(folder: Path) -> None:
    """The statistic of a table's column decides by which one a figure of pairs compares."""
    before = files(folder, processes=1)
    results = api.load(folder).results
    figures = results.parts("figures")
    assert results._usual_looks
    statistics = compared_statistics(results.config)
    columns = {name: f"{statistic}({name})" for name, statistic in statistics.items()}
    del results.config["figures"]
    results.config["tables"] = {"other": {"kind": "metrics", "columns": columns}}
    assert before == {name: draw_figure(spec, results, ["svg"]) for name, spec in figures.items()}


def test_what_no_figure_shows_is_not(folder: Path) -> None:
    before = keys(folder)
    config = (folder / "config.yaml").read_text()
    (folder / "config.yaml").write_text(config.replace("Median: median(rmse)", "M: mean(rmse)"))
    (folder / "report.html").unlink()
    assert keys(folder) == before


def test_a_look_of_the_users_own_is_drawn_anew(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "matplotlib").mkdir()
    (tmp_path / "matplotlib" / "matplotlibrc").write_text("font.size: 20\n")
    assert FigureCache.from_results(api.load(folder).results) is None


def test_settings_of_matplotlib_that_a_plugin_changed_are_part_of_a_figure(folder: Path) -> None:
    """They are those of every process that draws."""
    plain = files(folder, processes=1, fresh=False)
    with matplotlib.rc_context({"axes.facecolor": "#fedcba"}):
        colored = files(folder, processes=1, fresh=False)
        assert files(folder, processes=2, fresh=True) == colored
    assert all(b"fedcba" in content for figure in colored.values() for _, content in figure)
    assert files(folder, processes=1, fresh=False) == plain != colored


def test_figures_are_drawn_again_for_another_plugin(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It may have replaced functions of matplotlib."""
    before = keys(folder)
    plugin = Plugin(str(tmp_path / "p.py"), b"import matplotlib\n")
    monkeypatch.setattr(loaded_and_changed_plugins, "_loaded", {plugin.module: plugin})
    assert set(keys(folder).values()).isdisjoint(before.values())
