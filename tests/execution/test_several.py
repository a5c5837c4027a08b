"""Several experiments in one command, on the same workers."""

import multiprocessing
import re
import time
from pathlib import Path

import pytest

from tests.commands import trackbench
from tests.papers import merwe_text
from trackbench import api
from trackbench.errors import UserError
from trackbench.evaluation.block_task import BlockTask
from trackbench.execution.cache import BlockStore
from trackbench.execution.plan import make_plan

CONFIG = """
name: {name}
seed: 3
runs: 30
block: 10
scenario: {scenario}
filters:
  PF: {{kind: pf, N: 20}}
  Other: {{kind: {kind}, N: {N}}}
tables:
  rmse: {{kind: metrics, columns: {{Mean: mean(rmse)}}}}
"""
FILES = ("per_run.csv", "per_step.csv", "summary.csv", "tables/rmse.csv")


def write(folder: Path, name: str, kind: str = "apf", N: int = 10) -> Path:
    path = folder / f"{name}.yaml"
    path.write_text(CONFIG.format(name=name, scenario=merwe_text(T=20), kind=kind, N=N))
    return path


@pytest.fixture
def pair(tmp_path: Path) -> list[Path]:
    return [write(tmp_path, "one"), write(tmp_path, "two", N=30)]


def test_each_comes_out_as_if_run_alone(pair: list[Path], tmp_path: Path) -> None:
    options = api.Options(workers=2, quiet=True, fresh=True, formats=())
    together = list(api.run_all(pair, options, out=tmp_path / "together"))
    assert [r.folder.name for r in together] == ["one", "two"]
    for config, report in zip(pair, together, strict=True):
        alone = api.run(config, options, out=tmp_path / "alone" / config.stem)
        for name in FILES:
            assert (report.folder / name).read_bytes() == (alone.folder / name).read_bytes(), name
        assert not report.failed


@pytest.mark.usefixtures("no_report")
def test_what_they_share_is_computed_once(
    pair: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept: list[BlockTask] = []
    put = BlockStore.put
    monkeypatch.setattr(BlockStore, "put", lambda *args: (kept.append(args[1]), put(*args)))
    options = api.Options(engine="serial", quiet=True, fresh=True, formats=(), out=tmp_path / "out")
    reports = api.run_all(pair, options)
    next(reports)
    assert len(kept) == 6  # the first report does not wait for the second experiment
    next(reports)
    assert len(kept) == 9
    assert len({task.filter for task in kept}) == 3


def test_the_mistakes_of_all_at_once_and_nothing_runs(pair: list[Path], tmp_path: Path) -> None:
    for path, wrong in zip(pair, ("runs: 0", "seed: x"), strict=True):
        key = wrong.partition(":")[0]
        lines = path.read_text().splitlines()
        path.write_text("\n".join(wrong if line.startswith(f"{key}:") else line for line in lines))
    done = trackbench("run", "one.yaml", "two.yaml", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.splitlines() == [
        "one.yaml:4:7: runs: 0 is less than 1",
        "two.yaml:3:7: seed: 'x' is not a whole number",
    ]
    assert not (tmp_path / "results").exists()


@pytest.mark.usefixtures("no_report")
def test_stopping_early_ends_the_workers_and_nothing_else(pair: list[Path], tmp_path: Path) -> None:
    mine = multiprocessing.get_context("spawn").Process(target=time.sleep, args=(60,))
    mine.start()
    options = api.Options(workers=2, quiet=True, fresh=True, formats=(), out=tmp_path)
    reports = api.run_all(pair, options)
    next(reports)
    reports.close()
    mine.join(0.5)
    assert multiprocessing.active_children() == [mine]
    mine.kill()
    mine.join()


def test_two_of_one_name(tmp_path: Path) -> None:
    again = write(tmp_path, "again")
    again.write_text(again.read_text().replace("name: again", "name: one"))
    with pytest.raises(UserError, match=r"again\.yaml:2:7: name: another config .* results/one/"):
        next(api.run_all([write(tmp_path, "one"), again], quiet=True))


@pytest.mark.usefixtures("no_report")
def test_the_next_runs_when_a_filter_of_the_first_fails(tmp_path: Path) -> None:
    write(tmp_path, "two")
    (tmp_path / "plugin.py").write_text(
        "from dataclasses import dataclass\n"
        "from trackbench.filters.bootstrap_pf import PF\n"
        "from trackbench.registry import register\n\n\n"
        '@register("filters", "breaks")\n'
        "@dataclass(frozen=True, kw_only=True)\n"
        "class Breaks(PF):\n"
        '    """Breaks at its first step."""\n\n'
        "    def step(self, model, state, z, k, rng):\n"
        '        raise RuntimeError("broken")\n'
    )
    first = write(tmp_path, "one", kind="breaks")
    first.write_text(first.read_text() + "plugins: [plugin.py]\n")
    done = trackbench(
        "run", "one.yaml", "two.yaml", "--allow-plugins", "--format", "tex", cwd=tmp_path
    )
    assert done.returncode == 1, done.stderr
    # The filter begins at step 1, and any block may be first.
    said = r"Other failed: .*plugin\.py:12: RuntimeError: broken \(step 2, 2 s; runs "
    assert re.search(said, done.stderr), done.stderr
    assert done.stderr.splitlines()[-1].startswith("results in results/two/: ")
    labels = {line.split(",")[0] for line in _lines(tmp_path / "results/one/summary.csv")}
    assert labels == {"filter", "PF"}
    labels = {line.split(",")[0] for line in _lines(tmp_path / "results/two/summary.csv")}
    assert labels == {"filter", "PF", "Other"}


def test_blocks_that_fit_waste_no_run(tmp_path: Path) -> None:
    config = write(tmp_path, "one", N=2000)  # sixteen such clouds make a block
    options = api.Options(set=("block=fit",), runs=20)
    plan = make_plan(api.prepare(config, options))
    widths = {label: [task.width for task in tasks] for (_, label), tasks in plan.tasks.items()}
    assert widths == {"PF": [20], "Other": [10, 10]}
    assert all(task.runs_used == task.width for task in plan.unique)


def _lines(path: Path) -> list[str]:
    return path.read_text().splitlines()
