"""Rows of arrivals.csv: the step at which each late measurement of the first runs arrives."""

from collections.abc import Iterator
from typing import cast

import numpy as np

from trackbench.config.experiment import Experiment
from trackbench.csv_writer import Row
from trackbench.execution.run_plans import Outcome
from trackbench.models.sensors.stacked import Sensors, rows_of

_MOST_RUNS = 20
"""Runs whose arrivals are written, at most."""
_MOST_ROWS = 20_000
"""Arrivals that are written at most, unless the first run alone has more: git keeps the file."""


def arrival_rows(experiment: Experiment, outcome: Outcome) -> Iterator[Row]:
    """Yield a row for each measurement of the first runs at the points with delayed measurements.

    The row has the step of the measurement and the step at which it arrives, both as in per_step.csv.
    The latter is empty if the run ends before the arrival.
    """
    # A key of `plan.tasks` is the index of a point and the label of a filter.
    delayed = [i for i, point in enumerate(experiment.points) if point.scenario.longest_delay]
    for i in delayed:
        point = experiment.points[i]
        # Filters of this point that did not fail.
        keys = [key for key in outcome.plan.tasks if key[0] == i and key not in outcome.failures]
        if not keys:
            continue
        # The first step has the initial state and no measurement.
        steps = point.scenario.steps[1:].tolist()
        sensors = rows_of(cast(Sensors, point.scenario.true_sensor))
        # The file has at most about `_MOST_ROWS` rows of all these points together.
        rows_of_a_run_at_all_points = len(steps) * len(sensors) * len(delayed)
        runs = min(max(_MOST_ROWS // rows_of_a_run_at_all_points, 1), _MOST_RUNS)
        # All filters of a point get the same data: those of the first one's blocks.
        for task in outcome.plan.tasks[keys[0]]:
            # Later blocks have later runs only. Without arrivals all measurements are on time.
            if task.first_run >= runs or task.data.arrival is None:
                break
            for m in range(min(task.runs_used, runs - task.first_run)):
                # Cells that begin the rows of a run: the grid point's values and the run's number.
                head = [*point.values.values(), task.first_run + m]
                for n, rows in enumerate(sensors):
                    is_measured = ~np.isnan(task.data.measurements[rows, :, m]).all(axis=0)
                    # Indices of the steps of arrival; the number of steps stands for "after the end".
                    arrivals = task.data.arrival[n, :, m].tolist()
                    for j in np.flatnonzero(is_measured).tolist():
                        arrived = steps[arrivals[j]] if arrivals[j] < len(steps) else ""
                        yield [*head, n + 1, steps[j], arrived]
