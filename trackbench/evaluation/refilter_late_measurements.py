"""Repeat the steps of a filter when a measurement arrives late: the states that it goes back to."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager
from typing import Any

import numpy as np
from numpy.random import Generator

from trackbench.core.arrays import Array, Index
from trackbench.core.random_streams import position_of, put_back
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.deliver_late_measurements import Deliveries
from trackbench.evaluation.state_copies import make_state_copier
from trackbench.filters.base import filter_many
from trackbench.models.base import Model


def first_repeated(delivered: Deliveries) -> Index:
    """Return the first step that a filter repeats at each step.

    A filter that goes back repeats the steps from the earliest measurement that has just arrived.

    Parameters
    ----------
    delivered
        delivery of the measurements

    Returns
    -------
    array (T, M)
        index of the first repeated step of each run; the step itself if none is repeated
    """
    T, runs = delivered.learned.shape[1:]
    first = np.repeat(np.arange(T)[:, None], runs, axis=1)
    late = delivered.arriving_late()
    _, due, run = late
    # At the step of its arrival a filter goes back to the step of the measurement.
    np.minimum.at(first, (delivered.learned[late], run), due)
    return first


def steps_per_step(delivered: Deliveries) -> float:
    """Return the mean number of filter steps per step of a run by itself, the repeated ones included.

    It gives the CPU time and the operations of a run that is filtered alone. In a block all runs go back
    together, and repeat more steps.

    Parameters
    ----------
    delivered
        delivery of the measurements

    Returns
    -------
    float
        number of steps, 1 if no step is repeated
    """
    if not delivered.refilters:
        return 1.0
    first = first_repeated(delivered)  # (T, M): the step itself if none is repeated
    # At step i the filter repeats the steps first to i - 1, before it makes step i.
    repeated = np.arange(len(first))[:, None] - first
    return 1.0 + float(repeated.mean())


class Refilter:
    """States before the last steps, from which a filter goes on when a measurement arrives late.

    A repeated step draws equal random numbers, so that a run without late measurements does not depend
    on the late measurements of other runs.
    """

    def __init__(
        self,
        z: Array,
        delivered: Deliveries,
        repeat: Callable[[Any, Array, int], Iterable[Any]],
        copy: Callable[[Any], Any],
        rng: Generator,
        clock: AbstractContextManager[None],
    ) -> None:
        """Begin without stored states.

        ``z`` (n_z, T, M) are the measurements, and ``delivered`` their delivery. ``repeat(state, z, i)``
        filters the measurements (n_z, L, M) from step i on, and yields the state after each. ``copy``
        protects a state from the filter's next step. ``rng`` has the filter's random numbers, and goes
        back with the states. ``clock`` times the repeated steps.
        """
        self._z = z
        self._delivered = delivered
        self._repeat = repeat
        self._copy = copy
        self._rng = rng
        self._clock = clock
        # By step (T,): the first repeated step of any run, since all runs go back together.
        self._first_repeated = first_repeated(delivered).min(axis=1)
        # Earliest state that this or any later step goes back to.
        self._needed = np.minimum.accumulate(self._first_repeated[::-1])[::-1]
        # Copy of the state before each step, and the place in the stream of random numbers.
        self._before: dict[int, tuple[Any, Any]] = {}

    def state_before(self, i: int, state: Any) -> Any:
        """Return the state before a step, from which the filter goes on.

        If a measurement of any run arrives late at step i, all runs are filtered again from the step of
        this measurement to step i - 1.

        Parameters
        ----------
        i
            index of the step from 0, that of the first measurement
        state
            state of the filter after step i - 1

        Returns
        -------
        object
            state before step i, which accounts for the measurements that arrive late
        """
        first = int(self._first_repeated[i])
        with self._clock:
            self._store(i, state)
            if first < i:
                # Go back to the state and to the random numbers before the first repeated step.
                state_before_first, position = self._before[first]
                put_back(self._rng, position)
                z = self._delivered.known(self._z, first, i)
                repeated = self._repeat(self._copy(state_before_first), z, first)
                for j, state in enumerate(repeated, first + 1):
                    self._store(j, state)
        # Keep only the states that this or a later step goes back to.
        needed = self._needed[i]
        self._before = {j: stored for j, stored in self._before.items() if j >= needed}
        return state

    def _store(self, i: int, state: Any) -> None:
        self._before[i] = (self._copy(state), position_of(self._rng))


def make_refilter(
    task: BlockTask,
    model: Model,
    delivered: Deliveries,
    z: Array,
    rng: Generator,
    clock: AbstractContextManager[None],
) -> Refilter:
    """Return the `Refilter` that repeats steps when a measurement arrives late.

    Parameters
    ----------
    task
        task of the filter
    model
        model that the filter assumes
    delivered
        delivery of the measurements
    z
        measurements (n_z, T, M) at the steps at which they were made
    rng
        stream of the filter's random numbers
    clock
        context that times the repeated steps

    Returns
    -------
    Refilter
        states to which the filter goes back, none so far
    """
    tracker = task.filter
    steps = task.scenario.steps[1:].tolist()  # without that of the prior

    def repeat(state: Any, z: Array, first: int) -> Iterator[Any]:
        """Repeat some steps from ``state``; yield the state after each measurement of z (n_z, L, M).

        ``first`` is the index of the first step that is repeated.
        """
        # None if the filter has no `all_steps`.
        many = filter_many(tracker, model, state, z, steps[first])
        for i in range(z.shape[1]):
            if many is None:
                state = tracker.step(model, state, z[:, i], steps[first + i], rng)
                yield state
            else:
                yield many.state(i)

    return Refilter(z, delivered, repeat, make_state_copier(tracker, model), rng, clock)
