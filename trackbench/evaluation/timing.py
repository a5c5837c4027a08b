"""CPU times of filters, measured side by side, and the operations that a run of each takes.

The time of one pass says little: minutes later, or on another machine, the ratio of two filters' times
differs by up to a factor of 2. So all filters of an experiment are timed in turns (A B C, C B A, ...),
in many short repeats. A repeat steps a filter from a few states of its first block, which is as wide as
the runner computes it. One pass through the block gives these states, and what part of a run's time
each step is: a maneuver counts as often as it occurs. Where a whole pass would take too long, the
operations of every step, counted over one run, give the parts: the first steps may have more particles.
"""

import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from copy import deepcopy
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from trackbench.core.arrays import Array, counting, freeze
from trackbench.core.random_streams import block_stream
from trackbench.evaluation.block import BlockTask, simulate
from trackbench.evaluation.run_block import keep_freed_memory
from trackbench.evaluation.run_filter import prior_of

REPEATS = 30
_KEPT = 6
"""Steps whose states are kept, spread over the run."""
_EARLY = 2
"""Number of one more, for a filter whose pass through the block is cut short."""
_AGAIN = 3
"""How often such a step is timed in the pass, and how often a quick pass is made: the least counts."""
_REPEAT_S, _PASS_S = 0.005, 1.0
"""CPU seconds of a repeat, but for at least one step, and of the pass."""
_LEAST = 1e-7
"""Seconds of a step, or its part of a run, at the least: a clock may have seen nothing."""
_COUNTED = 2000
"""Steps in which operations are counted, at most."""
# Where the CPU clock is coarse (Windows: 16 ms), short repeats need the wall clock.
_coarse = time.get_clock_info("process_time").resolution > 1e-4
_clock = time.perf_counter if _coarse else time.process_time


class Measured(NamedTuple):
    """CPU seconds of a run, one of each repeat, and operations per run and step.

    They are None for a filter that uses no kernel which notes them.
    """

    seconds: list[float]
    likelihoods: float | None
    covariances: float | None


Guard: TypeAlias = Callable[[], AbstractContextManager[None]]
"""Opens what code that is not the package's own is run in."""


def measure(tasks: Sequence[BlockTask], guard: Guard = nullcontext) -> list[Measured | Exception]:
    """Time filters over their blocks, in turns; return times, or the exception of a filter."""
    keep_freed_memory()
    found = [_tried(guard, _Sample, task) for task in tasks]
    for repeat in range(REPEATS):
        # A B C, then C B A
        for i in range(len(tasks))[:: -1 if repeat % 2 else 1]:
            if isinstance(sample := found[i], _Sample):
                found[i] = _tried(guard, sample.repeated)
    simulate.cache_clear()  # a plugin may have written to the data
    return [s if isinstance(s, Exception) else s.measured() for s in found]


def _tried(guard: Guard, function: Any, *arguments: Any) -> Any:
    try:
        with guard(), np.errstate(all="ignore"):
            return function(*arguments)
    except Exception as error:
        return error


class _Step(NamedTuple):
    """A state, the number of the measurement that follows it, and the step's share of a run."""

    state: Any
    i: int
    share: float


class _Sample:
    """A filter at some steps of its block, to be taken again and again."""

    def __init__(self, task: BlockTask) -> None:
        self._task, self._model = task, freeze(task.assumed_scenario.model)
        self._data, self._steps = task.data, task.scenario.steps[1:].tolist()
        self._operations = operations(task)
        kept, each = self._passed()
        # A repeat takes about _REPEAT_S: a group of kept steps, stepped in as many rounds as fit.
        at_once = min(len(kept), max(1, int(_REPEAT_S / each)))
        self._groups = [kept[i : i + at_once] for i in range(0, len(kept), at_once)]
        self._rounds = max(1, int(_REPEAT_S / (each * at_once)))
        self._seconds: list[float] = []

    def _passed(self) -> tuple[list[_Step], float]:
        """Run the block, a quick one again; return the recorded steps and CPU seconds per step."""
        T, spent = len(self._steps), np.empty(0)
        # The least of several times of a step is the one that was disturbed least.
        for _ in range(_AGAIN):
            kept, seconds = self._through_block()
            spent = np.minimum(seconds, spent) if len(spent) == len(seconds) else seconds
            if spent.sum() > _PASS_S / 10.0:
                break
        # Each step's share of a run: as measured in a whole pass, else by its operations.
        whole = len(spent) == T and spent.all()
        shares = spent / spent.sum() if whole else _shares(self._operations, T)
        steps = [_Step(state, i, float(shares[i])) for i, state in kept.items()]
        return steps, max(float(spent.mean()), _LEAST)

    def _through_block(self) -> tuple[dict[int, Any], Array]:
        """Step through the block, or its beginning; the kept states, and each step's CPU seconds."""
        task, T = self._task, len(self._steps)
        rng, kept, spent = block_stream(task.seed, 0), {}, np.zeros(T)
        # Keep an early step and the middles of _KEPT equal parts of the block.
        wanted = {min(_EARLY, T - 1), *((2 * j + 1) * T // (2 * _KEPT) for j in range(_KEPT))}
        # Time each step, the kept ones several times; stop once the pass takes too long.
        state = task.filter.init(self._model, prior_of(self._data, self._model), rng)
        for i in range(T):
            again = []
            if i in wanted:
                kept[i] = self._copy(state)
                again = [self._timed(self._copy(state), i, rng)[0] for _ in range(_AGAIN - 1)]
            seconds, state = self._timed(state, i, rng)
            spent[i] = min(seconds, *again, seconds)
            if kept and spent.sum() > _PASS_S:
                break
        return kept, spent[: i + 1]

    def _timed(self, state: Any, i: int, rng: Any) -> tuple[float, Any]:
        started = _clock()
        state = self._stepped(state, i, rng)
        return _clock() - started, state

    def _stepped(self, state: Any, i: int, rng: Any) -> Any:
        tracker, z = self._task.filter, self._data.measurements[:, i]
        state = tracker.step(self._model, state, z, self._steps[i], rng)
        tracker.estimate(state)
        return state

    def _copy(self, state: Any) -> Any:
        """Return the state as it is now: objects of one run change with each step."""
        if not self._task.filter.loops_over_runs:
            return state
        return deepcopy(state, {id(self._model): self._model})

    def repeated(self) -> "_Sample":
        """Time a group of steps once more: as many as fit, and the next ones the next time."""
        rng, group = (
            block_stream(self._task.seed, 0),
            self._groups[len(self._seconds) % len(self._groups)],
        )
        # Copies of the states come first, so that only the steps are timed.
        steps = [(self._copy(step.state), step.i) for _ in range(self._rounds) for step in group]
        started = _clock()
        for state, i in steps:
            self._stepped(state, i, rng)
        self._seconds.append((_clock() - started) / (self._rounds * self._task.width))
        return self

    def measured(self) -> Measured:
        """Return each repeat as a run's time, and the mean operations of a step.

        A repeat stands for all groups by how far it is from the median of its own: one group may
        resample and another not.
        """
        # Repeats go round the groups: own (groups,) is each group's median.
        turns = np.arange(len(self._seconds)) % len(self._groups)
        own = np.array([np.median(np.array(self._seconds)[turns == g]) for g in set(turns)])
        # Seconds of a run = seconds of all groups over the groups' share in a run.
        of_run = own.sum() / sum(step.share for group in self._groups for step in group)
        seconds = of_run * np.array(self._seconds) / np.maximum(own, _LEAST**2)[turns]
        # Mean operations of a step; a filter that notes none has none.
        likelihoods, covariances = self._operations.mean(axis=1).tolist()
        hidden = not self._operations.any()
        noted = (None, None) if hidden else (likelihoods, covariances)
        return Measured(seconds.tolist(), *noted)


def _shares(counts: Array, T: int) -> Array:
    """Return the share (T,) of each step in a run's time by its operations (2, steps)."""
    shares, of_step = np.full(T, 1.0 / T), counts.sum(axis=0)
    if of_step.all():
        shares[: len(of_step)] *= of_step / of_step.mean()
    return shares


def operations(task: BlockTask) -> Array:
    """Return likelihoods and covariance updates (2, steps) of one run: the same on every machine."""
    tracker, model = task.filter, freeze(task.assumed_scenario.model)
    data = simulate(task.scenario.without_scoring, task.seed, 0, 1)
    rng, found = block_stream(task.seed, 0), []
    state = tracker.init(model, prior_of(data, model), rng)
    # Count the operations of the first steps of one run.
    for i, k in enumerate(task.scenario.steps[1 : _COUNTED + 1].tolist()):
        with counting() as counts:
            state = tracker.step(model, state, data.measurements[:, i], k, rng)
        found.append([counts["likelihoods"], counts["covariances"]])
    return np.array(found, dtype=np.float64).T
