"""Order in which all rows of a table are read for a guess: runs, errors, speed and questions."""

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from trackbench.errors import in_line
from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.angle_size_check import check_turns
from trackbench.scenarios.recordings.chosen_runs import chosen_runs, longest_first
from trackbench.scenarios.recordings.errors_from_neighbors import round_to_two_digits
from trackbench.scenarios.recordings.guess_azimuths import azimuths_of, settle_azimuths
from trackbench.scenarios.recordings.guess_clock_changes import check_clock, check_daylight_saving
from trackbench.scenarios.recordings.guess_clockwise_robot import check_turns_of_robot
from trackbench.scenarios.recordings.guess_codes_of_missing_cells import late_missing_numbers
from trackbench.scenarios.recordings.guess_errors_and_outliers import (
    error_of_azimuth,
    errors_and_speed,
    raised_to_resolution,
    share_of_outliers,
)
from trackbench.scenarios.recordings.guess_jumps import check_jumps
from trackbench.scenarios.recordings.guess_odometry import read_odometry_rows, sigmas_of_inputs
from trackbench.scenarios.recordings.guess_process_noise import (
    joined_process_noise,
    shown_process_noise,
)
from trackbench.scenarios.recordings.guess_record import (
    Guess,
    ReasonByKey,
    RobotTables,
    SensorGuess,
    Track,
    track_of,
)
from trackbench.scenarios.recordings.guess_same_time_key import guess_same_time
from trackbench.scenarios.recordings.guess_table_sample import TableSample
from trackbench.scenarios.recordings.guess_targets_or_sensors import (
    check_runs_apart,
    check_sensors_apart,
)
from trackbench.scenarios.recordings.guess_velocities import blame_mixed_rows
from trackbench.scenarios.recordings.naming_of_columns import Naming
from trackbench.scenarios.recordings.quantity_keys import PLACE, VELOCITY, has_velocity
from trackbench.scenarios.recordings.read_rows_of_all_files import read_rows
from trackbench.scenarios.recordings.row_order import in_order
from trackbench.scenarios.recordings.rows_and_reading_context import (
    ReadingContext,
    Rows,
    usual_interval,
)
from trackbench.scenarios.recordings.unit_names_and_sizes import UNITS

_TURN = 2.0 * np.pi

_LARGEST_AZIMUTH_ERROR = 0.5
"""rad; azimuths with larger errors are rather those of several targets, or of another unit"""


def guess_from_all_rows(
    path: str,
    naming: Naming,
    reasons: ReasonByKey,
    sensors: list[SensorGuess],
    sample: TableSample,
    user_columns: Collection[str],
    user_keys: Collection[str],
    tables: RobotTables,
) -> Guess:
    """Read all rows and return the guess with what they show: runs, errors, speed, further units.

    ``naming`` has the columns and units that are known by now, and ``reasons`` the comments on them;
    both are completed. ``user_columns`` are the quantities whose columns the user named, ``user_keys``
    the keys that were set. ``sample`` are the first rows as they are written. ``tables`` are those of a
    robot's odometry and landmarks, if there are some beside this table.
    """
    # Step 1: read the rows of each sensor. Angles are read as if they were not clockwise: errors and
    # speeds of the mirror image are equal. Rows far from the origin are accepted here, and reported when
    # their run is read.
    is_robot = "bearing" in naming.columns or tables.odometry is not None
    context = ReadingContext(
        replace(naming, clockwise=()), refuses_far_rows=False, has_inputs=is_robot
    )
    units = naming.units
    columns = naming.columns
    sensor_names: list[str] = []
    if columns.get("sensor"):
        sensor_names = [sensor.name for sensor in sensors]
    quantities_by_sensor = [sensor.quantities for sensor in sensors]
    read_quantities = quantities_by_sensor
    if quantities_by_sensor == [PLACE] and not sensor_names and has_velocity(columns):
        read_quantities = [(*PLACE, *VELOCITY)]
    rows_by_sensor = read_rows(context, [path], read_quantities, names=sensor_names)
    may_guess_missing = "missing" not in user_keys and sample.may_lack_rows
    if may_guess_missing and not isinstance(naming.missing, dict):
        # A number for missing cells may stand behind the rows of the sample.
        late = late_missing_numbers(sample, naming, read_quantities, rows_by_sensor)
        if late:
            naming = replace(naming, missing=(*(naming.missing or ()), *late))
            reasons["missing"] = "guess: far outside the others"
            context = ReadingContext(
                replace(naming, clockwise=()), refuses_far_rows=False, has_inputs=is_robot
            )
            rows_by_sensor = read_rows(context, [path], read_quantities, names=sensor_names)
    context.check_idle_keys()
    if context.mixed_rows:
        reasons["mixed"] = in_line(context.mixed_rows[0].removeprefix(f"{path}: "))
        blame_mixed_rows(reasons)
    rows_by_sensor = chosen_runs(context, rows_by_sensor, ())
    if "run" not in user_columns:
        check_runs_apart(context, [sensor.kind for sensor in sensors], rows_by_sensor)
    # Step 2: without a unit, angles beyond 2 pi are in degrees.
    azimuths = azimuths_of(quantities_by_sensor, rows_by_sensor)
    is_wide = any((np.abs(a[np.isfinite(a)]) > _TURN).any() for a in azimuths)
    angle = "bearing" if is_robot else "azimuth"
    in_degrees = angle not in units and is_wide
    scale = 1.0
    if in_degrees:
        units[angle] = "deg"
        reasons[angle] = "guess: there are angles beyond 2 pi"
        scale = UNITS["deg"]
    for names, rows in zip(quantities_by_sensor, rows_by_sensor, strict=True):
        if angle in names:
            scaled = rows._replace(values=rows.values * scale)
            row_of_angle = len(names) - 1  # an angle is the last quantity of each type in `SENSORS`
            check_turns(context, scaled, {angle: row_of_angle})
    # Step 3: sort the runs by length, and put the rows of the longest run in order. It shows the errors
    # and the speed.
    rows_of_run = [np.bincount(rows.run, minlength=len(context.runs)) for rows in rows_by_sensor]
    sizes = np.sum(rows_of_run, axis=0)
    runs = longest_first(context.runs, sizes)
    longest = []
    telling = []
    """rows that show the errors of each sensor"""
    for sensor, rows in zip(sensors, rows_by_sensor, strict=True):
        measured = np.isfinite(rows.values[: len(sensor.quantities)]).all(axis=0)
        run_rows = rows.at(np.flatnonzero(measured & (rows.run == sizes.argmax())))
        check_clock(context, run_rows)
        same_time = None
        if naming.same_time is None:
            same_time = guess_same_time(context, run_rows, sensor.kind, in_degrees)
        if same_time is not None:
            naming = replace(naming, same_time=same_time)
            context.naming = replace(naming, clockwise=())
            reasons["same_time"] = "guess: several rows of one time; or mean, or last"
        ordered = in_order(context, run_rows)
        if "run" not in user_columns:
            check_jumps(context, ordered, sensor.kind, in_degrees, sample)
        if "time" not in user_columns:
            check_daylight_saving(context, ordered)
        longest.append(ordered)
        if not len(ordered.time) and measured.any():
            # A sensor without rows in the longest run shows its errors in another one.
            own_run = np.bincount(rows.run[measured]).argmax()
            of_own_run = rows.at(np.flatnonzero(measured & (rows.run == own_run)))
            ordered = in_order(context, of_own_run)
        telling.append(ordered)
    if sensor_names and "sensor" not in user_columns:
        kinds = [sensor.kind for sensor in sensors]
        check_sensors_apart(path, columns["sensor"], kinds, longest)
    # Step 4: estimate standard deviations of the errors, the usual speed, outliers and process noise.
    errors_and_speeds = [
        errors_and_speed(rows, sensor.kind, in_degrees)
        for sensor, rows in zip(sensors, telling, strict=True)
    ]
    for sensor, rows in zip(sensors, longest, strict=True):
        error = error_of_azimuth(rows, sensor.kind, in_degrees)
        if error > _LARGEST_AZIMUTH_ERROR:
            message = f"{columns['azimuth']}: azimuths jump by some {np.degrees(error):.0f} deg"
            doubt = "is their unit right (units.azimuth), and are these rows of one target? Say"
            option = (
                "which column names targets, --set 'columns.run=NAME', or sensors, columns.sensor"
            )
            raise DataError(Place(path, 1, 1, f"{message}: {doubt} {option}"))
    outliers = [
        share_of_outliers(rows, sensor.kind, in_degrees)
        for sensor, rows in zip(sensors, longest, strict=True)
    ]
    speed = next((speed for _, speed in errors_and_speeds if speed), 0.0)
    steps = len(np.unique(np.concatenate([rows.ticks for rows in longest])))
    guesses = []
    for sensor, (sigmas, _) in zip(sensors, errors_and_speeds, strict=True):
        sigmas = raised_to_resolution(sigmas, sensor.quantities, naming, sample.decimals)
        guesses.append(sensor._replace(sigmas=sigmas))
    rounded_speed = round_to_two_digits(speed) or 1.0  # a sensor of bearings shows no speed (0)
    noises = [
        shown_process_noise(rows, sensor.kind, in_degrees, sensor.sigmas, rounded_speed)
        for sensor, rows in zip(guesses, longest, strict=True)
    ]
    # Step 5: keep positions, ranges and azimuths to compare them with a truth or another file.
    tracks: dict[str, Track] = {}
    for sensor, rows in zip(sensors, longest, strict=True):
        if sensor.kind in ("position", "range-azimuth") and sensor.kind not in tracks:
            is_radar = sensor.kind == "range-azimuth"
            tracks[sensor.kind] = track_of(context, rows, scale if is_radar else 1.0)
    inputs: dict[str, float] = {}
    odometry: Rows | None = None
    if tables.odometry is not None:
        odometry = tables.odometry.odometry
        inputs = tables.odometry.inputs
        steps += tables.odometry.steps
    elif is_robot:
        odometry, _ = read_odometry_rows(path, naming)
        inputs = sigmas_of_inputs(odometry)
    guess = Guess(
        naming=naming,
        reasons=reasons,
        runs=runs,
        sensors=guesses,
        speed=rounded_speed,
        process_noise=joined_process_noise(noises, rounded_speed),
        steps=steps,
        inputs=inputs,
        interval=usual_interval(np.concatenate([rows.time for rows in longest])),
        origin=(context.origin or ())[:2],
        is_dated=bool(context.dated),
        outliers=max(outliers),
        path=path,
        radar=tracks.get("range-azimuth"),
        positions=tracks.get("position"),
    )
    # Step 6: check from where angles count, by the turns of a robot or by the positions of another
    # sensor.
    is_answered = "w" in user_columns or tables.names_turn_rate
    # The times of dates in two files count from different moments, each from its first date.
    are_comparable = tables.odometry is None or not context.dated
    if odometry is not None and not is_answered and are_comparable:
        # All angles were read as they stand in the file; bearings must count anticlockwise.
        sign = -1.0 if naming.is_clockwise("bearing") else 1.0
        bearings = []
        for sensor, rows in zip(sensors, longest, strict=True):
            # A bearing is the last quantity of its sensor; rows of further values may follow it.
            if sensor.quantities[-1] == "bearing":
                in_file = rows.values[len(sensor.quantities) - 1] * scale
                bearings.append((rows.time, sign * in_file))
        check_turns_of_robot(guess, odometry, bearings, tables.odometry)
    return settle_azimuths(guess, [angles * scale for angles in azimuths], "clockwise" in user_keys)
