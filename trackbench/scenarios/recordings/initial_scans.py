"""First scans of each run, from which the filters start: their rows, and their steps on the clock."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.errors import counted
from trackbench.field_types import DataError, Place
from trackbench.models.sensors.stacked import sensor_name
from trackbench.scenarios.recordings.rows_and_reading_context import TICK, ReadingContext, Rows
from trackbench.scenarios.recordings.steps_of_all_runs import Clock


class InitialScans(NamedTuple):
    """First scans of each of M runs, from which the filters are initialized."""

    time: Array
    """time (M,) of the last of them, s or steps, which is that of the first state"""
    scans: Array
    """measurements (n, s, M) of the s scans, which the filters do not get again"""
    scan_interval: Array
    """time (M,) between the last two scans, s or steps; NaN for one scan"""


def initial_scans(context: ReadingContext, rows: Rows, scans: int) -> InitialScans:
    """Return the first ``scans`` complete rows of each run, by which the filters are initialized.

    ``rows`` are those of the sensor that measures positions, in order of run and time. Raises DataError
    for a run with fewer complete rows.
    """
    runs = len(context.runs)
    # Rows with all components; the place of each run's first one among them, and how many it has.
    whole = np.flatnonzero(np.isfinite(rows.values).all(axis=0))
    first = np.searchsorted(rows.run[whole], np.arange(runs))
    number = np.searchsorted(rows.run[whole], np.arange(runs), side="right") - first
    for m in np.flatnonzero(number < scans).tolist():
        positions = counted(int(number[m]), "position")
        message = f"run {context.runs[m]} has {positions}, and its start takes {scans}"
        raise DataError(Place(context.files[0], 1, 1, message))
    # The rows (s, M) of the first scans of each run. The first state has the time of the last scan.
    rows_of_scans = np.stack([whole[first + i] for i in range(scans)])
    times = rows.time[rows_of_scans]
    scan_interval = np.full(runs, np.nan)
    if scans > 1:
        scan_interval = times[-1] - times[-2]
    return InitialScans(
        time=times[-1], scans=rows.values[:, rows_of_scans], scan_interval=scan_interval
    )


def note_on_rows_before_start(
    sensors: Sequence[Rows], start: InitialScans, locating: int, names: Sequence[str], unit: str
) -> list[str]:
    """Return a note on each further sensor with measurements before the first state: they are left out.

    ``sensors`` are the rows of each sensor. The filters are initialized by the scans ``start`` of the
    sensor with the number ``locating``, from 0. Its own rows before the first state are these scans, or
    lack a component, and have no note. ``names`` are those of the sensors in the recording, if
    it has any. ``unit`` is that of the times in the text.
    """
    notes = []
    for number, rows in enumerate(sensors):
        measured = np.isfinite(rows.values).any(axis=0)
        early = measured & (rows.time < start.time[rows.run] - TICK)
        if number == locating or not early.any():
            continue
        earlier = float((start.time[rows.run] - rows.time)[early].max())
        left_out = counted(int(early.sum()), "measurement")
        message = f"{left_out} of {sensor_name(number, names)} before the first state left out"
        reason = f"the start takes the first position of {sensor_name(locating, names)}"
        remedy = "if it begins late, list a sensor that begins earlier before it"
        notes.append(f"{message}, up to {earlier:.4g} {unit} earlier: {reason}; {remedy}")
    return notes


def with_scans(clock: Clock, context: ReadingContext, scans: int, scan_interval: Array) -> Clock:
    """Return the clock with a step before the first state for each scan of the start but the last one.

    ``scans`` is the number of scans of the start, ``scan_interval`` (M,) the time between the last two,
    s.
    """
    added = max(0, scans - 1)
    if not added:
        return clock
    before = np.arange(-added, 0)
    # If the file numbers its steps, these stay, and time counts from the first step with a scan.
    if context.counts_steps:
        assert clock.T is not None
        steps = np.concatenate([clock.steps[0] + before, clock.steps])
        return clock._replace(steps=steps, times=(steps - steps[0]) * clock.T)
    # Otherwise the times stay, and steps are numbered from the first one with a scan. Scans before the
    # first state are as far apart as those of the first run.
    times = np.concatenate([clock.times[0] + before * scan_interval[0], clock.times])
    return clock._replace(steps=np.arange(len(times)), times=times)
