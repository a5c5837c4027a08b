"""CPU times of filters, measured side by side, and the operations that a run of each takes.

The time of one pass says little: minutes later, or on another machine, the ratio of two filters' times
differs by up to a factor of 2. So each filter passes through its first block, which is as wide as the
runner computes it, and then all filters of an experiment repeat some of its steps in turns (A B C,
C B A, ...). A run's time is that of the pass, times how much longer the steps take in the turns. Where a
whole pass would take too long, the operations of every step, counted over one run, extrapolate: the
first steps may have more particles.
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
from trackbench.evaluation.late_measurements import deliveries
from trackbench.evaluation.run_block import keep_freed_memory
from trackbench.evaluation.run_filter import prior_of

REPEATS = 15
_KEPT, _EARLY = 5, 2
"""How many steps are repeated, spread over the run, and the number of the first of them."""
_REPEAT_S, _QUICK_S, _PASS_S = 0.003, 0.1, 0.5
"""CPU seconds of a repeat, of a pass that is made twice, and of one that is cut short."""
_LEAST = 1e-7
"""Least seconds of a step: a coarse clock may show none."""
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


def measure(
    tasks: Sequence[BlockTask],
    guard: Guard = nullcontext,
    tick: Callable[[], object] = lambda: None,
) -> list[Measured | Exception]:
    """Time filters over their blocks, in turns; return times, or the exception of a filter.

    ``tick`` is called after each filter's pass and after each of the `REPEATS` turns.
    """
    keep_freed_memory()
    # A program outside of Python is not stopped and repeated: its blocks have its times.
    passes: list[_Pass | Measured | Exception] = []
    for task in tasks:
        is_program = task.filter.runs_program
        passes.append(Measured([], None, None) if is_program else _tried(guard, _Pass, task))
        tick()
    for repeat in range(REPEATS):
        # A B C, then C B A
        for i in range(len(tasks))[:: -1 if repeat % 2 else 1]:
            if isinstance(one := passes[i], _Pass):
                passes[i] = _tried(guard, one.repeated)
        tick()
    simulate.cache_clear()  # a plugin may have written to the data
    return [p.measured() if isinstance(p, _Pass) else p for p in passes]


def _tried(guard: Guard, function: Any, *arguments: Any) -> Any:
    try:
        with guard(), np.errstate(all="ignore"):
            return function(*arguments)
    except Exception as error:
        return error


class _Pass:
    """A filter's pass through its block, with the states before the steps that are repeated."""

    def __init__(self, task: BlockTask) -> None:
        self._task, self._model = task, freeze(task.assumed_scenario.model)
        self._data, self._steps = task.data, task.scenario.steps[1:].tolist()
        self._operations = operations(task)
        # A filter that goes back for a late measurement makes some steps more than once.
        delivered = deliveries(task, self._data)
        self._repeats = 1.0 if delivered is None else delivered.steps_per_step
        if delivered is not None:
            given = delivered.given(self._data.measurements)
            self._data = self._data._replace(measurements=given)
        self._kept: dict[int, Any] = {}
        self._spent = self._passed()
        if self._spent.sum() < _QUICK_S:
            # Of two times of a step, the one that was disturbed less. The second pass may be cut.
            again = self._passed()
            self._spent[: len(again)] = np.minimum(self._spent[: len(again)], again)
        self._seconds: list[float] = []

    def _passed(self) -> Array:
        """Step through the block, or its beginning; return each step's CPU seconds."""
        T, rng = len(self._steps), block_stream(self._task.seed, 0)
        wanted = {min(max(_EARLY, j * T // _KEPT), T - 1) for j in range(_KEPT)}
        spent: list[float] = []
        state = self._task.filter.init(self._model, prior_of(self._data, self._model), rng)
        while len(spent) < T and not (self._kept and sum(spent) > _PASS_S):
            i = len(spent)
            if i in wanted:
                self._kept[i] = self._copy(state)
            started = _clock()
            state = self._stepped(state, i, rng)
            spent.append(_clock() - started)
        return np.maximum(spent, _LEAST)

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

    def repeated(self) -> "_Pass":
        """Time one of the steps, several times if it is short; the next one in the next turn."""
        i, state = [*self._kept.items()][len(self._seconds) % len(self._kept)]
        rng, number = block_stream(self._task.seed, 0), int(_REPEAT_S / self._spent[i]) + 1
        # Copies of the state come first, so that only the steps are timed.
        states = [self._copy(state) for _ in range(number)]
        started = _clock()
        for state in states:
            self._stepped(state, i, rng)
        self._seconds.append((_clock() - started) / number)
        return self

    def measured(self) -> Measured:
        """Return each repeat as a run's time, and the mean operations of a step.

        A repeat stands for all steps by how far it is from the median of its own.
        """
        turns, seconds = np.arange(len(self._seconds)) % len(self._kept), np.array(self._seconds)
        medians = np.array([np.median(seconds[turns == j]) for j in range(turns.max() + 1)])
        # Seconds of the block = those of the pass, slower or faster as its repeated steps.
        passed = self._spent[[*self._kept][: len(medians)]]
        of_block = self._spent.sum() * medians.sum() / passed.sum()
        of_block /= _weights(self._operations, len(self._steps))[: len(self._spent)].sum()
        of_block *= self._repeats
        of_run = of_block / self._task.width * seconds / np.maximum(medians, _LEAST**2)[turns]
        # Mean operations of a step; a filter that notes none has none.
        likelihoods, covariances = (self._repeats * self._operations.mean(axis=1)).tolist()
        hidden = not self._operations.any()
        noted = (None, None) if hidden else (likelihoods, covariances)
        return Measured(of_run.tolist(), *noted)


def _weights(counts: Array, T: int) -> Array:
    """Return the share (T,) of each step in a run's work by its operations (2, steps)."""
    weights, of_step = np.full(T, 1.0 / T), counts.sum(axis=0)
    if of_step.all():
        weights[: len(of_step)] *= of_step / of_step.mean()
    return weights


def operations(task: BlockTask) -> Array:
    """Return likelihoods and covariance updates (2, steps) of one run: the same on every machine."""
    tracker, model = task.filter, freeze(task.assumed_scenario.model)
    data = simulate(task.scenario.without_scoring, task.seed, 0, 1)
    rng, numbers = block_stream(task.seed, 0), []
    state = tracker.init(model, prior_of(data, model), rng)
    # Count the operations of the first steps of one run.
    for i, k in enumerate(task.scenario.steps[1 : _COUNTED + 1].tolist()):
        with counting() as counts:
            state = tracker.step(model, state, data.measurements[:, i], k, rng)
        numbers.append([counts["likelihoods"], counts["covariances"]])
    return np.array(numbers, dtype=np.float64).T
