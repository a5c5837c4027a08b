"""Deliver late measurements to a filter: which measurements it gets at each step, and their counts."""

from typing import cast

import numpy as np

from trackbench.core.arrays import Array, Index, Mask
from trackbench.core.read_only import freeze
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.predictive_and_held_out_scores import visible_to_filter, with_nan_first
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
        late = self.arriving_late()
        sensor, due, run = late
        # Of several measurements that arrive at one step the latest step wins.
        delivery = (sensor, self.learned[late], run)
        np.maximum.at(self._given, delivery, due)
        # A measurement that is not given at its arrival is superseded by a newer one.
        is_superseded = self._given[delivery] != due
        superseded = (sensor[is_superseded], due[is_superseded], run[is_superseded])
        self.learned[superseded] = self._never

    def given(self, z: Array) -> Array:
        """Arrange measurements by the step at which the filter gets them.

        Parameters
        ----------
        z
            measurements (n_z, T, M) at the steps at which they were made

        Returns
        -------
        array (n_z, T, M)
            measurement of each sensor that the filter gets at each step; NaN for none. Read-only
        """
        arranged = np.empty_like(z)
        # Of each sensor: its rows of z, and the step of the measurement that each step gets, or -1.
        for rows, source_step in zip(self._rows, self._given, strict=True):
            taken = np.take_along_axis(z[rows], np.maximum(source_step, 0)[None], axis=1)
            arranged[rows] = np.where(source_step >= 0, taken, np.nan)
        return freeze(arranged)

    def known(self, z: Array, first: int, last: int) -> Array:
        """Return the measurements of some steps that have arrived at a later step.

        Steps are counted from 0, that of the first measurement ``z[:, 0]``.

        Parameters
        ----------
        z
            measurements (n_z, T, M) at the steps at which they were made
        first, last
            steps ``first`` to ``last`` - 1 are returned; ``last`` is also the step of the arrivals

        Returns
        -------
        array (n_z, last - first, M)
            measurements, NaN for those that arrive later than at step ``last``. Read-only
        """
        known = z[:, first:last].copy()
        # `learned` (S, T, M) has the step at which a filter learns of each measurement.
        for rows, learned in zip(self._rows, self.learned[:, first:last], strict=True):
            known[rows][:, learned > last] = np.nan  # rows is a slice, so this writes to `known`
        return freeze(known)

    def arriving_late(self) -> tuple[Index, Index, Index]:
        """Return sensor, step and run of each late measurement that arrives within the run.

        A filter learns of it at the step that `learned` (S, T, M) has.
        """
        sensor, due, run = np.nonzero(self._late & (self.learned < self._never))
        return sensor, due, run

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


def deliveries(task: BlockTask, data: Simulation) -> Deliveries | None:
    """Plan the delivery of the measurements to a filter.

    Parameters
    ----------
    task
        task of the filter
    data
        measurements of the block, with arrivals if sensors have a delay

    Returns
    -------
    Deliveries or None
        plan; None if the filter gets all measurements on time

    Raises
    ------
    WrongReturnError
        if sensors have a delay, and the scenario's ``simulate`` returned no arrivals
    """
    if task.assumed_scenario.late is None:
        return None
    if data.arrival is None:
        raise WrongReturnError("simulate", "gives no arrivals, and sensors have a delay")
    return Deliveries(task, data)
