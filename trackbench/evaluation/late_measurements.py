"""Late measurements: delivery to a filter at each step, and repeated steps with late ones."""

from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager
from typing import Any, cast

import numpy as np
from numpy.random import Generator

from trackbench.core.arrays import Array, Index, Mask
from trackbench.core.random_streams import position_of, put_back
from trackbench.core.read_only import freeze
from trackbench.evaluation.block import BlockTask
from trackbench.evaluation.held_out_measurements import visible_to_filter
from trackbench.evaluation.predictive_scores import with_nan_first
from trackbench.filters.base import WrongReturnError
from trackbench.models.sensors.stacked import Sensors, rows_of
from trackbench.scenarios.base import Simulation


class Deliveries:
    """Delivery of measurements to a filter at each step, for S sensors, T steps and M runs.

    Steps are numbered from 0, the step of the first measurement, to T - 1. The prior is not counted. A
    late measurement is dropped, applied at the step of its arrival, or left for `Refilter`. If several
    measurements of a sensor arrive at one step, the newest is applied. All others are given on time.
    """

    def __init__(self, task: BlockTask, data: Simulation) -> None:
        """Plan the delivery of the measurements in ``data``, which have arrivals.

        The arrival (S, T, M) is the step at which the measurement of each sensor, step and run arrives.
        If `memory` is set, a filter drops measurements that arrive more than so many steps late.
        """
        assumed = task.assumed_scenario
        arrival = data.arrival
        late = assumed.late
        assert arrival is not None
        assert late is not None
        self._rows = rows_of(cast(Sensors, task.scenario.true_sensor))
        z = visible_to_filter(assumed.assumed_measurements(data.measurements), task.hold_out)
        exists = np.stack([~np.isnan(z[rows]).all(axis=0) for rows in self._rows])
        T = z.shape[1]
        # Step of each measurement; it is late if it arrives at a later step.
        due = np.broadcast_to(np.arange(T)[:, None], exists.shape)
        self._late = exists & (arrival > due)
        # Steps are numbered from 0 to T - 1, so that T stands for never.
        self._never = T
        # Step (S, T, M) at which a filter learns of each measurement.
        self.learned = np.where(exists, arrival, self._never)
        if late.kind == "drop":
            self.learned[self._late] = self._never
        elif late.memory is not None:
            self.learned[self._late & (arrival - due > late.memory)] = self._never
        # Step of the measurement (S, T, M) that is given to the filter at each step, -1 for none.
        self._given = np.where(exists & ~self._late, due, -1)
        if late.kind == "apply":
            self._deliver_at_arrival()
        self._arrival = arrival
        self.refilters = late.kind == "refilter"
        """True if the filter repeats its last steps when a measurement arrives late"""

    def _deliver_at_arrival(self) -> None:
        """Give each late measurement to the filter at the step of its arrival.

        If several measurements of a sensor arrive at one step, the filter gets the newest. It never
        learns of the others.

        The delivery is written to `_given` (S, T, M), the step of the measurement that each step gets,
        or -1. `learned` (S, T, M) is the step at which a filter learns of each measurement. It is T,
        which is `_never`, if the filter never does.
        """
        # Sensor, step (due) and run of each late measurement that arrives within the run.
        late = np.nonzero(self._late & (self.learned < self._never))
        sensor, due, run = late
        # Of several measurements that arrive at one step the latest step wins.
        delivery = (sensor, self.learned[late], run)
        np.maximum.at(self._given, delivery, due)
        # A measurement that is not given at its arrival is superseded by a newer one.
        is_superseded = self._given[delivery] != due
        superseded = (sensor[is_superseded], due[is_superseded], run[is_superseded])
        self.learned[superseded] = self._never

    def given(self, z: Array) -> Array:
        """Arrange measurements (n_z, T, M) by the step at which the filter gets them; NaN for none."""
        arranged = np.empty_like(z)
        # Of each sensor: its rows of z, and the step of the measurement that each step gets, or -1.
        for rows, source_step in zip(self._rows, self._given, strict=True):
            taken = np.take_along_axis(z[rows], np.maximum(source_step, 0)[None], axis=1)
            arranged[rows] = np.where(source_step >= 0, taken, np.nan)
        return freeze(arranged)

    def known(self, z: Array, first: int, last: int) -> Array:
        """Return the measurements of steps ``first`` to ``last`` - 1 that have arrived at step ``last``.

        Of z (n_z, T, M) those that arrive later than at step ``last`` are NaN. Steps are counted from 0,
        that of the first measurement z[:, 0].
        """
        known = z[:, first:last].copy()
        # `learned` (S, T, M) has the step at which a filter learns of each measurement.
        for rows, learned in zip(self._rows, self.learned[:, first:last], strict=True):
            known[rows][:, learned > last] = np.nan  # rows is a slice, so this writes to `known`
        return freeze(known)

    @property
    def first_repeated(self) -> Index:
        """First step (T, M) that a filter repeats at each step; the step itself if it repeats none.

        A filter that goes back repeats the steps from the earliest measurement that has just arrived.
        """
        T, runs = self._late.shape[1:]
        first = np.repeat(np.arange(T)[:, None], runs, axis=1)
        # Sensor, step and run of each late measurement that arrives within the run. `learned` (S, T, M)
        # has the step at which a filter learns of each measurement, and `_never`, which is T, else.
        late = np.nonzero(self._late & (self.learned < self._never))
        _, due, run = late
        # At the step of its arrival a filter goes back to the step of the measurement.
        np.minimum.at(first, (self.learned[late], run), due)
        return first

    def counts(self) -> dict[str, Array]:
        """Count the measurements that arrive late at each step, and those of them that are dropped.

        The series (T + 1, M) are named ``arrived_late`` and ``late_dropped``. They begin with NaN for
        the start, at which nothing is measured.
        """
        T = self._late.shape[1]
        # A measurement whose arrival is T or later does not arrive within the run.
        arrived = self._late & (self._arrival < T)
        # The filter never learns of a dropped measurement.
        dropped = arrived & (self.learned == self._never)
        return {
            "arrived_late": self._number_by_arrival(arrived),
            "late_dropped": self._number_by_arrival(dropped),
        }

    def _number_by_arrival(self, counted: Mask) -> Array:
        """Count the marked measurements (S, T, M) by the step (T + 1, M) of their arrival.

        `_arrival` (S, T, M) is this step of each measurement, counted from 0, that of the first
        measurement. All marked ones arrive within the run. The result has one row more than there are
        measurements: the first row, NaN, is that of the prior.
        """
        number = np.zeros(counted.shape[1:])
        run = np.nonzero(counted)[2]
        np.add.at(number, (self._arrival[counted], run), 1.0)
        return with_nan_first(number)

    @property
    def steps_per_step(self) -> float:
        """Mean number of filter steps per step of a run by itself, the repeated ones included.

        It gives the CPU time and the operations of a run that is filtered alone. In a block all runs go
        back together, and repeat more steps.
        """
        if not self.refilters:
            return 1.0
        first = self.first_repeated  # (T, M): the step itself if none is repeated
        # At step i the filter repeats the steps first to i - 1, before it makes step i.
        repeated = np.arange(len(first))[:, None] - first
        return 1.0 + float(repeated.mean())


def deliveries(task: BlockTask, data: Simulation) -> Deliveries | None:
    """Plan the delivery of the measurements to a filter; None if it gets all of them on time."""
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
        self._first_repeated = delivered.first_repeated.min(axis=1)
        # Earliest state that this or any later step goes back to.
        self._needed = np.minimum.accumulate(self._first_repeated[::-1])[::-1]
        # Copy of the state before each step, and the place in the stream of random numbers.
        self._before: dict[int, tuple[Any, Any]] = {}

    def state_before(self, i: int, state: Any) -> Any:
        """Return the state before step i, from which the filter goes on; ``state`` is the present one.

        If a measurement of any run arrives late at step i, all runs are filtered again from the step of
        this measurement to step i - 1.
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
