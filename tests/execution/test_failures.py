"""One filter that fails does not stop the others, and the table says what happened."""

import re
from concurrent.futures import ProcessPoolExecutor
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.commands import trackbench
from tests.papers import merwe_text
from trackbench.config.load import load
from trackbench.errors import UserError
from trackbench.execution.block_scheduler import Queue
from trackbench.execution.cache import BlockStore
from trackbench.execution.plan import make_plan

PLUGIN = """
from dataclasses import dataclass, replace

import numpy as np

from trackbench.filters.bootstrap_pf import PF
from trackbench.filters.baselines import PriorMean
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
scenario: MERWE
plugins: [bad.py]
filters:
  PF: {kind: pf, N: 20}
  Raises: {kind: raises}
  NaN: {kind: not-a-number}
  Far: {kind: far-away}
  UKF: {kind: ukf}
tables:
  t: {kind: metrics, columns: {RMSE: rms(rmse)}}
""".replace("MERWE", merwe_text(T=10))


@pytest.mark.parametrize("indices", [(0, 1, 2), (2, 1, 0), (1, 2, 0)])
def test_the_block_of_the_lowest_runs_is_reported(tmp_path: Path, indices: tuple[int, ...]) -> None:
    (tmp_path / "c.yaml").write_text(
        f"name: c\nruns: 30\nblock: 10\nscenario: {merwe_text(T=6)}\n"
        "filters: {PF: {kind: pf, N: 9}}\n"
    )
    tasks = make_plan(load(tmp_path / "c.yaml")).unique
    queue = Queue(2, BlockStore(tmp_path / "cache"))
    for i in indices:
        queue.give_up(tasks[i], ValueError(f"block {i}"))
    assert [*queue.failed.values()] == ["ValueError: block 0 (runs 0 to 9)"]


@pytest.mark.parametrize("engine", ["serial", "processes"])
def test_the_others_finish(tmp_path: Path, engine: str) -> None:
    (tmp_path / "bad.py").write_text(PLUGIN)
    (tmp_path / "c.yaml").write_text(CONFIG)
    done = trackbench(
        *("run", "c.yaml", "--allow-plugins", "--engine", engine, "--workers", "2", "--fresh"),
        *("--all", "--format", "markdown"),
        cwd=tmp_path,
    )
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    assert re.search(r"\| NaN +\| – \| unranked: loses more \| 20 of 20 \|", done.stdout)
    assert "| Raises | – | failed |" in done.stdout
    reason = "Raises failed: bad.py:16: ValueError: no fifth step (step 5, 5 s; runs 0 to 9)"
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


FAR = """
from dataclasses import dataclass

from trackbench.adapters import PerRun
from trackbench.filters.baselines import PriorMean
from trackbench.registry import register


@register("filters", "far")
@dataclass(frozen=True, kw_only=True)
class Far(PriorMean):
    limit: float = 0.0
    exits: bool = False

    def step(self, model, state, z, k, rng):
        if k == 5 and (z > self.limit).any():
            raise SystemExit if self.exits else ValueError("far")
        return super().step(model, state, z, k, rng)


class Own(PerRun, kind="own"):
    limit: float = 0.0

    def start(self, mean, cov):
        self.x, self.P = mean, cov

    def step(self, z, dt):
        if self.k == 5 and z[0] > self.limit:
            raise ValueError("far")
        return self.x, self.P
"""


def test_the_run_and_the_step_of_a_failure_are_named(tmp_path: Path) -> None:
    (tmp_path / "far.py").write_text(FAR)
    config = (
        "name: far\nruns: 20\nblock: 10\nscenario: MERWE\nplugins: [far.py]\nfilters:\n"
        "  One: {kind: far, limit: LIMIT}\n"
        "  Exits: {kind: far, limit: LIMIT, exits: true}\n"
        "  Several: {kind: far, limit: -1e9}\n"
        "  Own: {kind: own, limit: LIMIT}\n"
    ).replace("MERWE", merwe_text(T=10))
    path = tmp_path / "c.yaml"
    path.write_text(config.replace("LIMIT", "0"))
    blocks = {task.index: task for task in make_plan(load(path, allow_plugins=True)).unique}
    values = np.concatenate([blocks[i].data.measurements[0, 3] for i in (0, 1)])
    # Only the run with the largest measurement at step 5 fails; the first state is that of step 1.
    limit = np.sort(values)[-2]
    failed = values.argmax()
    path.write_text(config.replace("LIMIT", str(limit)))
    done = trackbench("run", "c.yaml", "--allow-plugins", "--fresh", cwd=tmp_path)
    place = f"(run {failed}, step 5, 5 s)"
    for line in (
        f"One failed: far.py:17: ValueError: far {place}",
        f"Exits failed: far.py:17: code of a plugin raised SystemExit() {place}",
        "Several failed: far.py:17: ValueError: far (step 5, 5 s; runs 0 to 9)",
        f"Own failed: far.py:29: ValueError: far {place}",
    ):
        assert f"error: {line}" in done.stderr


def test_an_error_that_is_its_own_cause_is_named(tmp_path: Path) -> None:
    raises = 'raise ValueError("no fifth step")'
    itself = 'error = ValueError("no fifth step")\n            raise error from error'
    (tmp_path / "bad.py").write_text(PLUGIN.replace(raises, itself))
    (tmp_path / "c.yaml").write_text(CONFIG)
    done = trackbench("run", "c.yaml", "--allow-plugins", "--only", "Raises", cwd=tmp_path)
    assert re.search(r"Raises failed: bad\.py:\d+: ValueError: no fifth step \(step 5", done.stderr)


def test_every_filter_fails_at_every_point_of_a_sweep(tmp_path: Path) -> None:
    (tmp_path / "bad.py").write_text(PLUGIN)
    (tmp_path / "c.yaml").write_text(CONFIG.replace("filters:", "only: [Raises]\nfilters:"))
    done = trackbench(
        *(
            "sweep",
            "c.yaml",
            "--allow-plugins",
            "--grid",
            "scenario.sensor.R=0.1,1",
            "--format",
            "svg",
        ),
        cwd=tmp_path,
    )
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    (header,) = (tmp_path / "results" / "failing-sweep" / "sweep.csv").read_text().splitlines()
    assert header.startswith("scenario.sensor.R,filter,metric")


LEAVING = """
from dataclasses import dataclass
from typing import Literal

from trackbench.filters.baselines import PriorMean
from trackbench.registry import register


class Own(BaseException):
    pass


ENDS = {"exit": SystemExit, "interrupt": KeyboardInterrupt, "close": GeneratorExit, "own": Own}


@register("filters", "leaves")
@dataclass(frozen=True, kw_only=True)
class Leaves(PriorMean):
    'Ends the program.'

    how: Literal["exit", "interrupt", "close", "own"] = "exit"
    'what is raised'
    where: str = "step"
    'the method that raises it'

    def __post_init__(self):
        self._leave("__post_init__")

    def init(self, model, prior, rng):
        self._leave("init")
        return super().init(model, prior, rng)

    def step(self, model, state, z, k, rng):
        self._leave("step")
        return super().step(model, state, z, k, rng)

    def estimate(self, state):
        self._leave("estimate")
        return super().estimate(state)

    def diagnostics(self, state):
        self._leave("diagnostics")
        return {}

    def _leave(self, where):
        if where == self.where:
            raise ENDS[self.how]()
"""
LEFT = """
name: left
runs: 20
block: 10
scenario: MERWE
plugins: [leaving.py]
filters:
  UKF: {kind: ukf}
  Exit: {kind: leaves}
  Init: {kind: leaves, where: init}
  Estimate: {kind: leaves, where: estimate}
  Notes: {kind: leaves, where: diagnostics}
  Interrupt: {kind: leaves, how: interrupt}
  Close: {kind: leaves, how: close}
  Own: {kind: leaves, how: own}
""".replace("MERWE", merwe_text(T=5))


@pytest.mark.parametrize("engine", ["serial", "processes"])
def test_a_filter_cannot_end_the_program(tmp_path: Path, engine: str) -> None:
    (tmp_path / "leaving.py").write_text(LEAVING)
    (tmp_path / "c.yaml").write_text(LEFT)
    done = trackbench(
        *("run", "c.yaml", "--allow-plugins", "--engine", engine, "--workers", "2", "--fresh"),
        cwd=tmp_path,
    )
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    errors = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    raised = dict.fromkeys(["Exit", "Init", "Estimate", "Notes"], "SystemExit")
    raised |= {"Interrupt": "KeyboardInterrupt", "Close": "GeneratorExit", "Own": "Own"}
    for label, name in raised.items():
        assert sum(f"error: {label} failed: " in e and f" {name}()" in e for e in errors) == 1
    assert len(errors) == len(raised)
    assert "UKF,mean(rmse)," in (tmp_path / "results" / "left" / "summary.csv").read_text()


def test_a_filter_that_ends_the_program_as_it_is_made_is_a_mistake(tmp_path: Path) -> None:
    (tmp_path / "leaving.py").write_text(LEAVING)
    (tmp_path / "c.yaml").write_text(LEFT.replace("where: init", "where: __post_init__"))
    with pytest.raises(UserError, match=r"leaving\.py:47: code of a .* raised SystemExit"):
        load(tmp_path / "c.yaml", allow_plugins=True)


def test_a_look_at_what_a_filter_notes_does_not_end_the_program(tmp_path: Path) -> None:
    (tmp_path / "leaving.py").write_text(LEAVING)
    (tmp_path / "c.yaml").write_text(LEFT + "medians: [mode]\n")
    load(tmp_path / "c.yaml", allow_plugins=True)


@pytest.mark.usefixtures("no_report")
@pytest.mark.parametrize("deaths", [1, 99])
def test_a_worker_that_dies_as_it_is_started(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, deaths: int
) -> None:
    """The pool hears the end of a file then, which is no Ctrl-D of the user's."""
    submit, tried = ProcessPoolExecutor.submit, count()

    def dying(self: ProcessPoolExecutor, *words: Any) -> Any:
        if next(tried) < deaths:
            raise EOFError("unexpected EOF")
        return submit(self, *words)

    monkeypatch.setattr(ProcessPoolExecutor, "submit", dying)
    monkeypatch.setenv("TRACKBENCH_CACHE", str(tmp_path / "cache"))
    text = CONFIG.replace("plugins: [bad.py]\n", "")
    bad = [line for line in text.splitlines() if any(b in line for b in ("Raises", "NaN", "Far"))]
    (tmp_path / "c.yaml").write_text(text.replace("\n".join(bad), ""))
    done = trackbench("run", "c.yaml", "--workers", "2", "--format", "svg", cwd=tmp_path)
    assert "Aborted" not in done.stderr
    assert "a worker died" in done.stderr
    assert done.returncode == (deaths > 1)
    given_up = "error: no worker process could be started (a worker died as it was started)\n"
    assert (given_up in done.stderr) == (deaths > 1)


def test_only_the_user_aborts(monkeypatch: pytest.MonkeyPatch) -> None:
    def ended(*_: object, **__: object) -> None:
        raise EOFError

    monkeypatch.setattr("trackbench.commands.read_and_rewrite_stored_results.plot", ended)
    with pytest.raises(RuntimeError, match="EOFError"):  # a mistake of ours, with its traceback
        trackbench("plot", "somewhere")
