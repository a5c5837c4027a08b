"""Late measurements: delivery to a filter at each step, and repeated steps with late ones."""

from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager
from typing import Any, cast

import numpy as np
from numpy.random import Generator

from trackbench.core.arrays import Array, Index, freeze
from trackbench.core.random_streams import position_of, put_back
from trackbench.evaluation.block import BlockTask
from trackbench.evaluation.predictive_scores import after_first, visible_to_filter
from trackbench.filters.base import WrongReturnError
from trackbench.models.sensors.base import Sensors, rows_of
from trackbench.scenarios.base import Simulation


class Deliveries:
    """Delivery of measurements to a filter at each step, for S sensors, T steps and M runs.

    A late measurement is dropped, applied at the step of its arrival, or left for `Refilter`. If several
    measurements of a sensor arrive at one step, the newest is applied. All others are given on time.
    """

    def __init__(self, task: BlockTask, data: Simulation) -> None:
        assumed, arrival = task.assumed_scenario, data.arrival
        late = assumed.late
        assert arrival is not None
        assert late is not None
        self._rows = rows_of(cast(Sensors, task.scenario.true_sensor))
        z = visible_to_filter(assumed.assumed_measurements(data.measurements), task.hold_out)
        exists = np.stack([~np.isnan(z[rows]).all(axis=0) for rows in self._rows])
        T = z.shape[1]
        due = np.broadcast_to(np.arange(T)[:, None], exists.shape)
        self._late = exists & (arrival > due)
        # Step at which a filter learns of each measurement, T for never.
        self.learned = np.where(exists, arrival, T)
        if late.kind == "drop":
            self.learned[self._late] = T
        elif late.memory is not None:
            self.learned[self._late & (arrival - due > late.memory)] = T
        # Number of the measurement (S, T, M) that is given at each step, -1 for none.
        self._given = np.where(exists & ~self._late, due, -1)
        if late.kind == "apply":
            self._apply(T)
        self._arrival, self.refilters = arrival, late.kind == "refilter"

    def _apply(self, T: int) -> None:
        """Give each late measurement at the step of its arrival, the newest of several."""
        late = np.nonzero(self._late & (self.learned < T))
        at = late[0], self.learned[late], late[2]
        np.maximum.at(self._given, at, late[1])
        superseded = tuple(index[self._given[at] != late[1]] for index in late)
        self.learned[superseded] = T

    def given(self, z: Array) -> Array:
        """Arrange measurements (n_z, T, M) by the step at which the filter gets them."""
        out = np.empty_like(z)
        for rows, number in zip(self._rows, self._given, strict=True):
            taken = np.take_along_axis(z[rows], np.maximum(number, 0)[None], axis=1)
            out[rows] = np.where(number >= 0, taken, np.nan)
        return freeze(out)

    def known(self, z: Array, first: int, last: int) -> Array:
        """Blank the measurements of steps ``first`` to ``last`` - 1 that arrive after ``last``."""
        out = z[:, first:last].copy()
        for rows, learned in zip(self._rows, self.learned[:, first:last], strict=True):
            out[rows][:, learned > last] = np.nan
        return freeze(out)

    @property
    def again_from(self) -> Index:
        """First step (T, M) that a filter repeats at each step, the step itself for none."""
        T, runs = self._late.shape[1:]
        out = np.repeat(np.arange(T)[:, None], runs, axis=1)
        _, j, m = late = np.nonzero(self._late & (self.learned < T))
        np.minimum.at(out, (self.learned[late], m), j)
        return out

    def counts(self) -> dict[str, Array]:
        """Count measurements that arrive late, and the dropped ones of them, by step (T + 1, M)."""
        T, runs = self._late.shape[1:]
        arrived = self._late & (self._arrival < T)
        out = {}
        for name, which in {
            "arrived_late": arrived,
            "late_dropped": arrived & (self.learned == T),
        }.items():
            number = np.zeros((T, runs))
            np.add.at(number, (self._arrival[which], np.nonzero(which)[2]), 1.0)
            out[name] = after_first(number)
        return out

    @property
    def steps_per_step(self) -> float:
        """Mean number of steps that a filter makes at a step of a run."""
        if not self.refilters:
            return 1.0
        first = self.again_from
        return 1.0 + float((np.arange(len(first))[:, None] - first).mean())


def deliveries(task: BlockTask, data: Simulation) -> Deliveries | None:
    """Plan the delivery to a filter; None if it gets all measurements on time."""
    if task.assumed_scenario.late is None:
        return None
    if data.arrival is None:
        raise WrongReturnError("simulate", "gives no arrivals, and sensors have a delay")
    return Deliveries(task, data)


class Refilter:
    """States before the last steps, from which a filter goes on when a measurement arrives late.

    A repeated step draws equal random numbers, so that a run without late measurements does not depend
    on the late measurements of other runs.
    """

    def __init__(
        self,
        z: Array,
        of: Deliveries,
        repeat: Callable[[Any, Array, int], Iterable[Any]],
        copy: Callable[[Any], Any],
        rng: Generator,
        clock: AbstractContextManager[None],
    ) -> None:
        """Begin with no state.

        ``repeat`` yields the states after measurements (n_z, L, M) from a state and a step on; ``copy``
        protects a state from the filter's next step; ``clock`` times what is repeated.
        """
        self._z, self._of, self._repeat, self._copy, self._rng = z, of, repeat, copy, rng
        self._clock = clock
        self._again_from = of.again_from.min(axis=1)
        # Earliest state that this or any later step goes back to.
        self._needed = np.minimum.accumulate(self._again_from[::-1])[::-1]
        self._before: dict[int, tuple[Any, Any]] = {}

    def state_before(self, i: int, state: Any) -> Any:
        """Update the state before step i: filter again if a measurement has just arrived late."""
        first = int(self._again_from[i])
        with self._clock:
            self._store(i, state)
            if first < i:
                begin, position = self._before[first]
                put_back(self._rng, position)
                z = self._of.known(self._z, first, i)
                for j, state in enumerate(self._repeat(self._copy(begin), z, first), first + 1):
                    self._store(j, state)
        self._before = {j: each for j, each in self._before.items() if j >= self._needed[i]}
        return state

    def _store(self, i: int, state: Any) -> None:
        self._before[i] = self._copy(state), position_of(self._rng)
