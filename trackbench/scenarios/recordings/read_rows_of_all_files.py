"""Rows of each sensor, read from all files: the order of the steps."""

from collections.abc import Sequence
from itertools import chain

import numpy as np

from trackbench.scenarios.recordings.east_north_up_axes import Frame
from trackbench.scenarios.recordings.guess_targets_or_sensors import (
    check_label,
    check_label_pairs,
    possible_labels,
)
from trackbench.scenarios.recordings.missing_cells import note_on_codes
from trackbench.scenarios.recordings.names_and_digests_of_data_files import files_of
from trackbench.scenarios.recordings.naming_of_columns import Naming
from trackbench.scenarios.recordings.origins import frames_of_runs
from trackbench.scenarios.recordings.parse_tables import WholeNumbers
from trackbench.scenarios.recordings.quantities_from_columns import Columns
from trackbench.scenarios.recordings.received_times import read_received
from trackbench.scenarios.recordings.rows_and_reading_context import ReadingContext, Rows
from trackbench.scenarios.recordings.rows_by_sensor_column import (
    check_rows_without_sensor,
    find_sensor_rows,
)
from trackbench.scenarios.recordings.weeks_or_nanoseconds import rest_of_stamp


def read_rows(
    context: ReadingContext,
    patterns: Sequence[str],
    sensors: Sequence[Sequence[str]],
    least: int | None = None,
    names: Sequence[str] = (),
    namings: Sequence[Naming] = (),
) -> list[Rows]:
    """Read the rows of each sensor from the files that ``patterns`` match.

    ``sensors`` has the names of the quantities that each sensor measures. There is one pattern for all
    sensors, or one for each. A pattern may match several files, one for each run. A file must have at
    least ``least`` of the quantities, by default all. A column ``sensor`` has the sensors' ``names``, by
    default their numbers. ``namings`` has the columns and units of each pattern's files, one for each
    pattern; by default they are those of ``context``. Runs, files and notices are added to ``context``,
    whose naming is that of the last pattern afterwards. Raises DataError with the line of every mistake.
    """
    # Step 1: read one file for all sensors, or the files of each sensor's pattern.
    is_shared = len(patterns) == 1
    pieces: list[list[Rows]] = [[] for _ in sensors]
    for n, pattern in enumerate(patterns):
        if namings:
            context.naming = namings[n]
        first_sensor = 0 if is_shared else n
        of_pattern = slice(None) if is_shared else slice(n, n + 1)
        # A file without names of runs is one run, which is called by the file's number, from "0" on.
        for number, path in enumerate(files_of(pattern)):
            rows_by_sensor = _read_file(
                context, path, sensors[of_pattern], least, str(number), names[of_pattern]
            )
            for m, rows in enumerate(rows_by_sensor, first_sensor):
                pieces[m].append(rows)
    if context.unavailable:
        context.notices.append(note_on_codes(context.unavailable))
    context.notices += context.mixed_rows
    # Step 2: join the files of one sensor after the other; the pieces are dropped, to save memory.
    joined = []
    while pieces:
        joined.append(_join_rows(pieces.pop(0)))
    return joined


def _join_rows(pieces: Sequence[Rows]) -> Rows:
    """Return the rows of several files as one, in the order of the files."""
    if len(pieces) == 1:
        return pieces[0]
    return Rows(
        run=np.concatenate([rows.run for rows in pieces]),
        time=np.concatenate([rows.time for rows in pieces]),
        values=np.concatenate([rows.values for rows in pieces], axis=-1),
        file=np.concatenate([rows.file for rows in pieces]),
        line=np.concatenate([rows.line for rows in pieces]),
        received=np.concatenate([rows.received for rows in pieces]),
    )


def _read_file(
    context: ReadingContext,
    path: str,
    sensors: Sequence[Sequence[str]],
    least: int | None,
    name: str,
    names: Sequence[str],
) -> list[Rows]:
    """Read the rows of each sensor from one file.

    ``sensors`` has the names of the quantities that each sensor measures. The file must have at least
    ``least`` of them, by default all. ``name`` is the name of the file's only run, if no column names
    runs. A column ``sensor`` has the sensors' ``names``, by default their numbers. Runs, files and
    notices are added to ``context``.
    """
    # Step 1: find the columns of the quantities, of time, run and sensor. The times of arrival, in the
    # column `received`, are written as the times are.
    wanted = list(chain.from_iterable(sensors))
    if least is None:
        least = len(wanted)
    columns = Columns(path, context.naming, wanted, least, context.in_space, context.keys)
    clock = columns.take("time", "time") or columns.take("step", "step")
    if clock is None:
        raise columns.missing_clock()
    if columns.column("date") != clock:
        columns.take("date", "date")
    parts = columns.take_stamp_parts()
    context.unread_time_parts = context.unread_time_parts or rest_of_stamp(
        columns.names, clock, parts
    )
    arrival = columns.take("received", columns.contents[clock])
    run = columns.take("run", "label")
    # In the log of a robot, rows with inputs alone have no sensor: only a word may be empty.
    sensor_column = columns.take("sensor", "word" if context.has_inputs else "label")
    # A column such as MMSI must not have several objects: they would be mixed into one run.
    object_column = columns.take_unnamed_runs() if run is None else None
    # Other columns may name targets or sensors; their rows are compared in Step 5.
    labels = possible_labels(columns, [rest.column for rest in context.unread_time_parts.values()])
    # Step 2: read them; times become seconds.
    table = columns.read()
    context.unavailable += columns.unavailable
    context.notices += columns.notices
    if object_column is not None and len(table.words[object_column]) > 1:
        count = len(table.words[object_column])
        message = f"column {object_column} has {count} values, which would be one run"
        remedy = f'say `columns: {{run: {object_column}}}`, or `columns: {{run: ""}}` to mix them'
        raise columns.mistake(f"{message}: {remedy}")
    time = context.timed(columns, table, clock, parts)
    received = time
    if arrival is not None:
        context.has_delays = True
        received = read_received(context, columns, table, arrival, time)
    if columns.is_geodetic:
        context.geodetic_file = context.geodetic_file or path
    elif columns.has_velocities_alone:
        context.unrotated_velocity_file = context.unrotated_velocity_file or path
    # Quantities that depend on the position, such as x or a range, count from a point x = y = 0 if they
    # have columns. The first file with one is kept for the error if others have latitudes.
    planar_quantity = columns.first_with_column(context.position_dependent)
    if planar_quantity:
        context.planar_file = context.planar_file or f"{path} has {planar_quantity}"
    # Step 3: number the runs; a file without their names is one run.
    if run is None:
        runs = np.full(len(time), context.numbers_of([name])[0])
    else:
        runs = context.numbers_of(table.words[run])[table.columns[run].astype(np.intp)]
    # Step 4: select the rows of the chosen runs and of the sensors.
    is_read = np.ones(len(time), dtype=np.bool_)
    if context.chosen:
        is_read = np.isin(runs, context.numbers_of_known(context.chosen))
    rows_by_sensor: list[WholeNumbers | slice] = [slice(None)] * len(sensors)
    if sensor_column is not None and context.has_inputs:
        check_rows_without_sensor(columns, table, sensor_column, wanted)
    if sensor_column is not None and (
        len(sensors) > 1 or len(table.words[sensor_column]) > 1 or names
    ):
        sensor_masks = [
            find_sensor_rows(context, columns, table, sensor_column, m, len(sensors), names)
            for m in range(len(sensors))
        ]
        is_read &= np.any(sensor_masks, axis=0)
        rows_by_sensor = [np.flatnonzero(mask[is_read]) for mask in sensor_masks]
    if not is_read.all():
        table = table.at(np.flatnonzero(is_read))
        runs = runs[is_read]
        time = time[is_read]
        received = received[is_read]
    columns.note_outliers(table)
    context.notices += columns.far
    # Step 5: compute the quantities, in SI. Raise an error if a column splits the rows into several
    # targets.
    positions = None
    frames: list[Frame] = []
    if columns.is_geodetic:
        positions, frames = frames_of_runs(context, columns, table, runs)
    quantities = columns.quantities(table, positions, frames, runs)
    for label in labels:
        for components, of_sensor in zip(sensors, rows_by_sensor, strict=True):
            measured = {name: quantities[name][of_sensor] for name in components}
            note_on_mixed_rows = check_label(
                columns,
                table,
                label,
                quantities=measured,
                runs=runs[of_sensor],
                time=time[of_sensor],
                of_sensor=of_sensor,
            )
            if note_on_mixed_rows:
                context.mixed_rows.append(f"{path}: {note_on_mixed_rows}")
    for components, of_sensor in zip(sensors, rows_by_sensor, strict=True):
        measured = {name: quantities[name][of_sensor] for name in components}
        check_label_pairs(
            columns,
            table,
            labels,
            quantities=measured,
            runs=runs[of_sensor],
            time=time[of_sensor],
            of_sensor=of_sensor,
        )
    files = np.full(len(time), len(context.files), dtype=np.int32)
    context.files.append(path)
    # Step 6: take the rows of each sensor.
    rows_of_sensors = []
    for components, of_sensor in zip(sensors, rows_by_sensor, strict=True):
        rows = Rows(
            run=runs,
            time=time,
            values=np.stack([quantities[name] for name in components]),
            file=files,
            line=table.lines,
            received=received,
        )
        if not isinstance(of_sensor, slice):
            rows = rows.at(of_sensor)
        rows_of_sensors.append(rows)
    return rows_of_sensors
