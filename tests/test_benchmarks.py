"""The benchmark suite: every module is imported, every workload run at its least size."""

import importlib
import pkgutil
import subprocess
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

import benchmarks
from benchmarks import growth, parts, processes, runner_scale
from benchmarks.floors import floor
from benchmarks.harness import Workload, measure
from benchmarks.ours import data, make, ours, shipped
from benchmarks.report import head, section
from tests.commands import trackbench
from trackbench.evaluation import cached_filter_outputs

OWN = sorted(m.name for m in pkgutil.iter_modules(benchmarks.__path__) if m.name != "__main__")
PEERS = Path(benchmarks.__file__).parent / "peers"
LEAST: dict[str, dict[str, Any]] = {
    "w1_merwe": {"RUNS": 2, "MANY": 3, "SLOW": {10: 2, 100: 2, 1000: 2}},
    "w2_banana": {"RUNS": 2, "N": 20, "FEW": 2},
    "w2_workers": {"RUNS": 2},
    "w3_kalman": {"FEW": 1},
    "w4_upf": {"RUNS": 2, "FEW": 1},
    "w5_hdepf": {"RUNS": (2,), "FEW": 1, "G": 2},
    "w6_imm": {"RUNS": 2, "FEW": 1},
    "w7_process": {"RUNS": 2},
    "w8_startup": {},
    "w9_tables": {"FILTERS": 3},
    "w10_recordings": {"STEPS": 40},
    "w11_merge": {"RUNS": 2, "COMPUTED_RUNS": 2},
    "w12_enkf": {"RUNS": 2, "FEW": 1, "LAST": 3},
}
PROCESSES = ("w2_workers", "w7_process", "w8_startup", "w10_recordings")
TINY = """name: tiny
seed: 1
runs: 2
scenario:
  {kind: tracking, first: 1, last: 5, target: {kind: driven, motion: sine-gamma},
   sensor: square-then-line, start: known}
filters:
  PF: {kind: pf, N: 10}
tables: {t: {kind: metrics, columns: {RMSE: mean(rmse)}}}
figures: {figure2: {kind: rmse-vs-time}}
"""


def _least(name: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> ModuleType:
    module = importlib.import_module(f"benchmarks.{name}")
    for key, value in LEAST[name].items():
        monkeypatch.setattr(module, key, value)
    if name == "w2_workers":
        monkeypatch.setattr(
            module, "CONFIG", module.CONFIG.replace("N: 10000", "N: 20") + "figures: {}\n"
        )
    if name == "w8_startup":
        monkeypatch.setattr(module, "TINY", module.TINY + "figures: {}\n")
    if name == "w10_recordings":
        monkeypatch.setattr(
            module, "CONFIG", module.CONFIG.partition("figures:")[0] + "figures: {}\n"
        )
    if name == "w3_kalman":
        monkeypatch.setattr(module, "workloads", lambda: [module._workload(2)])
    if name == "w7_process":
        config = tmp_path / "tiny.yaml"
        config.write_text(TINY)
        monkeypatch.setattr(module, "CONFIG", str(config))
    return module


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of packages that peers import
@pytest.mark.parametrize("file", [*sorted(PEERS.glob("*_.py")), PEERS / "plain.py"])
def test_peers_are_imported_where_their_packages_are(file: Path) -> None:
    missing = ""
    try:
        importlib.import_module(f"benchmarks.peers.{file.stem}")
    except ImportError as error:
        missing = error.name or "?"
    assert not missing.startswith(("trackbench", "benchmarks", "?"))
    if missing:
        pytest.skip(f"{missing} is not installed")


def test_every_workload_has_a_least_size() -> None:
    assert set(LEAST) == {name for name in OWN if name[0] == "w"}


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.parametrize("name", sorted(set(LEAST) - set(PROCESSES)))
def test_workloads_run(name: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for work in _least(name, monkeypatch, tmp_path).workloads():
        for entrant in work.entrants.values():
            outcome = entrant()
            assert outcome.seconds > 0.0
            assert outcome.work > 0.0
            assert outcome.mean is None or np.isfinite(outcome.mean).all()


class _InThisProcess:
    """A command of trackbench that is run in this process, in place of a `Popen`."""

    def __init__(self, words: tuple[str, ...], cwd: Path, env: dict[str, str], **_: object) -> None:
        assert words[0] == processes.PROGRAM
        self.args = words
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("TRACKBENCH_CACHE", env["TRACKBENCH_CACHE"])
            self.result = trackbench(*words[1:], cwd=cwd)

    def wait(self) -> int:
        """Return the exit code."""
        return self.result.returncode


@pytest.mark.parametrize("name", PROCESSES)
def test_process_workloads_run(name: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The commands are run in this process, except for `trackbench --help` and Python alone."""

    def popen(words: tuple[str, ...], **keys: Any) -> Any:
        is_short = words[0] != processes.PROGRAM or "--help" in words
        return subprocess.Popen(words, **keys) if is_short else _InThisProcess(words, **keys)

    environment = processes.ENVIRONMENT | {"TRACKBENCH_CACHE": str(tmp_path / "cache")}
    monkeypatch.setattr(processes, "ENVIRONMENT", environment)
    monkeypatch.setattr(processes, "subprocess", SimpleNamespace(Popen=popen))
    for work in _least(name, monkeypatch, tmp_path).workloads():
        for entrant in work.entrants.values():
            assert entrant().seconds > 0.0


def test_all_programs_of_a_page_run(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    least = {"RUNS": (2,), "SIZES": (10,), "LENGTHS": (50,), "GENERATIONS": (2,)}
    for key, value in (least | {"KALMAN_RUNS": (2,), "MANY": 2, "ROUNDS": 1}).items():
        monkeypatch.setattr(growth, key, value)
    growth.main()
    monkeypatch.setattr(parts, "CASES", (("merwe", "pf", 10, 2), ("banana", "rpf", 10, 2)))
    parts.main()
    monkeypatch.setattr(runner_scale, "RUNS", (2,))
    runner_scale.main()
    assert "not run" not in capsys.readouterr().out


def test_every_round_runs_the_filter(monkeypatch: pytest.MonkeyPatch) -> None:
    filtered, estimate = [], cached_filter_outputs.run_filter
    monkeypatch.setattr(
        cached_filter_outputs,
        "run_filter",
        lambda *given: (filtered.append(1), estimate(*given))[1],
    )
    scenario, tracker = shipped("merwe"), make("filters", "pf", N=10)
    for whole in (False, True):
        entrant = ours(scenario, tracker, 3, whole=whole, width=3)
        filtered.clear()
        assert len({entrant().seconds for _ in range(4)}) > 1
        assert len(filtered) == 4


def test_bootstrap_filter_starts_as_its_peers() -> None:
    w2 = importlib.import_module("benchmarks.w2_banana")
    scenario = shipped("banana")
    seen, N = data(scenario, 2), 50
    state = w2._FromSamples(N=N).init(scenario.model, seen.prior, w2.block_stream(1, 0))
    start = seen.prior.sample(w2.block_stream(1, 0), N)
    np.testing.assert_array_equal(state.particles.x, start)
    np.testing.assert_allclose(state.particles.w, 1.0 / N)


def test_tables_of_a_workload() -> None:
    work = Workload("W0", "nothing but a floor", "particle-step", {"floor": floor(10, 2, 3)})
    assert "| floor |" in section(work, measure(work, 2))
    assert head(2).startswith("# Benchmark results")
