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
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.random_streams import block_stream
from trackbench.core.read_only import freeze
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.deliver_late_measurements import deliveries
from trackbench.evaluation.freed_memory import keep_freed_memory
from trackbench.evaluation.operation_counts import operations, shares_of_steps
from trackbench.evaluation.refilter_late_measurements import steps_per_step
from trackbench.evaluation.run_filter import prior_of
from trackbench.evaluation.simulated_runs import simulate
from trackbench.evaluation.state_copies import make_state_copier

REPEATS = 15
_REPEATED_STEPS = 5
"""Number of steps that are repeated, spread over the run."""
_FIRST_REPEATED = 2
"""Index of the first of these steps."""
_REPEAT_S = 0.003
"""CPU seconds of a repeat."""
_LONGEST_REPEAT_S = 0.03
"""Wall seconds of a repeat, at most: a coarse CPU clock may show no time for a long step."""
_QUICK_S = 0.1
"""CPU seconds of a pass, below which it is made twice."""
_PASS_S = 0.5
"""CPU seconds after which a pass is cut short."""
_LEAST = 1e-7
"""Least seconds of a step: a coarse clock may show none."""


# Where the CPU clock is coarse (Windows: 16 ms), short repeats need the wall clock.
_coarse = time.get_clock_info("process_time").resolution > 1e-4
_clock = time.perf_counter if _coarse else time.process_time


class Measured(NamedTuple):
    """CPU seconds of a run, one of each repeat, and operations per run and step."""

    seconds: list[float]
    likelihoods: float | None
    """likelihoods per run and step; None if the filter uses no kernel that counts them"""
    covariances: float | None
    """covariance updates per run and step; None if the filter uses no kernel that counts them"""


Guard: TypeAlias = Callable[[], AbstractContextManager[None]]
"""Opens the context in which a plugin's code runs."""


def measure(
    tasks: Sequence[BlockTask],
    guard: Guard = nullcontext,
    tick: Callable[[], object] = lambda: None,
) -> list[Measured | Exception]:
    """Time filters over their blocks, in turns.

    Parameters
    ----------
    tasks
        task of each filter
    guard
        function that opens the context in which a filter runs, as it may be a plugin's
    tick
        function that is called after each filter's first pass through its block and after each of the
        `REPEATS` turns, to show the progress

    Returns
    -------
    list of Measured or Exception
        CPU seconds of a run of each filter, or the exception that it raised
    """
    keep_freed_memory()
    passes: list[_Pass | Measured | Exception] = []
    for task in tasks:
        if task.filter.runs_program:
            # A program outside of Python is not stopped and repeated: its blocks have its times. Nor are
            # its likelihoods and covariance updates counted.
            passes.append(Measured(seconds=[], likelihoods=None, covariances=None))
        else:
            passes.append(_call_guarded(guard, _Pass, task))
        tick()
    for repeat in range(REPEATS):
        # A B C, then C B A: a machine that becomes slower in a turn slows no filter down more than
        # others.
        turn = list(range(len(tasks)))
        if repeat % 2:
            turn.reverse()
        for i in turn:
            filter_pass = passes[i]
            if isinstance(filter_pass, _Pass):
                passes[i] = _call_guarded(guard, filter_pass.time_repeat)
        tick()
    simulate.cache_clear()  # a plugin may have written to the data
    times = []
    for filter_pass in passes:
        times.append(filter_pass.measured() if isinstance(filter_pass, _Pass) else filter_pass)
    return times


def _call_guarded(guard: Guard, function: Any, *arguments: Any) -> Any:
    """Return the function's result, or its exception; it runs in the context that ``guard`` opens."""
    try:
        with guard(), np.errstate(all="ignore"):
            return function(*arguments)
    except Exception as error:
        return error


class _Pass:
    """A filter's pass through its block, with the states before the steps that are repeated."""

    def __init__(self, task: BlockTask) -> None:
        """Simulate the block and step the filter through it: once, or twice if it is short.

        The passes measure the time of each step. They also store the states from which `time_repeat`
        repeats steps.
        """
        self._task = task
        self._model = freeze(task.assumed_scenario.model)
        self._copy_state = make_state_copier(task.filter, self._model)
        self._data = task.data
        self._steps = task.scenario.steps[1:].tolist()  # without that of the prior
        # Numbers of likelihoods and of covariance updates (2, steps) of one run.
        self._operations = operations(task)
        # A filter that goes back for a late measurement makes some steps more than once.
        self._steps_per_step = 1.0
        delivered = deliveries(task, self._data)
        if delivered is not None:
            self._steps_per_step = steps_per_step(delivered)
            # A late measurement stands at the step at which the filter gets it.
            given = delivered.given(self._data.measurements)
            self._data = self._data._replace(measurements=given)
        self._states: dict[int, Any] = {}
        """state before each step that is repeated"""
        self._wall_seconds: dict[int, float] = {}
        """wall seconds of each step that is repeated, in the last pass"""
        self._spent = self._time_steps()
        """CPU seconds of each step"""
        if self._spent.sum() < _QUICK_S:
            # Of two times of a step take the smaller one, which was disturbed less. The second pass may
            # take longer than `_PASS_S`: it ends then, and has the times of the first steps only.
            again = self._time_steps()
            self._spent[: len(again)] = np.minimum(self._spent[: len(again)], again)
        self._seconds: list[float] = []
        """CPU seconds of a step, by each repeat"""

    def _time_steps(self) -> Array:
        """Step through the block, or its beginning; return the CPU seconds (steps,) of each step.

        Store the states before the steps that are repeated, and the wall seconds of these steps.
        """
        T = len(self._steps)
        rng = block_stream(self._task.seed, 0)
        # Steps spread over the run, but not the very first ones.
        evenly_spaced = [j * T // _REPEATED_STEPS for j in range(_REPEATED_STEPS)]
        repeated = {min(max(_FIRST_REPEATED, i), T - 1) for i in evenly_spaced}
        spent: list[float] = []
        state = self._task.filter.init(self._model, prior_of(self._data, self._model), rng)
        # A pass that takes longer than `_PASS_S` ends once there is a state to repeat a step from.
        while len(spent) < T and not (self._states and sum(spent) > _PASS_S):
            i = len(spent)
            if i in repeated:
                self._states[i] = self._copy_state(state)
            wall_started = time.perf_counter()
            started = _clock()
            state = self._step(state, i, rng)
            spent.append(_clock() - started)
            if i in repeated:
                self._wall_seconds[i] = time.perf_counter() - wall_started
        return np.maximum(spent, _LEAST)

    def _step(self, state: Any, i: int, rng: Any) -> Any:
        """Make the step of measurement i and its estimate; return the state after it."""
        tracker = self._task.filter
        z = self._data.measurements[:, i]
        state = tracker.step(self._model, state, z, self._steps[i], rng)
        tracker.estimate(state)
        return state

    def time_repeat(self) -> "_Pass":
        """Repeat one of the stored steps and add its CPU seconds; return the pass.

        A short step is made several times, and its mean time counts. The next call takes the next of the
        stored steps.
        """
        stored = list(self._states.items())
        i, state = stored[len(self._seconds) % len(stored)]
        rng = block_stream(self._task.seed, 0)
        wall_seconds = max(self._wall_seconds[i], _LEAST)
        # Repeat a short step so often that a repeat takes about `_REPEAT_S` of CPU time, for a precise
        # time. `_spent` has the CPU seconds of each step in the pass, at least `_LEAST`. Where the CPU
        # clock is coarse, they may be far too small: the wall time limits the repeat then.
        number = 1 + min(int(_REPEAT_S / self._spent[i]), int(_LONGEST_REPEAT_S / wall_seconds))
        # Copies of the state come first, so that only the steps are timed.
        states = [self._copy_state(state) for _ in range(number)]
        started = _clock()
        for copied in states:
            self._step(copied, i, rng)
        self._seconds.append((_clock() - started) / number)
        return self

    def measured(self) -> Measured:
        """Return each repeat as a run's time, and the mean operations of a step.

        A repeat stands for all steps: its time over the median time of its step is how much slower the
        whole run is.
        """
        seconds = np.array(self._seconds)
        # Index of the repeated step of each repeat: the steps take turns.
        turns = np.arange(len(seconds)) % len(self._states)
        medians = np.array([np.median(seconds[turns == j]) for j in range(turns.max() + 1)])
        # Seconds of the block = those of the pass, slower or faster as its repeated steps. With fewer
        # repeats than stored steps only the first steps have a median.
        repeated_steps = list(self._states)[: len(medians)]
        in_pass = self._spent[repeated_steps]
        pass_seconds = self._spent.sum() * medians.sum() / in_pass.sum()
        # A pass that was cut short is extrapolated by the operations of the other steps. A filter that
        # goes back for late measurements makes `_steps_per_step` steps for each of a run. A weight is
        # the share of a step in the work of a whole run.
        weights = shares_of_steps(self._operations, len(self._steps))
        block_seconds = pass_seconds / weights[: len(self._spent)].sum() * self._steps_per_step
        # A coarse clock may show no time at all: nothing is divided by zero. The square of the least
        # time of a step is far below any mean time of a repeat, so that it changes no other quotient.
        median_of_repeat = np.maximum(medians, _LEAST**2)[turns]
        run_seconds = block_seconds / self._task.width * seconds / median_of_repeat
        if not self._operations.any():
            return Measured(run_seconds.tolist(), likelihoods=None, covariances=None)
        # Mean operations of a step.
        means = self._steps_per_step * self._operations.mean(axis=1)
        likelihoods, covariances = means.tolist()
        return Measured(run_seconds.tolist(), likelihoods=likelihoods, covariances=covariances)
