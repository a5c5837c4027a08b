"""Order of the steps by which a table is guessed: format, columns, sensors, clock, units and errors."""

from collections.abc import Collection
from dataclasses import replace
from itertools import chain

from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.csv_layout_and_rows import TextFormat
from trackbench.scenarios.recordings.guess_azimuths import check_unit_of_azimuths
from trackbench.scenarios.recordings.guess_codes_of_missing_cells import guess_missing
from trackbench.scenarios.recordings.guess_columns import (
    TableContent,
    check_given_keys,
    guess_columns,
    measured_columns,
)
from trackbench.scenarios.recordings.guess_csv_format import check_thousands, guess_format
from trackbench.scenarios.recordings.guess_from_all_rows import guess_from_all_rows
from trackbench.scenarios.recordings.guess_hemispheres import check_hemispheres
from trackbench.scenarios.recordings.guess_odometry import guess_odometry
from trackbench.scenarios.recordings.guess_record import (
    Guess,
    ReasonByKey,
    RobotTables,
    SensorGuess,
)
from trackbench.scenarios.recordings.guess_sensors import guess_sensors
from trackbench.scenarios.recordings.guess_table_sample import TableSample
from trackbench.scenarios.recordings.guess_targets_or_sensors import (
    REASON_FOR_LABELS,
    MixedRowsError,
    explain_labels,
    key_of_labels,
    question_on_pair,
)
from trackbench.scenarios.recordings.guess_time_and_date_columns import (
    check_date_and_clock,
    check_split_time,
    day_column,
    explain_no_time,
    find_dates,
)
from trackbench.scenarios.recordings.guess_time_format import guess_clock_format
from trackbench.scenarios.recordings.guess_time_unit import check_decimal_years
from trackbench.scenarios.recordings.guess_times_of_day_in_digits import ClockFormat
from trackbench.scenarios.recordings.guess_units import UnitChoice, check_named_units
from trackbench.scenarios.recordings.guess_utm_ecef_slant_ranges import (
    check_earth_centered,
    check_slant_ranges,
    check_split_angles,
    check_zones,
)
from trackbench.scenarios.recordings.naming_of_columns import Naming
from trackbench.scenarios.recordings.parse_dates import has_day
from trackbench.scenarios.recordings.parse_numbers import without_thousands
from trackbench.scenarios.recordings.parse_tables import header
from trackbench.scenarios.recordings.quantity_keys import (
    ODOMETRY,
    PLACE,
    STAMP_PARTS,
    measures_velocity,
)
from trackbench.scenarios.recordings.recognize_column_names import shown_names, words_of
from trackbench.scenarios.recordings.unused_columns import check_unused


def recognized(
    path: str,
    user_naming: Naming | None = None,
    user_keys: Collection[str] = (),
    tables: RobotTables | None = None,
) -> Guess:
    """Guess how a table of measurements is written: its columns, units, sensors and runs.

    Keys that are set in ``user_naming`` are not guessed. ``user_keys`` are the keys that the user set,
    also to nothing, such as ``clockwise=[]``. ``tables`` are those of odometry and landmarks beside it,
    if it is a robot's. Raises DataError if no column is a time, or none is measured, and with questions
    that only the user can answer.
    """
    naming = user_naming or Naming()
    return _recognized(path, naming, user_keys, tables or RobotTables(), content="measurements")


def recognized_odometry(path: str, user_naming: Naming | None = None) -> Guess:
    """Guess how a table of a robot's speeds and turn rates is written, which has no sensors.

    Keys that are set in ``user_naming`` are not guessed. Raises DataError if a column is missing.
    """
    return _recognized(
        path, user_naming or Naming(), user_keys=(), tables=RobotTables(), content="odometry"
    )


def _recognized(
    path: str,
    user_naming: Naming,
    user_keys: Collection[str],
    tables: RobotTables,
    content: TableContent,
) -> Guess:
    """Guess how a table is written, and which of its columns name runs or sensors.

    ``content`` says whether the table has measurements, or a robot's odometry alone. Keys that are set
    in ``user_naming`` are not guessed. ``user_keys`` are the keys that the user set, also to nothing.
    ``tables`` are those of odometry and landmarks beside a table of measurements.
    """
    check_given_keys(path, user_naming)
    label_columns: dict[str, str] = {}
    # If the words of a column split the rows into several targets or sensors, this column becomes that
    # of runs or sensors, and the guess is repeated. There may be one column of each.
    while True:
        try:
            with_labels = replace(user_naming, columns=user_naming.columns | label_columns)
            guess = _recognized_columns(path, with_labels, user_keys, tables, content)
        except MixedRowsError as error:
            key = key_of_labels(error)
            if key == "run" and "run" in label_columns:
                pair = question_on_pair(path, label_columns["run"], error.column)
                raise DataError(pair) from None
            if key in label_columns or key in user_naming.columns:
                raise
            label_columns[key] = error.column
            continue
        except DataError as error:
            if not label_columns:
                raise
            raise DataError(*error.places, *explain_labels(path, label_columns)) from None
        guess.reasons.update(dict.fromkeys(label_columns, REASON_FOR_LABELS))
        return guess


def _recognized_columns(
    path: str,
    user_naming: Naming,
    user_keys: Collection[str],
    tables: RobotTables,
    content: TableContent,
) -> Guess:
    """Guess how a table is written; raises MixedRowsError if a column splits its rows.

    This means that its words seem to name several targets or sensors, whose rows would be mixed.
    ``content`` says whether the table has measurements, or a robot's odometry alone. Keys that are set
    in ``user_naming`` are not guessed. ``user_keys`` are the keys that the user set, also to nothing.
    ``tables`` are those of odometry and landmarks beside a table of measurements.
    """
    # Step 1: find the columns by their names.
    reasons: ReasonByKey = {}
    user_format = user_naming.format or TextFormat()
    text_format = guess_format(path, user_format, reasons)
    names = header(path, text_format)
    sample = TableSample(path, names, text_format)
    sample.require_rows()
    for key, column in user_naming.columns.items():
        if column and column not in names:
            message = (
                f"no column {column}, which columns.{key} names; there are {shown_names(names)}"
            )
            raise DataError(Place(path, 1, 1, message))
    columns, units = guess_columns(sample, user_naming, reasons, tables, content)
    from_first_number = sample.from_first_number(measured_columns(columns))
    if from_first_number is not sample:
        # Nothing is measured in the first rows, which so show no columns, units and sensors.
        sample = from_first_number
        columns, units = guess_columns(sample, user_naming, reasons, tables, content)
    check_date_and_clock(sample, columns, user_naming.columns)
    if "time" not in columns and "step" not in columns:
        find_dates(sample, columns, reasons)
    if "time" not in columns and "step" not in columns:
        raise DataError(Place(path, 1, 1, explain_no_time(sample)))
    check_split_time(sample, columns, user_naming.columns)
    # Step 2: find the sensors, and the format of dates. A table of odometry counts as that of one sensor
    # of the speed and the turn rate.
    sensors = [SensorGuess(name="", kind="odometry", quantities=ODOMETRY)]
    if content == "measurements":
        sensors = guess_sensors(sample, columns, units, user_naming, reasons)
    check_unused(sample, columns, sensors, user_naming)
    # A mark of thousands that was guessed, as the user's are sure. A decimal sign makes it sure, too.
    if text_format.thousands and not user_format.thousands and text_format.decimal is None:
        check_thousands(sample, columns, text_format.thousands)
    measured = set(chain.from_iterable(sensor.quantities for sensor in sensors))
    check_named_units(sample, columns, units, measured)
    if {*PLACE} <= measured:
        check_split_angles(sample, columns)
        check_earth_centered(sample, columns, units)
        check_zones(sample, columns, user_naming.columns)
    if not {*PLACE} <= columns.keys():
        check_hemispheres(sample, columns, user_naming.columns)
    check_slant_ranges(sample, columns, units, user_naming.columns)
    # Times of day, of a week or of a second may be equal, and differ by the column beside them.
    if "time" in columns and not {"date", *STAMP_PARTS} & columns.keys():
        sample.require_two_times(columns["time"])
    clock_format = ClockFormat(
        date_format=user_naming.time_format, is_date=bool(user_naming.time_format)
    )
    if "time" in columns and not clock_format.date_format:
        times = sample.cells(columns["time"])
        if text_format.thousands:
            times = [without_thousands(cell, text_format.thousands) for cell in times]
        dates = []
        if "date" in columns:
            dates = sample.cells(columns["date"])
        words = words_of(columns["time"])
        clock_format = guess_clock_format(
            path, times, dates, sample.lines, words, has_unit="time" in units
        )
        # Times of day alone have a format without a day (%d or %j). A column `day` may have their dates.
        if clock_format.date_format and not has_day(clock_format.date_format):
            day = day_column(sample)
            if day is not None:
                columns["date"] = day
                clock_format = guess_clock_format(path, times, sample.cells(day), sample.lines)
    if clock_format.reason:
        reasons["time_format"] = clock_format.reason
    if not clock_format.is_date:
        check_decimal_years(sample, columns, units)
    # Step 3: choose the units by which times, positions and speeds of the first sensor agree.
    missing = user_naming.missing
    if missing is None:
        missing = guess_missing(sample, columns, measured, user_naming.columns) or None
    quantities = [sensor.quantities for sensor in sensors]
    with_missing = replace(user_naming, missing=missing)
    unit_choice = UnitChoice(
        sample, columns, units, clock_format, with_missing, reasons, user_naming.columns
    )
    check_unit_of_azimuths(sample, columns, units, reasons, with_missing, sensors)
    clock_format = unit_choice.choose_units(sensors[0], measures_velocity(quantities, columns))
    naming = replace(
        user_naming,
        columns=columns,
        units=units,
        time_format=clock_format.date_format,
        missing=missing,
        format=text_format if text_format != TextFormat() else None,
    )
    if missing and user_naming.missing is None:
        reasons["missing"] = "guess: far outside the others"
    # Step 4: read all rows.
    if content == "odometry":
        return replace(guess_odometry(path, naming, reasons), names=names, path=path)
    guess = guess_from_all_rows(
        path, naming, reasons, sensors, sample, user_naming.columns, user_keys, tables
    )
    # Dates such as 03/04 may be a day and a month in either order. If the table does not show which, the
    # other order is kept until it is compared with those of further tables.
    return replace(guess, names=names, format_of_other_order=clock_format.format_of_other_order)
