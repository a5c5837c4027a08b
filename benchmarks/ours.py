"""Trackbench as an entrant: blocks computed as the runner computes them."""

import time
from math import ceil
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from benchmarks.harness import Entrant, Outcome, Skip
from trackbench.core.arrays import Array
from trackbench.evaluation.block_result import BlockResult
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.cached_filter_outputs import run_filter_cached
from trackbench.evaluation.run_blocks_side_by_side import run_block
from trackbench.evaluation.simulated_runs import simulate
from trackbench.execution.block_size import block_width
from trackbench.registry import kinds
from trackbench.scenarios.base import Simulation

SEED = 1
EXPERIMENTS = Path(__file__).parent.parent / "experiments"


def make(group: Any, kind: str, **keys: Any) -> Any:
    """A filter or scenario by its kind; skips the workload if this version does not have it."""
    cls = kinds(group).get(kind)
    if cls is None:
        raise Skip(f"no {group[:-1]} of kind {kind!r} in this version")
    return cls(**keys)


def scenario_file(name: str) -> Path:
    """The file of a shipped scenario."""
    (path,) = EXPERIMENTS.glob(f"*/scenarios/{name}.yaml")
    return path


def shipped(name: str, **keys: Any) -> Any:
    """A shipped scenario with other values for some keys; of old versions a kind."""
    if name in kinds("scenarios"):
        return make("scenarios", name, **{"T" if k == "last" else k: v for k, v in keys.items()})
    from trackbench.config.build_components import build_kind
    from trackbench.yaml_source import read

    source = read(scenario_file(name))
    source.data.update(keys)
    return build_kind("scenarios", source, ())


def with_assumptions(scenario: Any, motion: Any) -> tuple[Any, dict[str, Any]]:
    """The scenario as a filter sees it that assumes this motion, and the filter's keys for it."""
    try:
        from trackbench.models.assume import Assume
    except ImportError:  # old versions
        return scenario, {"motion": motion}
    return scenario.with_assumptions(Assume(motion=motion)), {}


def numbers(scenario: Any) -> SimpleNamespace:
    """The constants of van der Merwe's model, for peers that write it out themselves."""
    if not hasattr(scenario, "target"):
        return scenario
    motion, sensor, start = scenario.target.motion, scenario.sensor, scenario.target.launch
    return SimpleNamespace(**{**vars(motion), **vars(sensor)}, x1=start.x, steps=scenario.steps)


def data(scenario: Any, runs: int) -> Simulation:
    """The data that everybody gets."""
    return simulate(scenario, SEED, 0, runs)


def steps(scenario: Any) -> int:
    """Filter steps per run."""
    return len(scenario.steps) - 1


def ours(
    scenario: Any, tracker: Any, runs: int, whole: bool = False, width: int | None = None
) -> Entrant:
    """Return an entrant: the CPU time of the filter alone, or of the block with its metrics.

    The data are simulated beforehand in both cases. Every round runs the filter: the results that
    `passed` keeps of an earlier round are dropped first.
    """
    width = min(width or block_width(tracker, scenario), runs)
    blocks = ceil(runs / width)
    work = float(runs * tracker.particle_count * steps(scenario))

    def entrant() -> Outcome:
        seconds, found = 0.0, []
        for block in range(blocks):
            task = BlockTask(scenario, tracker, SEED, block, width, width, runs_with_tracks=runs)
            simulate(scenario.without_scoring, SEED, task.first_run, width)
            run_filter_cached.cache_clear()
            started = time.process_time()
            result = run_block(task)
            spent = time.process_time() - started
            seconds += spent if whole else result.cpu_s
            found.append(_mean(result))
        return Outcome(seconds, work, np.concatenate(found, axis=-1)[..., :runs])

    return entrant


def _mean(result: BlockResult) -> Array:
    assert result.tracks is not None
    return result.tracks.mean[:, 1:]
