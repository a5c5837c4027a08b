"""Shared by every test: one way to run a filter on a scenario, and where the shipped files are."""

import gc
import os
import re
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer.main
from hypothesis import HealthCheck, settings

from tests.browser import browser
from trackbench import registry
from trackbench.config import shipped_experiments
from trackbench.config.experiment import Experiment
from trackbench.config.load import load
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.filter_output import FilterOutput
from trackbench.evaluation.run_blocks_side_by_side import run_block
from trackbench.evaluation.run_filter import run_filter
from trackbench.evaluation.simulated_runs import simulate
from trackbench.execution import block_key as blocks
from trackbench.field_types import hints_of
from trackbench.filters.base import AnyFilter
from trackbench.registry import kinds
from trackbench.results import manifest_facts
from trackbench.scenarios.base import Scenario

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
for _name in ("MAKEFLAGS", "MFLAGS"):
    # `make -j` names pipes that pytest's workers do not have, of which a compiler complains.
    os.environ.pop(_name, None)


# No test depends on how busy the machine is.
settings.register_profile("any speed", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("any speed")

__all__ = ["browser"]
ROOT = Path(__file__).parent.parent
EXPERIMENTS = ROOT / "experiments"
EXPERIMENT_FILES = shipped_experiments.files()
"""The shipped experiments' files by name."""
PLANE = """scenario:
  kind: tracking
  last: 8
  target: {kind: driven, motion: {kind: cv, q: 1}, launch: {x: 10, vx: 1}}
  sensor: {kind: position, sigma: 2}
  start: {kind: gaussian, sigma: [2, 1, 2, 1]}
"""
"""Of a config: a target in the plane that is seen eight times."""

Track = Callable[..., FilterOutput]


SLOW = 0.2
"""s, of all cases of a test together"""
_DURATIONS = "trackbench/durations"
_durations: Counter[str] = Counter()


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add ``--fast``, which `make test-fast` gives."""
    parser.addoption("--fast", action="store_true", help=f"tests that last took up to {SLOW} s")


def pytest_sessionstart() -> None:
    """Collect no garbage while the tests are collected, which makes little of it."""
    gc.disable()


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """Collect garbage again once the tests are collected."""
    try:
        return (yield)
    finally:
        gc.enable()


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Run the files of tests/ first, then large files; with ``--fast``, leave out slow tests.

    These files take longest: a long file at the end would leave the other processors idle.
    """
    sizes = {path: path.stat().st_size for path in {item.path for item in items}}
    items.sort(key=lambda item: (len(item.path.parts), -sizes[item.path]))
    if not config.getoption("--fast"):
        return
    assert config.cache is not None
    durations = config.cache.get(_DURATIONS, {})
    slow = [i for i in items if durations.get(i.nodeid.partition("[")[0], 0.0) > SLOW]
    config.hook.pytest_deselected(items=slow)
    items[:] = [item for item in items if item not in slow]


def pytest_collection_finish() -> None:
    """Leave what exists before the first test out of garbage collection: an eighth of all CPU time."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(50_000)


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Add up a test's duration: its cases and what they set up."""
    _durations[report.nodeid.partition("[")[0]] += report.duration


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Keep the durations for the next ``--fast``, in pytest's own cache."""
    cache = getattr(session.config, "cache", None)
    if cache is not None and not hasattr(session.config, "workerinput"):
        cache.set(_DURATIONS, cache.get(_DURATIONS, {}) | dict(_durations))


@cache
def shipped(name: str) -> Experiment:
    """A shipped experiment, read once."""
    return load(EXPERIMENT_FILES[name])


def make_filter(kind: str, preset: str | None = None, **keys: Any) -> AnyFilter:
    """A filter by its kind, as a config would make it."""
    cls = kinds("filters")[kind]
    given = {**cls.presets[preset], **keys} if preset else keys
    hints = hints_of(cls)
    return cls(**{k: hints[k](**v) if isinstance(v, dict) else v for k, v in given.items()})


def track(
    scenario: Scenario, tracker: AnyFilter, runs: int, seed: int = 1, **keys: Any
) -> FilterOutput:
    """Estimates of every step of so many runs."""
    covariances = keys.pop("covariances", 0)
    task = BlockTask(scenario, tracker, seed, index=0, width=runs, runs_used=runs, **keys)
    with np.errstate(all="ignore"):
        return run_filter(task, simulate(scenario, seed, 0, runs), covariances)


def per_run(
    scenario: Scenario, tracker: AnyFilter, runs: int, metric: str = "rmse", seed: int = 1
) -> np.ndarray:
    """A metric per run (M,)."""
    task = BlockTask(scenario, tracker, seed, index=0, width=runs, runs_used=runs)
    return run_block(task).per_run[metric]


@contextmanager
def plugins_forgotten() -> Iterator[None]:
    """What is loaded of one's own code ends with this."""
    before = set(sys.modules)
    yield
    for name in [n for n in sys.modules if n not in before and registry.registered(n)]:
        registry.unregister(name)
        del sys.modules[name]


@pytest.fixture(autouse=True, scope="module")
def _own_plugins() -> Iterator[None]:
    """No test finds kinds that those of another file registered."""
    with plugins_forgotten():
        yield


@pytest.fixture(autouse=True, scope="session")
def _own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """No test finds blocks that an earlier session kept."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TRACKBENCH_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(autouse=True, scope="session")
def _no_fsync() -> Iterator[None]:
    """Leave files to the system's cache: no test cuts the power, and each fsync takes milliseconds."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", lambda descriptor: None)
        yield


_folder_numbers = count()


@pytest.fixture
def tmp_path(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A new folder, as pytest's own fixture makes it but without a link to the last one of its name."""
    name = re.sub(r"\W", "_", request.node.name)[:30]
    return tmp_path_factory.mktemp(f"{name}{next(_folder_numbers)}", numbered=False)


@pytest.fixture(autouse=True, scope="session")
def _commit_read_once() -> Iterator[None]:
    """Start git once a session, not for each manifest: no test adds a commit to this repository."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(manifest_facts, "commit_of_source", cache(manifest_facts.commit_of_source))
        yield


@pytest.fixture(autouse=True, scope="session")
def _commands_read_once() -> Iterator[None]:
    """Let typer read the signatures of the commands once a session, not at each call of the CLI."""
    name = "get_command_from_info"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(typer.main, name, cache(getattr(typer.main, name)))
        yield


def forget_facts() -> None:
    """Compute the keys of blocks anew, as after the machine's arithmetic was patched."""
    blocks._facts_of.cache_clear()
    blocks._digests.clear()


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.Generator(np.random.SFC64(20260101))


def random_covariance(rng: np.random.Generator, n: int, *batch: int) -> np.ndarray:
    """Random symmetric positive definite matrices (n, n, *batch)."""
    A = rng.standard_normal((n, n + 2, *batch))
    return np.einsum("ik...,jk...->ij...", A, A)


@pytest.fixture
def no_report(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave out the tables, figures and page of each run, which take more than half of its time."""
    from trackbench.commands import run_experiment
    from trackbench.report.verdicts.all_verdicts import Verdicts

    monkeypatch.setattr(run_experiment, "render", lambda *_: ({}, Verdicts([], [], [])))
    monkeypatch.setattr(run_experiment, "write_report", lambda *_: None)
