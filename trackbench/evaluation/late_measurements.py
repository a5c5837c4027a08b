"""Late measurements: what a filter is given at each step, and how it filters again with late ones."""

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
    """Which measurements a filter is given at each step, of S sensors, T steps and M runs.

    A late measurement is dropped, applied at the step at which it arrives unless a newer one of its
    sensor arrives there too, or left for `Refilter`. The rest is given on time.
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
        """Return measurements (n_z, T, M) as they are given at each step, of those as they were made."""
        out = np.empty_like(z)
        for rows, number in zip(self._rows, self._given, strict=True):
            taken = np.take_along_axis(z[rows], np.maximum(number, 0)[None], axis=1)
            out[rows] = np.where(number >= 0, taken, np.nan)
        return freeze(out)

    def known(self, z: Array, first: int, last: int) -> Array:
        """Return the measurements of steps ``first`` to ``last`` - 1 that have arrived by ``last``."""
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
        """Return the series (T + 1, M) of measurements that arrive late, and of those dropped then."""
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
        repeated = np.arange(len(self.again_from))[:, None] - self.again_from
        return 1.0 + float(repeated.mean()) if self.refilters else 1.0


def deliveries(task: BlockTask, data: Simulation) -> Deliveries | None:
    """Return what a filter is given; None if it gets all measurements on time."""
    if task.assumed_scenario.late is None:
        return None
    if data.arrival is None:
        raise WrongReturnError("simulate", "gives no arrivals, and sensors have a delay")
    return Deliveries(task, data)


class Refilter:
    """States before the last steps, from which a filter goes on when a measurement arrives late.

    It draws the random numbers of a repeated step again, so that a run without late measurements does
    not depend on those of other runs.
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
        """Return the state before step i, filtered again if a measurement has just arrived late."""
        first = int(self._again_from[i])
        with self._clock:
            self._store(i, state)
            if first < i:
                begin, position = self._before[first]
                put_back(self._rng, position)
                z = self._of.known(self._z, first, i)
                for j, state in enumerate(self._repeat(self._copy(begin), z, first), first + 1):
                    self._store(j, state)
        for j in [j for j in self._before if j < self._needed[i]]:
            del self._before[j]
        return state

    def _store(self, i: int, state: Any) -> None:
        self._before[i] = self._copy(state), position_of(self._rng)
