"""Which files git keeps of a results folder, as the package and .gitignore say it."""

import shutil
import subprocess
from pathlib import Path

import pytest

from tests.conftest import ROOT
from trackbench.evaluation.metric_expression import measure
from trackbench.report.figures.bars import Bars
from trackbench.report.kinds import shows_cpu_times
from trackbench.report.tables.equal_cost import EqualCost
from trackbench.report.tables.metrics import Metrics
from trackbench.results.file_names import FORMAT, is_in_git, output_folder
from trackbench.results.manifest import read_manifest, write_manifest


def ignored(names: list[str]) -> set[str]:
    """Return the names in a results folder of the repository that git ignores."""
    paths = [f"results/small/{name}" for name in names]
    done = subprocess.run(
        ["git", "-C", ROOT, "check-ignore", "--no-index", *paths], capture_output=True, text=True
    )
    return {line.removeprefix("results/small/") for line in done.stdout.splitlines()}


@pytest.mark.skipif(shutil.which("git") is None or not (ROOT / ".git").exists(), reason="no git")
def test_git_ignores_what_the_package_says(made: Path) -> None:
    names = [p.relative_to(made).as_posix() for p in made.rglob("*") if p.is_file()]
    names += ["tracks.npz", "shown.npz", "figures/time.png", "tables/t.tex", "run/tables/t.csv"]
    assert {"per_run.csv", "report.html", "run/timing.csv", "summary.csv"} <= {*names}
    assert ignored(names) == {name for name in names if not is_in_git(name)}


def test_what_git_keeps_is_the_same_of_every_run(made: Path, tmp_path: Path) -> None:
    """Run again with other options: times, dates, and formats change no file in git."""
    from trackbench import api

    kept = {name: d for name, d in read_manifest(made)["files"].items() if is_in_git(name)}
    again = api.run(
        *(made / "config.yaml", api.Options(quiet=True, workers=2, fresh=True)),
        **{"out": tmp_path / "again", "formats": ("png", "svg", "tex"), "save_tracks": True},
    ).folder
    found = read_manifest(again)["files"]
    assert {name: digest for name, digest in found.items() if is_in_git(name)} == kept
    assert (again / "manifest.json").read_bytes() == (made / "manifest.json").read_bytes()


def test_what_shows_cpu_times_stands_apart() -> None:
    mean, time = measure("mean(rmse)"), measure("ratio(cpu_s_per_run, PF)")
    both = Metrics(columns={"Mean": mean, "Time": time})
    assert both.without_cpu_times() == Metrics(columns={"Mean": mean})
    plain, times = Metrics(columns={"Mean": mean}), Metrics(columns={"Time": time})
    assert plain.without_cpu_times() is plain
    assert times.without_cpu_times() is None
    assert EqualCost(of="PF").without_cpu_times() is None
    assert output_folder("figures", shows_cpu_times(Bars(metric=time))) == "run/figures"
    assert not shows_cpu_times(Bars(metric=mean))


def test_a_manifest_that_is_written_again_has_the_format_of_today(tmp_path: Path) -> None:
    write_manifest(tmp_path, {"seed": 1, "format": FORMAT - 1, "files": {}}, ())
    assert read_manifest(tmp_path)["format"] == FORMAT
