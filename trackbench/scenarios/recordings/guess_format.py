"""Guess of a recording's format, columns, units and errors, for a config that runs."""

import json
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, fields, replace
from datetime import UTC, datetime
from functools import partial
from itertools import chain, islice, pairwise
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from trackbench.core.angles import wrap_angle
from trackbench.core.arrays import Array, Index, Mask
from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.column_mapping import (
    COURSE,
    GEODETIC,
    HEMISPHERES,
    KEYS,
    STAMP_PARTS,
    UNITS,
    Naming,
    no_fix,
    outlying,
    usual_unit,
)
from trackbench.scenarios.recordings.column_names import (
    columns_of,
    looks_like,
    odometry_of,
    other_unit_of,
    ranges_of,
    rest_of_stamp,
    unit_of,
    words_of,
)
from trackbench.scenarios.recordings.csv_lines import (
    TextFormat,
    is_value,
    layout_of,
    plain_label,
    table_rows,
)
from trackbench.scenarios.recordings.csv_tables import (
    header,
    is_parquet,
    number,
    parse_cells,
    without_thousands,
)
from trackbench.scenarios.recordings.dates import instant
from trackbench.scenarios.recordings.guess_azimuths import (
    Track,
    convention_of,
    is_clockwise_by_places,
    question_on_azimuths,
)
from trackbench.scenarios.recordings.guess_doubts import (
    check_earth_centered,
    check_slant_ranges,
    check_split_angles,
    check_zones,
)
from trackbench.scenarios.recordings.guess_errors import (
    ANGLES,
    SENSORS,
    error_of_azimuth,
    joined_process_noise,
    levels_of,
    not_finer,
    scatter,
    share_of_outliers,
    shown_process_noise,
)
from trackbench.scenarios.recordings.guess_jumps import unexplained_jump
from trackbench.scenarios.recordings.guess_sample import Sample, in_option
from trackbench.scenarios.recordings.guess_time import DateForm, date_form
from trackbench.scenarios.recordings.guess_units import (
    LENGTH_UNITS,
    Candidate,
    Numbers,
    Reflection,
    agreeing_reflection,
    is_direction_of_movement,
    is_usual_speed,
    likely_units,
    look_like_degrees,
    reflection_of_course,
    usual_acceleration,
)
from trackbench.scenarios.recordings.mixtures import (
    LANDMARK_WORDS,
    is_word_column,
    joined_and_single_words,
    role_of,
)
from trackbench.scenarios.recordings.row_order import in_order
from trackbench.scenarios.recordings.rows import (
    Gathered,
    MixedRowsError,
    Rows,
    check_turns,
    chosen_runs,
    read_rows,
    usual_interval,
)

ColumnByQuantity: TypeAlias = dict[str, str]
"""Name of the column of each quantity."""
UnitByQuantity: TypeAlias = dict[str, str]
ReasonByKey: TypeAlias = dict[str, str]
"""Comments for the config on keys that are guessed."""
_TURN = 2.0 * np.pi
_MOST_SENSORS = 50
_MOST_LINES_OF_WORDS = 5
_FIRST = 200  # rows that show the format
_MOST_A_SECOND = 20
_MOST_COMPARED = 1000
"""rows that show whether those of one time are several targets"""
_TURNS_OF_ROBOT = (0.05, 2.0)
"""rad between two bearings of a landmark, that show the direction of a robot's turn"""
_FEWEST_TURNS = 10
_TIMES_APART = 3.0
"""ratio of the distance between rows of one time to that from the next time, of several targets"""
_DAY = 86400.0  # s
_HOUR = 3600.0  # s
_SUNDAY = 6
_MONTHS_OF_SPRING = (3, 4, 9, 10)
"""in which clocks are set forward, north and south of the equator"""
_LATEST_HOUR = 4
"""to which clocks are set forward"""
_LONGEST_PAUSE = 200.0 * _DAY
"""s: beyond it a pause is rather a clock that was set"""
_FEWEST_MEASURED = 5
"""rows beside which others may show that nothing was detected"""
_FEWEST_LARGEST = 3
"""equal largest ranges that may stand for none"""
_FAR_STEPS = 10.0
"""steps of nine of ten rows, from which on a position of zeros is none"""
_PLACE = ("x", "y")
_VELOCITY = ("vx", "vy")
_MEASURED = ("x", "y", "latitude", "longitude", "range", "azimuth", "bearing")
_ODOMETRY = ("v", "w")
TableContent: TypeAlias = Literal["measurements", "odometry"]
_LARGEST_OF_ROBOT = {"v": 20.0, "w": 3.5, "range": 100.0}
"""m/s, rad/s and m that nearly all of a robot's measurements are below, if no unit is named"""
_UNITS_OF_ROBOT = {
    "v": ("m/s", "km/h", "cm/s", "mm/s"),
    "w": ("rad/s", "deg/s"),
    "range": ("m", "cm", "mm", "ft"),
}
_MOST_IDS = 6  # that are shown
_LEAST_KNOWN = 0.5
"""share of a column's words that are known landmarks, if it names these"""
_GIVEN_KEYS = (
    *KEYS,
    *GEODETIC,
    *COURSE,
    *_MEASURED,
    *_VELOCITY,
    *_ODOMETRY,
)
"""Keys of `columns` that a guess may be given."""
_SENSOR_KEYS = ("landmark", "landmarks", "tag", "id", "marker", "station", "radar", "anchor")
"""Words that a user may take for the key `sensor`."""
_LARGEST_AZIMUTH_ERROR = 0.5
"""rad; azimuths with larger errors are rather those of several targets, or of another unit"""
_LONG_INTERVAL = 600.0  # s
_FASTEST_IN_KM = 400.0
"""m/s that something may have whose positions are in km without saying so"""
_LARGEST_ACCELERATION = 35.0
"""m/s^2, 3.5 times that of gravity, beyond which no vehicle turns for a quarter of the time"""
_FAST = 50.0
"""m/s, from which on positions in m may rather be in cm or mm"""
_NAMES_IN_M = frozenset({"pose", "position", "odom", "odometry", "translation", "tx", "ty", "enu"})
"""Words in names of columns whose lengths are in m by convention."""
_MOST_TANGENTIAL = 20.0
"""ratio of the ways across and along the line of sight, beyond which azimuths may have another unit"""
_WEEK = 604800.0  # s
_TIME_OF_WEEK = {"tow", "itow", "gms", "sow", "gpst", "secondsofweek"}
_SECONDS = {"seconds", "sec", "secs", "second", "t", "tow", "itow", "gms", "sow", "sod"}
_TIMES_OF_DAY = {"utc", "clock", "gmt", "uhrzeit", "heure", "hora", "klokkeslett", "local", "cet"}
_ELAPSED = {"elapsed", "duration", "split", "lap", "laptime", "elapsedtime"}
_HEADINGS = frozenset(("heading", "hdg", "headmot", "direction", "bearing"))
"""Words of columns that may have the direction in which a vehicle points."""
_TUM = ("timestamp", "tx", "ty", "tz", "qx", "qy", "qz", "qw")
"""Columns of the TUM format of trajectories."""


class SensorGuess(NamedTuple):
    """A sensor of the table."""

    name: str
    """name in the table's column of sensors, if it has one"""
    kind: str
    """type, a key of `guess_errors.SENSORS`"""
    quantities: tuple[str, ...]
    """names of the measured quantities"""
    sigmas: tuple[float, ...] = ()
    """standard deviations of the quantities' errors"""


@dataclass(frozen=True)
class Guess:
    """Guess at a table: how it is read, why so, and noise levels by sensor for a first try."""

    naming: Naming
    why: ReasonByKey
    """reason for each guessed key or unit"""
    runs: list[tuple[str, int]]
    """name and number of rows of each run, the longest first"""
    sensors: list[SensorGuess]
    speed: float
    """usual speed, m/s"""
    process_noise: float = 0.0
    """process noise that its maneuvers, or a slow target, need; 0 if that of the usual speed serves"""
    names: list[str] = field(default_factory=list)
    """all columns of the table"""
    steps: int = 0
    """different times of the longest run"""
    inputs: dict[str, float] = field(default_factory=dict)
    """standard deviations of a robot's measured speed v and turn rate w, if it is one"""
    odometry: Rows | None = None
    """rows of a robot's speed and turn rate in the longest run, in order of time"""
    interval: float = 0.0
    """usual interval of the longest run's rows, s, or steps"""
    origin: tuple[float, ...] = ()
    """latitude and longitude of the first position, deg; empty without one"""
    is_dated: bool = False
    """True if times are dates"""
    outliers: float = 0.0
    """largest share of a sensor's rows that lie far from the line between their neighbors"""
    path: str = ""
    """the table"""
    radar: Track | None = None
    """ranges and azimuths of the first sensor that measures them"""
    places: Track | None = None
    """positions of the first sensor that measures them"""
    questions: list[Place] = field(default_factory=list)
    """what the table leaves open, and a truth may decide"""
    files: tuple["Guess", ...] = ()
    """guess at each file, if there are several"""

    @property
    def each_file(self) -> tuple["Guess", ...]:
        """Guesses at the files, of which there may be one alone."""
        return self.files or (self,)

    @property
    def measures_velocity(self) -> bool:
        """True if velocities are measured beside positions."""
        is_one = [sensor.quantities for sensor in self.sensors] == [_PLACE]
        return is_one and _has_velocity(self.naming.columns)


@dataclass(frozen=True)
class RobotTables:
    """Tables beside the measurements of a robot, by which these are recognized as such."""

    odometry: Guess | None = None
    """guess at the table of speeds and turn rates"""
    landmarks: tuple[str, ...] = ()
    """plain labels of the landmarks whose places are known"""
    names_turn_rate: bool = False
    """True if the user named the column of the turn rate in the table of odometry"""

    @property
    def is_empty(self) -> bool:
        """True if there is no such table."""
        return self.odometry is None and not self.landmarks


def recognized(
    path: str,
    user_naming: Naming | None = None,
    said: Collection[str] = (),
    tables: RobotTables | None = None,
) -> Guess:
    """Guess how a table of measurements is written.

    Keys that are set in ``user_naming`` are not guessed. ``said`` are the keys that the user set, also
    to nothing, such as ``clockwise=[]``. ``tables`` are those beside it, if it is a robot's. Raises
    DataError if no column is a time, or none is measured.
    """
    naming = user_naming or Naming()
    return _recognized(path, naming, said, tables or RobotTables(), "measurements")


def recognized_odometry(path: str, user_naming: Naming | None = None) -> Guess:
    """Guess how a table of a robot's speeds and turn rates is written, which has no sensors.

    Keys that are set in ``user_naming`` are not guessed. Raises DataError if a column is missing.
    """
    return _recognized(path, user_naming or Naming(), (), RobotTables(), "odometry")


def _recognized(
    path: str,
    user_naming: Naming,
    said: Collection[str],
    tables: RobotTables,
    content: TableContent,
) -> Guess:
    """Guess how a table with this content is written; the arguments are those of `recognized`."""
    _check_given_keys(path, user_naming)
    label_columns: dict[str, str] = {}
    # A column whose words split the rows names runs or sensors. There may be one of each, so that the
    # guess is repeated with each such column.
    while True:
        try:
            with_labels = replace(user_naming, columns=user_naming.columns | label_columns)
            guess = _recognized_columns(path, with_labels, said, tables, content)
        except MixedRowsError as error:
            key = _key_of_labels(error)
            if key in label_columns or key in user_naming.columns:
                raise
            label_columns[key] = error.column
            continue
        except DataError as error:
            if not label_columns:
                raise
            raise DataError(*error.places, *_found_labels(path, label_columns)) from None
        guess.why.update(
            dict.fromkeys(label_columns, "guess: rows of one of its words agree with each other")
        )
        return guess


def _check_given_keys(path: str, user_naming: Naming) -> None:
    """Raise DataError for a column of an unknown quantity."""
    for key, column in user_naming.columns.items():
        # A quantity may have the number of its sensor before its name: 2.x.
        if key in _GIVEN_KEYS or key.rpartition(".")[2] in _MEASURED:
            continue
        what = f"there is no columns.{key}; known: {', '.join(_GIVEN_KEYS)}"
        if key.lower() in _SENSOR_KEYS:
            name = in_option(column)
            what = f"there is no columns.{key}: a column that names landmarks or sensors is"
            what += f" `--set 'columns.sensor={name}'`"
        raise DataError(Place(path, 1, 1, what))


def _found_labels(path: str, label_columns: dict[str, str]) -> list[Place]:
    """Say how to change the meaning of the columns that were taken to name runs or sensors.

    ``label_columns`` are these columns by their key, ``run`` or ``sensor``.
    """
    places = []
    for key, column in label_columns.items():
        name = in_option(column)
        other = "sensor" if key == "run" else "run"
        meaning = {"run": "targets", "sensor": "sensors or landmarks"}
        what = f"column {name} was taken to name {meaning[key]}, as its words split the rows"
        way = f"if it names {meaning[other]}, say --set 'columns.{other}={name}'"
        none = f"if neither, say --set 'columns.{key}=\"\"'"
        places.append(Place(path, 1, 1, f"{what}: {way}; {none}"))
    return places


def _key_of_labels(error: MixedRowsError) -> str:
    """Return whether a column that splits the rows names runs or sensors, as a key of `columns`.

    Raises DataError if neither is evident.
    """
    if error.role == "place":
        return "sensor"
    # Rows of one target whose errors differ in size are those of several sensors.
    if error.split == "errors" or (error.role == "sensor" and error.split == "unknown"):
        return "sensor"
    if error.role != "sensor":
        return "run"
    # The column's name says sensors, and the rows say targets.
    column = in_option(error.column)
    what = (
        f"column {column} splits the rows into parts that lie apart: are they several targets, or"
    )
    way = f"`--set 'columns.run={column}'`, `--set 'columns.sensor={column}'`, or to mix them"
    place = error.places[0]
    raise DataError(
        place._replace(
            what=f"{what} sensors of one with a bias? Say {way} `--set 'columns.run=\"\"'`"
        )
    )


def _recognized_columns(
    path: str,
    user_naming: Naming,
    said: Collection[str],
    tables: RobotTables,
    content: TableContent,
) -> Guess:
    """Guess how a table is written; raises MixedRowsError if a column splits its rows.

    ``said`` are the keys that the user set.
    """
    # Step 1: find the columns by their names.
    why: ReasonByKey = {}
    user_format = user_naming.format or TextFormat()
    form = _text_format(path, user_format, why)
    names = header(path, form)
    sample = Sample(path, names, form)
    sample.require_rows()
    for key, column in user_naming.columns.items():
        if column and column not in names:
            what = (
                f"no column {column}, which columns.{key} names; there are {', '.join(names)[:200]}"
            )
            raise DataError(Place(path, 1, 1, what))
    columns, units = _columns(sample, user_naming, why, tables, content)
    if "time" not in columns and "step" not in columns:
        _find_dates(sample, columns, why)
    if "time" not in columns and "step" not in columns:
        raise DataError(Place(path, 1, 1, _no_time(names)))
    # Step 2: find the sensors, and the form of dates.
    sensors = [SensorGuess(name="", kind="odometry", quantities=_ODOMETRY)]
    if content == "measurements":
        sensors = _sensors(sample, columns, units, user_naming)
    _check_unused(sample, columns, sensors, user_naming)
    if form.thousands and not user_format.thousands and form.decimal is None:
        _check_thousands(sample, columns, form.thousands)
    measured = set(chain.from_iterable(sensor.quantities for sensor in sensors))
    _check_named_units(sample, columns, units, measured)
    if {*_PLACE} <= measured:
        check_split_angles(sample, columns)
        check_earth_centered(sample, columns, units)
        check_zones(sample, columns, user_naming.columns)
    check_slant_ranges(sample, columns, units, user_naming.columns)
    if "time" in columns and not {"date", *STAMP_PARTS} & columns.keys():
        sample.require_two_times(columns["time"])
    clock = DateForm(user_naming.time_format, bool(user_naming.time_format))
    if "time" in columns and not clock.form:
        times = sample.cells(columns["time"])
        dates = []
        if "date" in columns:
            dates = sample.cells(columns["date"])
        words = words_of(columns["time"])
        clock = date_form(path, times, dates, sample.line, words, "time" in units)
        # A column `day` may be a number of days: only beside times of a day, and with whole dates.
        day = next((name for name in names if name.lower() == "day"), "")
        if clock.form and "%d" not in clock.form and not parse_cells(instant, sample.cells(day))[1]:
            columns["date"] = day
            clock = date_form(path, times, sample.cells(day), sample.line)
    if clock.why:
        why["time_format"] = clock.why
    # Step 3: choose the units by which times, positions and speeds agree.
    missing = user_naming.missing or _missing(sample, columns, measured, user_naming.columns)
    is_one_position = sensors[0].quantities == _PLACE and len(sensors) == 1
    has_velocity = is_one_position and _has_velocity(columns)
    with_missing = replace(user_naming, missing=missing)
    reading = _Reading(sample, columns, units, clock, with_missing, why, user_naming.columns)
    reading.check_azimuths(sensors)
    clock = reading.choose_units(sensors[0], has_velocity)
    naming = replace(
        user_naming,
        columns=columns,
        units=units,
        time_format=clock.form,
        missing=missing,
        format=form if form != TextFormat() else None,
    )
    if missing and not user_naming.missing:
        why["missing"] = "guess: far outside the others"
    # Step 4: read all rows.
    if content == "odometry":
        return replace(_odometry_guess(path, naming, why), names=names, path=path)
    guess = _measured(path, naming, why, sensors, sample, user_naming.columns, said, tables)
    return replace(guess, names=names)


def _odometry_guess(path: str, naming: Naming, why: ReasonByKey) -> Guess:
    """Read all rows of a table of odometry and return the guess with what they show."""
    rows, runs = _odometry_rows(path, naming)
    # Inputs of one run are those of every run, so the column of its name is not read.
    columns = dict(naming.columns)
    if len(runs) == 1:
        columns.pop("run", None)
        if "run" in header(path, naming.format):
            columns["run"] = ""
    naming = replace(naming, columns=columns)
    return Guess(
        naming=naming,
        why=why,
        runs=runs,
        sensors=[],
        speed=0.0,
        steps=len(np.unique(rows.ticks)),
        inputs=_sigmas_of_inputs(rows),
        odometry=rows,
        interval=usual_interval(rows.time),
    )


def _measured(
    path: str,
    naming: Naming,
    why: ReasonByKey,
    sensors: list[SensorGuess],
    sample: Sample,
    user_columns: Collection[str],
    said: Collection[str],
    tables: RobotTables,
) -> Guess:
    """Read all rows and return the guess with what they show: runs, errors, speed, further units.

    ``user_columns`` are the quantities whose columns the user named, ``said`` the keys that were set.
    ``tables`` are those beside the table.
    """
    # Angles are read as if they were not clockwise: errors and speeds of the mirror image are the same.
    # Rows far from the origin are accepted here, and reported when their run is read.
    is_robot = "bearing" in naming.columns or tables.odometry is not None
    gathered = Gathered(replace(naming, clockwise=()), refuses_far_rows=False, has_inputs=is_robot)
    units = naming.units
    columns = naming.columns
    by_name: list[str] = []
    if columns.get("sensor"):
        by_name = [sensor.name for sensor in sensors]
    quantities_by_sensor = [sensor.quantities for sensor in sensors]
    read = quantities_by_sensor
    if quantities_by_sensor == [_PLACE] and not by_name and _has_velocity(columns):
        read = [(*_PLACE, *_VELOCITY)]
    rows_by_sensor = read_rows(gathered, [path], read, names=by_name)
    gathered.check_idle_keys()
    rows_by_sensor = chosen_runs(gathered, rows_by_sensor, ())
    azimuths = _azimuths_of(quantities_by_sensor, rows_by_sensor)
    is_wide = any((np.abs(a[np.isfinite(a)]) > _TURN).any() for a in azimuths)
    angle = "bearing" if is_robot else "azimuth"
    in_degrees = angle not in units and is_wide
    scale = 1.0
    if in_degrees:
        units[angle] = "deg"
        why[angle] = "guess: there are angles beyond 2 pi"
        scale = UNITS["deg"]
    for names, rows in zip(quantities_by_sensor, rows_by_sensor, strict=True):
        if angle in names:
            scaled = rows._replace(values=rows.values * scale)
            row_of_angle = len(names) - 1
            check_turns(gathered, scaled, {angle: row_of_angle})
    # Sort the runs by length; noise and speed are those of the longest.
    rows_of_run = [np.bincount(rows.run, minlength=len(gathered.runs)) for rows in rows_by_sensor]
    sizes = np.sum(rows_of_run, axis=0)
    runs = _longest_first(gathered.runs, sizes)
    longest = []
    for sensor, rows in zip(sensors, rows_by_sensor, strict=True):
        measured = np.isfinite(rows.values[: len(sensor.quantities)]).all(axis=0)
        run_rows = rows.at(np.flatnonzero(measured & (rows.run == sizes.argmax())))
        _check_clock(gathered, run_rows)
        way = None
        if naming.same_time is None:
            way = _same_time(gathered, run_rows, sensor.kind, in_degrees)
        if way is not None:
            naming = replace(naming, same_time=way)
            gathered.naming = replace(naming, clockwise=())
            why["same_time"] = "guess: several rows of a whole second; or mean, or last"
        ordered = in_order(gathered, run_rows)
        if "run" not in user_columns:
            _check_jumps(gathered, ordered, sensor.kind, in_degrees, sample)
        if "time" not in user_columns:
            _check_daylight_saving(gathered, ordered)
        longest.append(ordered)
    # Standard deviations of the errors, and the usual speed, by each sensor.
    levels = [
        levels_of(rows, sensor.kind, in_degrees)
        for sensor, rows in zip(sensors, longest, strict=True)
    ]
    for sensor, rows in zip(sensors, longest, strict=True):
        error = error_of_azimuth(rows, sensor.kind, in_degrees)
        if error > _LARGEST_AZIMUTH_ERROR:
            what = f"{columns['azimuth']}: azimuths jump by some {np.degrees(error):.0f} deg"
            doubt = "is their unit right (units.azimuth), and are these rows of one target? Say"
            option = (
                "which column names targets, --set 'columns.run=NAME', or sensors, columns.sensor"
            )
            raise DataError(Place(path, 1, 1, f"{what}: {doubt} {option}"))
    outliers = [
        share_of_outliers(rows, sensor.kind, in_degrees)
        for sensor, rows in zip(sensors, longest, strict=True)
    ]
    speed = next((speed for _, speed in levels if speed), 0.0)
    steps = len(np.unique(np.concatenate([rows.ticks for rows in longest])))
    guesses = []
    for sensor, (sigmas, _) in zip(sensors, levels, strict=True):
        sigmas = not_finer(sigmas, sensor.quantities, naming, sample.decimals)
        guesses.append(sensor._replace(sigmas=sigmas))
    rounded_speed = float(f"{speed:.1g}") or 1.0
    noises = [
        shown_process_noise(rows, sensor.kind, in_degrees, sensor.sigmas, rounded_speed)
        for sensor, rows in zip(guesses, longest, strict=True)
    ]
    tracks: dict[str, Track] = {}
    for sensor, rows in zip(sensors, longest, strict=True):
        if sensor.kind in ("position", "range-azimuth") and sensor.kind not in tracks:
            is_radar = sensor.kind == "range-azimuth"
            tracks[sensor.kind] = _track_of(gathered, rows, scale if is_radar else 1.0)
    inputs: dict[str, float] = {}
    odometry: Rows | None = None
    if tables.odometry is not None:
        odometry = tables.odometry.odometry
        inputs = tables.odometry.inputs
        steps += tables.odometry.steps
    elif is_robot:
        odometry, _ = _odometry_rows(path, naming)
        inputs = _sigmas_of_inputs(odometry)
    guess = Guess(
        naming=naming,
        why=why,
        runs=runs,
        sensors=guesses,
        speed=rounded_speed,
        process_noise=joined_process_noise(noises, rounded_speed),
        steps=steps,
        inputs=inputs,
        interval=usual_interval(np.concatenate([rows.time for rows in longest])),
        origin=(gathered.origin or ())[:2],
        is_dated=bool(gathered.dated),
        outliers=max(outliers),
        path=path,
        radar=tracks.get("range-azimuth"),
        places=tracks.get("position"),
    )
    is_answered = "w" in user_columns or tables.names_turn_rate
    # The times of dates in two files count from different moments.
    are_comparable = tables.odometry is None or not gathered.dated
    if odometry is not None and not is_answered and are_comparable:
        bearings = []
        for sensor, rows in zip(sensors, longest, strict=True):
            if sensor.quantities[-1] == "bearing":
                bearings.append((rows.time, rows.values[len(sensor.quantities) - 1] * scale))
        _check_turns_of_robot(guess, odometry, bearings, tables.odometry)
    return _settle_azimuths(guess, [angles * scale for angles in azimuths], "clockwise" in said)


def _odometry_rows(path: str, naming: Naming) -> tuple[Rows, list[tuple[str, int]]]:
    """Read the longest run's rows with a robot's speed and turn rate, in order of time.

    Return also the name and the number of rows of each run, the longest first.
    """
    # These are no sensor's: names of sensors in the file are not looked for.
    without_sensor = replace(naming, columns=naming.columns | {"sensor": ""})
    gathered = Gathered(without_sensor, refuses_far_rows=False)
    (rows,) = read_rows(gathered, [path], [_ODOMETRY])
    sizes = np.bincount(rows.run, minlength=len(gathered.runs))
    runs = _longest_first(gathered.runs, sizes)
    is_longest_run = rows.run == sizes.argmax()
    has_all = np.isfinite(rows.values).all(axis=0)
    return in_order(gathered, rows.at(np.flatnonzero(has_all & is_longest_run))), runs


def _longest_first(names: list[str], sizes: Index) -> list[tuple[str, int]]:
    """Return the name and the number of rows of each run, the longest first."""
    return sorted(zip(names, sizes.tolist(), strict=True), key=lambda run: -run[1])


def _check_turns_of_robot(
    guess: Guess, odometry: Rows, bearings: list[tuple[Array, Array]], table: Guess | None
) -> None:
    """Raise DataError if bearings and a robot's turn rate count in opposite directions.

    While a robot turns to the left, landmarks move to its right. ``bearings`` are the times, s, and the
    bearings, rad, of each landmark. ``table`` is the guess at a table of the odometry's own.
    """
    if not len(odometry.time):
        return
    # The turn rate of a row holds since the row before.
    intervals = np.diff(odometry.time, prepend=odometry.time[0])
    heading = np.cumsum(odometry.values[1] * intervals)
    right = []
    wrong = []
    for times, angles in bearings:
        turns = np.diff(np.interp(times, odometry.time, heading))
        changes = np.diff(angles)
        is_sure = (np.abs(turns) > _TURNS_OF_ROBOT[0]) & (np.abs(turns) < _TURNS_OF_ROBOT[1])
        right += np.abs(wrap_angle(changes + turns))[is_sure].tolist()
        wrong += np.abs(wrap_angle(changes - turns))[is_sure].tolist()
    if len(right) < _FEWEST_TURNS or np.median(wrong) > 0.5 * np.median(right):
        return
    bearing = guess.naming.columns["bearing"]
    turn_rate = (table or guess).naming.columns["w"]
    key = "columns.w" if table is None else "input_naming.columns.w"
    what = f"{bearing} and {turn_rate} agree only if one of them counts clockwise"
    way = "change the signs of the one that does, as both are read anticlockwise"
    option = f"to read them as they are, say --set '{key}={in_option(turn_rate)}'"
    raise DataError(Place(guess.path, 1, 1, f"{what}: {way}; {option}"))


def _sigmas_of_inputs(rows: Rows) -> dict[str, float]:
    """Estimate the standard deviations of a robot's measured speed and turn rate."""
    sigmas = {}
    for name, values in zip(_ODOMETRY, rows.values, strict=True):
        sigmas[name] = scatter(rows.time, values)
    return sigmas


def _azimuths_of(
    quantities_by_sensor: list[tuple[str, ...]], rows_by_sensor: list[Rows]
) -> list[Array]:
    """Return the angles (R,) of each sensor that measures one, which is its last quantity."""
    azimuths = []
    for names, rows in zip(quantities_by_sensor, rows_by_sensor, strict=True):
        if names[-1] in ANGLES:
            azimuths.append(rows.values[-1])
    return azimuths


def _track_of(gathered: Gathered, rows: Rows, scale: float = 1.0) -> Track:
    """Return rows as a track; ``scale`` is the unit of their azimuths, rad."""
    time = rows.time
    if gathered.dated:
        time = time + gathered.since / 1e6
    values = np.stack([rows.values[0], rows.values[1] * scale])
    # UNIX times count from 1970, too.
    is_unix = gathered.clock is not None and gathered.clock.kind == "unix"
    return Track(time=time, values=values, is_dated=bool(gathered.dated) or is_unix)


def _settle_azimuths(guess: Guess, angles: list[Array], is_said: bool) -> Guess:
    """Return the guess with the direction from which azimuths count, or with the question if it is open.

    ``angles`` are those of each sensor that measures one, rad. ``is_said`` if the user has said the
    direction.
    """
    naming = guess.naming
    column = naming.columns.get("azimuth")
    if not angles or column is None or naming.clockwise:
        return guess
    if is_said:
        guess.why["anticlockwise"] = "azimuths count from x to y"
        return guess
    convention = convention_of(column, naming.units.get("azimuth", ""), angles)
    if guess.places is not None and convention != "named":
        settled = with_places(guess, guess.places, "the other sensor's positions show")
        if settled is not None:
            return settled
    if convention == "polar":
        guess.why["anticlockwise"] = (
            "guess: azimuths count from x to y; of radars from north say `clockwise: [azimuth]`"
        )
        return guess
    if convention == "open":
        questions = [Place(guess.path, 1, 1, line) for line in question_on_azimuths(column)]
        return replace(guess, questions=questions)
    guess.why["clockwise"] = (
        "guess: from 0 to 360 deg, as of radars; leave it out if it counts from x to y"
    )
    if convention == "named":
        guess.why["clockwise"] = "as the column's name says: from north"
    return replace(guess, naming=replace(naming, clockwise=("azimuth",)))


def with_places(guess: Guess, places: Track, reason: str) -> Guess | None:
    """Return the guess with azimuths that count as other positions show; None if these do not decide.

    ``reason`` says which positions they are.
    """
    if guess.radar is None:
        return None
    is_clockwise = is_clockwise_by_places(guess.radar, places)
    if is_clockwise is None:
        return None
    why = {name: text for name, text in guess.why.items() if name != "clockwise"}
    if is_clockwise:
        why["clockwise"] = f"as {reason}"
    else:
        why["anticlockwise"] = f"azimuths count from x to y, as {reason}"
    clockwise = ("azimuth",) if is_clockwise else ()
    naming = replace(guess.naming, clockwise=clockwise)
    return replace(guess, naming=naming, why=why, questions=[])


def _has_velocity(columns: ColumnByQuantity) -> bool:
    """Test whether there are columns of a velocity, or of speed and course."""
    return columns.keys() >= {*_VELOCITY} or columns.keys() >= {*COURSE}


def _text_format(path: str, user_format: TextFormat, why: ReasonByKey) -> TextFormat:
    """Guess the format: separator and decimal sign, header, a row of units.

    Keys that are set in ``user_format`` are not guessed. Reasons are added to ``why``.
    """
    if is_parquet(path):
        return user_format
    layout = layout_of(path, user_format)
    rows = [cells for _, cells in islice(table_rows(path, layout), _FIRST)]
    keys: dict[str, Any] = {}
    if layout.separator != ",":
        keys["separator"] = {"\t": "tab", " ": "space"}.get(layout.separator, layout.separator)
    if layout.encoding != "utf-8-sig":
        keys["encoding"] = layout.encoding
    if layout.header > 1 and not layout.is_comment:
        keys["header"] = layout.header
    # If commas separate cells, a comma in a quoted cell is a decimal sign unless three digits follow.
    cells = [cell.strip() for cell in chain.from_iterable(rows)]
    digits = r"[-+]?\d+,\d+"
    if layout.separator == ",":
        digits = r"[-+]?\d+,(\d\d?|\d{4,})"
    thousands = _thousands(cells)
    if thousands:
        keys["thousands"] = thousands
        cells = [without_thousands(cell, thousands) for cell in cells]
    if thousands != "," and any(re.fullmatch(digits, cell) for cell in cells):
        keys["decimal"] = ","
    if keys:
        why["format"] = "guess: as its first lines are"
    # A first line of values is no heading.
    if layout.header and not user_format.header and all(map(is_value, layout.names)):
        width = len(layout.names)
        # Eight columns are a trajectory in the TUM format, three a time and a position.
        names: tuple[str, ...] = ()
        if width == len(_TUM):
            names = _TUM
        elif width == 3:
            names = ("time", "x", "y")
        if not names or not _fits_names([layout.names, *rows], names):
            what = f"no line names the columns: name all {width},"
            way = "`--set 'format.names=[time, x, y, ...]'` (or latitude, longitude, range, ...)"
            raise DataError(Place(path, layout.header, 1, f"{what} {way}"))
        keys |= {"names": names, "header": 0}
        why["format"] = "guess: no line names the columns"
    elif not user_format.skip:
        skip = _lines_of_words(rows)
        if skip:
            what = "is a line of units" if skip == 1 else f"are {skip} lines of words"
            keys["skip"] = skip
            why["format"] = f"guess: below the names {what}"
    user_keys = {field.name for field in fields(user_format) if getattr(user_format, field.name)}
    guessed = {key: value for key, value in keys.items() if key not in user_keys}
    return replace(user_format, **guessed)


def _fits_names(rows: list[list[str]], names: tuple[str, ...]) -> bool:
    """Test whether rows without a line of names may have a time and a position, or a TUM trajectory.

    Times must not fall. Three columns must not be degrees, by their digits, nor may another column be
    at equal intervals if the first is not. The last four columns of a trajectory are a unit quaternion.
    """
    if len(names) == 3:
        places = list(chain.from_iterable(row[1:] for row in rows))
        if all(re.fullmatch(r" *-?\d{1,3}\.\d{4,} *", cell) for cell in places):
            return False
    complete_rows = [row for row in rows if len(row) == len(names)]
    cells = [cell.strip().replace(",", ".") for cell in chain.from_iterable(complete_rows)]
    numbers = parse_cells(number, cells)[0].reshape(len(complete_rows), len(names)).T
    if len(names) == len(_TUM):
        size = np.sqrt(np.square(numbers[4:]).sum(axis=0))
        return bool((np.abs(size - 1.0) < 0.05).mean() > 0.9)
    intervals = np.diff(numbers, axis=1)
    usual = np.median(intervals, axis=1)
    # Written times are rounded, and some rows may be missing.
    near_usual = np.abs(intervals - usual[:, None]) <= 0.1 * np.abs(usual[:, None])
    is_clock = (near_usual.mean(axis=1) > 0.8) & (usual > 0.0) & (intervals >= 0.0).all(axis=1)
    return bool(is_clock[0] or not is_clock[1:].any())


def _thousands(cells: list[str]) -> str:
    """Return the mark between groups of three digits; empty without one.

    A cell shows it if the mark is twice in a number, or once and before a decimal sign.
    """
    for mark, decimal in ((".", ","), (",", "."), ("'", ".")):
        # 1.234.567 and 1.234,5
        twice = rf"[-+]?\d{{1,3}}({re.escape(mark)}\d{{3}}){{2,}}({re.escape(decimal)}\d*)?"
        once = rf"[-+]?\d{{1,3}}{re.escape(mark)}\d{{3}}{re.escape(decimal)}\d+"
        if any(re.fullmatch(twice, cell) or re.fullmatch(once, cell) for cell in cells):
            return mark
    return ""


def _check_thousands(sample: Sample, columns: ColumnByQuantity, mark: str) -> None:
    """Raise DataError for each column in which the mark may separate thousands or decimals.

    All its cells then have the mark once, before three digits.
    """
    numeric = {"time", *_MEASURED, "speed", "course", *_VELOCITY}
    mistakes = []
    for name, column in columns.items():
        if name not in numeric:
            continue
        cells = [cell for cell in sample.cells(column) if cell]
        once = rf"[-+]?[1-9]\d{{0,2}}{re.escape(mark)}\d{{3}}"
        if cells and all(re.fullmatch(once, cell) for cell in cells):
            what = f"{column}: {cells[0]} may be a thousand times as large, as other columns"
            way = "have marks between thousands: write the numbers of the file without them"
            mistakes.append(Place(sample.path, sample.line, 1, f"{what} {way}"))
    if mistakes:
        raise DataError(*mistakes)


def _lines_of_words(rows: list[list[str]]) -> int:
    """Return the number of rows of words above the first values.

    0 if there are too many, or if one of them is empty.
    """
    for count, row in enumerate(rows[: _MOST_LINES_OF_WORDS + 1]):
        if any(map(is_value, row)):
            return count
        if not any(map(str.strip, row)):
            return 0
    return 0


def _columns(
    sample: Sample,
    user_naming: Naming,
    why: ReasonByKey,
    tables: RobotTables,
    content: TableContent,
) -> tuple[ColumnByQuantity, UnitByQuantity]:
    """Return columns and units by quantity, guessed from the names of columns and a line of units.

    Reasons are added to ``why``.
    """
    columns = {name: named.column for name, named in columns_of(sample.names).items()}
    user_columns = user_naming.columns
    columns = {n: c for n, c in columns.items() if c not in user_columns.values()} | user_columns
    # An empty name means that no column is this quantity; of runs and sensors that their rows are mixed.
    columns = {n: c for n, c in columns.items() if c or n in ("run", "sensor")}
    for key, column in _hemispheres(sample, columns).items():
        columns = {n: c for n, c in columns.items() if c != column} | {key: column}
    # Two components of a velocity come before speed and course, a time before numbers of steps.
    if columns.keys() >= {*_VELOCITY}:
        columns = {name: column for name, column in columns.items() if name not in COURSE}
    if "date" in columns and "time" not in columns:
        columns["time"] = columns.pop("date")
    if "time" in columns:
        columns.pop("step", None)
    _settle_twice_named(columns, user_naming)
    is_robot = True
    if content == "odometry":
        _settle_odometry(sample, columns)
    else:
        is_robot = _settle_landmarks(sample, columns, user_naming, tables)
    # A column of sensors has a few words; one of runs has at least three rows for each on average.
    most_runs = max(1, len(sample) // 3)
    for key, least, most in (("sensor", 2, _MOST_SENSORS), ("run", 1, most_runs)):
        words = set(sample.cells(columns.get(key, "")))
        if key == "sensor" and is_robot:
            words.discard("")  # of rows with odometry alone
            if tables.landmarks:
                least = 1
        if key not in user_naming.columns and ("" in words or not least <= len(words) <= most):
            columns.pop(key, None)
    units = {}
    for name, column in columns.items():
        unit = unit_of(column, name)
        if unit is not None:
            units[name] = unit
    why |= dict.fromkeys(units, "as the column's name says")
    for name, column in columns.items():
        unit = sample.unit(column, name)
        if unit is not None:
            units[name] = unit
            why[name] = "as the line of units says"
    units |= user_naming.units
    if is_robot:
        _guess_units_of_robot(sample, columns, units, why)
    return columns, units


def _find_dates(sample: Sample, columns: ColumnByQuantity, why: ReasonByKey) -> None:
    """Add the time to the columns if it is the only column whose cells are dates."""
    dated = []
    for name in sample.names:
        cells = sample.cells(name)
        # 2025-04-03 has digits with a separator; 20250403 may be a number.
        has_separators = all(re.search(r"\d\D+\d", cell) for cell in cells)
        _, no_dates = parse_cells(instant, cells)
        if cells and has_separators and not no_dates:
            dated.append(name)
    if len(dated) == 1:
        columns["time"] = dated[0]
        why["time_column"] = "guess: its cells are dates"


def _guess_units_of_robot(
    sample: Sample, columns: ColumnByQuantity, units: UnitByQuantity, why: ReasonByKey
) -> None:
    """Add the units of a robot's measurements that the names of their columns do not have.

    Raises DataError if the numbers are too large for SI units.
    """
    for name, (si, *others) in _UNITS_OF_ROBOT.items():
        if name in units or name not in columns:
            continue
        numbers = np.abs(sample.numbers(columns[name]))
        size = 0.0
        if np.isfinite(numbers).any():
            size = float(np.nanquantile(numbers, 0.9))
        if size > _LARGEST_OF_ROBOT[name]:
            options = " or ".join(f"--set units.{name}={unit}" for unit in (*others, si))
            what = f"{columns[name]}: no unit is named, and {size:.3g} {si} is unusual for a robot"
            raise DataError(Place(sample.path, 1, 1, f"{what}: say {options}"))
        units[name] = si
        why[name] = f"guess: nine of ten are below {size:.2g}"


def _check_named_units(
    sample: Sample, columns: dict[str, str], units: dict[str, str], measured: set[str]
) -> None:
    """Raise DataError for each column with a unit that no recording may have.

    The unit stands in the column's name or in a line of units. ``columns`` and ``units`` are by
    quantity. Only columns that are read count: those of the ``measured`` quantities, of velocities, of
    a robot's inputs and of times.
    """
    read = {*measured, *_VELOCITY, *COURSE, *_ODOMETRY, "time"}
    if not {*_PLACE} <= columns.keys():
        read |= {*GEODETIC[:2]}
    mistakes = []
    for name, column in columns.items():
        if name not in read or name in units or column not in sample.names:
            continue
        other = other_unit_of(column) or sample.other_unit(column)
        if other is not None:
            what = f"{column}: the unit {other.replace('*', ' ')} is unknown here"
            unit = _UNITS_OF_ROBOT[name][0] if name in _ODOMETRY else usual_unit(name)
            example = f"--set units.{name}={unit}"
            way = f"write the numbers in a known unit, and say it, such as {example}"
            mistakes.append(Place(sample.path, 1, 1, f"{what}: {way}"))
    if mistakes:
        raise DataError(*mistakes)


def _check_unused(
    sample: Sample, columns: ColumnByQuantity, sensors: list[SensorGuess], user_naming: Naming
) -> None:
    """Raise DataError if only angles or only ranges are read, and another column may be the other part.

    The name of such a column has a word or a unit of a range or of an angle. ``user_naming`` may already
    say which column is the other part, or that none is.
    """
    if len(sensors) > 1:
        return
    # Quantity that a sensor of each kind may measure, too.
    other_part = {"bearing": "range", "range": "azimuth", "landmark-bearing": "range"}
    quantity = other_part.get(sensors[0].kind)
    if quantity is None or quantity in user_naming.columns:
        return
    candidates = []
    for name in sample.names:
        has_numbers = np.isfinite(sample.numbers(name)).any()
        if name in columns.values() or not has_numbers or role_of(name) == "quality":
            continue
        if looks_like(name, quantity):
            candidates.append(in_option(name))
    if candidates:
        measured = columns[sensors[0].quantities[-1]]
        ways = " or ".join(f"--set 'columns.{quantity}={name}'" for name in candidates)
        what = f"only {measured} is recognized as measured; is {' or '.join(candidates)} the {quantity}?"
        way = f"Say {ways}, or --set 'columns.{quantity}=\"\"' if none is"
        raise DataError(Place(sample.path, 1, 1, f"{what} {way}"))


def _hemispheres(sample: Sample, columns: ColumnByQuantity) -> dict[str, str]:
    """Find the columns of the letters N and S, and E and W, beside latitude and longitude.

    Return them by their key of `columns`, ``north_south`` or ``east_west``.
    """
    hemispheres: dict[str, str] = {}
    for quantity, (key, positive, negative) in HEMISPHERES.items():
        if quantity not in columns or key in columns:
            continue
        for name in sample.names:
            words = {cell.lower() for cell in sample.cells(name)} - {""}
            if name != columns[quantity] and words and words <= {*positive, *negative}:
                hemispheres.setdefault(key, name)
    return hemispheres


def _settle_twice_named(columns: ColumnByQuantity, user_naming: Naming) -> None:
    """Decide, in place, which quantity a column is that may be two.

    A track may be a course or a run, and an id may name runs or sensors.
    """
    run = columns.get("run")
    if run is None or "run" in user_naming.columns:
        return
    if run == columns.get("course"):
        # Beside a speed a track is a course; else it names what moves.
        if "speed" in columns:
            columns.pop("run")
        else:
            columns.pop("course")
    elif run == columns.get("sensor"):
        columns.pop("run")


def _settle_odometry(sample: Sample, columns: ColumnByQuantity) -> None:
    """Leave the columns of times, runs, speed and turn rate, in place.

    Raises DataError if the speed or the turn rate is missing.
    """
    named = {quantity: column.column for quantity, column in odometry_of(sample.names).items()}
    for name in [*columns]:
        if name not in (*KEYS, *_ODOMETRY) or name == "sensor":
            columns.pop(name)
    for name in _ODOMETRY:
        if name in named:
            columns.setdefault(name, named[name])
    if not columns.keys() >= {*_ODOMETRY}:
        raise DataError(Place(sample.path, 1, 1, _no_odometry(sample, columns)))


def _no_odometry(sample: Sample, columns: ColumnByQuantity) -> str:
    """Return the message and the advice for a table in which a speed or a turn rate is missing."""
    missing = [name for name in _ODOMETRY if name not in columns]
    meaning = {"v": "the robot's speed (v)", "w": "its turn rate (w)"}
    words = " and ".join(meaning[name] for name in missing)
    options = " ".join(f"--set 'columns.{name}=ITS NAME'" for name in missing)
    known = ", ".join(sample.names)[:200]
    what = f"no column looks like {words}, by which the robot's heading moves on; there are {known}"
    return f"{what}: say {options}"


def _settle_landmarks(
    sample: Sample, columns: ColumnByQuantity, user_naming: Naming, tables: RobotTables
) -> bool:
    """Return whether the table is the log of a robot, whose bearings count from its heading.

    The ``columns`` of such a log are changed in place. Raises DataError with the possible answers if
    ``user_naming`` must say so, as a table does not show from where bearings count.
    """
    odometry = odometry_of(sample.names)
    has_odometry = odometry.keys() >= {*_ODOMETRY} or tables.odometry is not None
    is_like_robot = "bearing" in columns or has_odometry or bool(tables.landmarks)
    place = _landmark_column(sample, columns, user_naming, is_like_robot, tables.landmarks)
    # Rows are split by landmark unless the user has named another column of sensors.
    is_split = place is not None and user_naming.columns.get("sensor", place) == place
    angle = columns.get("azimuth")
    if tables.landmarks and angle is not None and "azimuth" not in user_naming.columns:
        columns.setdefault("bearing", angle)
    if "bearing" not in columns and (angle is not None or tables.is_empty):
        if angle is None:
            return False
        if "azimuth" in user_naming.columns or not (is_split or has_odometry):
            _check_names_of_ids(sample, columns, user_naming)
            if tables.is_empty:
                return False
            what = (
                "columns.azimuth: is of fixed sensors, and --input and --landmarks are of a robot"
            )
            raise DataError(Place(sample.path, 1, 1, f"{what}: leave out one of them"))
        column = in_option(angle)
        landmarks = f" of the landmarks ({place})" if is_split else ""
        what = f"{angle}: do the bearings{landmarks} count from the robot's heading?"
        other = "or do fixed sensors, such as radars, measure the direction to what moves, "
        other += "from the axis x or from north?"
        raise DataError(
            Place(sample.path, 1, 1, f"{what} Say --set 'columns.bearing={column}'"),
            Place(sample.path, 1, 1, f"{other} Say --set 'columns.azimuth={column}'"),
        )
    # A robot's log: its own motion comes from odometry.
    if place is not None and is_split:
        columns["sensor"] = place
        if columns.get("run") == place:
            columns.pop("run")
    for name in ("azimuth", *COURSE, *_VELOCITY):
        columns.pop(name, None)
    if tables.odometry is not None:
        named = [name for name in _ODOMETRY if name in user_naming.columns]
        if named:
            what = f"columns.{named[0]}: the inputs are those of the file --input"
            way = f"say --set 'input_naming.columns.{named[0]}=ITS NAME'"
            raise DataError(Place(sample.path, 1, 1, f"{what}: {way}"))
        return True
    for name, named_column in odometry.items():
        columns.setdefault(name, named_column.column)
    if not columns.keys() >= {*_ODOMETRY}:
        way = "of odometry in another file, name that, --input FILE (docs/your-robot.md)"
        raise DataError(Place(sample.path, 1, 1, f"{_no_odometry(sample, columns)}; {way}"))
    return True


def _check_names_of_ids(sample: Sample, columns: ColumnByQuantity, user_naming: Naming) -> None:
    """Raise DataError if a column such as id or tag may name targets, sensors or landmarks.

    Azimuths to several of them do not show which of these they are. The user may say so.
    """
    if not {"run", "sensor"}.isdisjoint(user_naming.columns):
        return
    angle = in_option(columns["azimuth"])
    for name in sample.names:
        if name in columns.values() and name not in (columns.get("run"), columns.get("sensor")):
            continue
        words = sample.words(name)
        is_id = not LANDMARK_WORDS.isdisjoint(joined_and_single_words(name))
        if not is_id or len(words) < 2 or not is_word_column(sample.cells(name)):
            continue
        column = in_option(name)
        azimuth = f"--set 'columns.azimuth={angle}'"
        shown = ", ".join(words[:_MOST_IDS])
        if len(words) > _MOST_IDS:
            shown += ", ..."
        lines = [
            f"{name}: are {shown} landmarks that a robot sees? Say --set 'columns.bearing={angle}',"
            " and name its odometry, --input FILE",
            f"or targets, of a radar? Say {azimuth} --set 'columns.run={column}'",
            f"or sensors, which see one target? Say {azimuth} --set 'columns.sensor={column}'",
        ]
        raise DataError(*(Place(sample.path, 1, 1, line) for line in lines))


def _landmark_column(
    sample: Sample,
    columns: ColumnByQuantity,
    user_naming: Naming,
    is_like_robot: bool,
    landmarks: Collection[str],
) -> str | None:
    """Return the column that names landmarks; None without one.

    Its name says so, or its words are those of known ``landmarks``. In the log of a robot
    (``is_like_robot``) it may also have another name, such as tag or id, if its cells are empty just
    where nothing was measured.
    """
    if landmarks and "sensor" not in user_naming.columns:
        shares = {}
        for name in sample.names:
            words = {plain_label(word) for word in sample.words(name)}
            shares[name] = len(words.intersection(landmarks)) / max(len(words), 1)
        best = max(sample.names, key=shares.__getitem__)
        if shares[best] >= _LEAST_KNOWN:
            return best
    for name in sample.names:
        if role_of(name) == "place":
            return name
    if not is_like_robot or "sensor" in user_naming.columns:
        return None
    measured = np.zeros(len(sample), dtype=np.bool_)
    for quantity in ("range", "azimuth", "bearing"):
        if quantity in columns:
            measured |= np.isfinite(sample.numbers(columns[quantity]))
    quantities = {name: c for name, c in columns.items() if name not in ("run", "sensor")}
    free = [name for name in sample.names if name not in quantities.values()]
    fitting = []
    for name in free:
        cells = sample.cells(name)
        is_named = np.array([cell != "" for cell in cells], dtype=np.bool_)
        if np.array_equal(is_named, measured) and is_word_column(cells):
            fitting.append(name)
    for name in fitting:
        is_id = not LANDMARK_WORDS.isdisjoint(joined_and_single_words(name))
        if is_id and name not in user_naming.columns.values():
            return name
    # Without such a word the empty cells must show it.
    if len(fitting) == 1 and not measured.all() and fitting[0] not in user_naming.columns.values():
        return fitting[0]
    return None


def _no_time(names: list[str]) -> str:
    """Return the message and the advice for a table in which no column looks like a time."""
    what = f"no column looks like a time or a step; there are {', '.join(names)[:200]}"
    if {"year", "month", "day"} <= {name.lower() for name in names}:
        return f"{what}: join the parts of dates into one column, 2025-04-03 10:00:00"
    way = (
        f"say which is one, `--set 'columns.time={names[0]}'` (or columns.step), or number the rows"
    )
    if any(map(is_value, names)):
        way += f", or name all {len(names)} if no line does, `--set 'format.names=[time, x, y]'`"
    return f"{what}: {way}"


def _sensors(
    sample: Sample,
    columns: ColumnByQuantity,
    units: UnitByQuantity,
    user_naming: Naming,
) -> list[SensorGuess]:
    """Return the guessed sensors of a table, those first whose columns ``user_naming`` has.

    Columns of ranges to several places are added to ``columns``, and their units to ``units``. Raises
    DataError if a sensor measures nothing that is known.
    """
    # Quantities by row: a position is x and y, or latitude and longitude.
    numbers = {n: np.isfinite(sample.numbers(c)) for n, c in columns.items() if n in _MEASURED}
    if not numbers.keys() >= {*_PLACE} and numbers.keys() >= {*GEODETIC[:2]}:
        numbers["x"] = numbers["longitude"]
        numbers["y"] = numbers["latitude"]
    # Names of the sensors; a table without them has one sensor.
    words = [""]
    if columns.get("sensor"):
        words = sample.words(columns["sensor"])
    # The most telling type of sensor counts, but one whose columns the user names comes first.
    answered = {*user_naming.columns}
    if answered & {*GEODETIC[:2]}:
        answered |= {*_PLACE}
    kinds = sorted(SENSORS.items(), key=lambda kind: -len(answered.intersection(kind[1])))
    sensors = []
    for word in words:
        cells = sample.cells(columns.get("sensor", ""))
        rows = np.array([cell == word or not word for cell in cells], dtype=np.bool_)
        if answered.isdisjoint((*_PLACE, "range", "azimuth", "bearing")):
            _check_one_kind(sample.path, columns, numbers, rows)
        for kind, quantities in kinds:
            if all(name in numbers and (numbers[name] & rows).any() for name in quantities):
                sensors.append(SensorGuess(name=word, kind=kind, quantities=quantities))
                break
    has_position = {"x", "y"} <= numbers.keys() or {"range", "azimuth"} <= numbers.keys()
    ranges = {} if has_position else ranges_of(sample.names)
    if ranges and words == [""]:
        columns.pop("range", None)
        sensors = []
        for number, (name, named) in enumerate(ranges.items(), 1):
            quantity = f"{number}.range"
            columns[quantity] = named.column
            sensors.append(SensorGuess(name=name.upper(), kind="range", quantities=(quantity,)))
            if named.unit is not None:
                units[quantity] = named.unit
    if len(sensors) < len(words):
        measuring = {sensor.name for sensor in sensors}
        idle = [word for word in words if word not in measuring]
        if columns.keys() >= {"sensor", "bearing", *_ODOMETRY} and sensors:
            what = (
                f"{columns['sensor']}: rows of {', '.join(idle)[:80]} have no range and no bearing"
            )
            way = "leave this cell of theirs empty, as rows of odometry alone see no landmark"
            raise DataError(Place(sample.path, 1, 1, f"{what}; {way}"))
        raise DataError(Place(sample.path, 1, 1, _no_position(columns, sample)))
    return sensors


def _check_one_kind(
    path: str, columns: ColumnByQuantity, numbers: dict[str, Mask], rows: Mask
) -> None:
    """Raise DataError if rows have a position as well as a range and an azimuth.

    One of them may be the truth of the other. ``numbers`` has the rows (R,) in which each quantity is a
    number, and ``rows`` (R,) are those of one sensor.
    """
    radar = ("range", "azimuth")
    for names in (_PLACE, radar):
        if not all(name in numbers and (numbers[name] & rows).any() for name in names):
            return
    positions = ("x", "y") if columns.keys() >= {*_PLACE} else GEODETIC[:2]
    ways = []
    for names in (radar, positions):
        options = (f"--set 'columns.{n}={in_option(columns[n])}'" for n in names)
        ways.append(" ".join(options))
    what = f"the rows have {columns['range']} and {columns['azimuth']}, and also"
    what += f" {columns[positions[0]]} and {columns[positions[1]]}: which ones were measured?"
    raise DataError(
        Place(path, 1, 1, f"{what} Say {ways[0]}"),
        Place(path, 1, 1, f"or say {ways[1]}; the others may be a truth in a file of their own"),
    )


def _no_position(columns: ColumnByQuantity, sample: Sample) -> str:
    """Return the message and the advice for a table, or a sensor of it, without measured quantities."""
    pairs = "x and y, latitude and longitude, range and azimuth, or range"
    names = sample.names
    known = ", ".join(names)[:200]
    # Case 1: a column has the name of a measured quantity, and no numbers.
    for name in filter(columns.get, _MEASURED):
        cell = next((cell for cell in sample.cells(columns[name]) if cell), "")
        if cell and not np.isfinite(sample.numbers(columns[name])).any():
            what = f"{columns[name]}: {cell[:40]!r} is not a number, nor is any other of its cells"
            return f"{what}: write decimal numbers, such as -8.5042, without letters"
    # Case 2: coordinates of another kind.
    if any("ecef" in "".join(words_of(name)) for name in names):
        what = "coordinates from the center of the Earth (ECEF) are not read; there are"
        way = "convert them to latitude and longitude (EPSG:4978 to EPSG:4326)"
        return f"{what} {known}: {way}"
    # Case 3: a cell is 54.32, 10.13.
    for name in names:
        if any(re.fullmatch(r"-?\d+\.\d+, *-?\d+\.\d+", cell) for cell in sample.cells(name)[:1]):
            return f"column {name} has two numbers in a cell: give each a column, latitude and longitude"
    # Case 4: a sensor, or the whole table, measures nothing that is known.
    if columns.get("sensor"):
        words = ", ".join(sample.words(columns["sensor"]))[:80]
        what = f"column {columns['sensor']} names {words}, and one of them has no {pairs}"
        return f"{what}; there are {known}: `--set 'columns.sensor=\"\"'` mixes all"
    # Case 5: the odometry of a robot has no measurements.
    odometry = odometry_of(names)
    if odometry.keys() >= {*_ODOMETRY}:
        shown = " and ".join(named.column for named in odometry.values())
        what = f"this table has inputs, {shown}, and no measurements"
        way = "name the table of what the robot measured, --from MEASUREMENTS"
        return f"{what}: {way} --input {sample.path} (docs/your-robot.md)"
    way = f"say which are, `--set 'columns.x={names[0]}' --set 'columns.y={names[-1]}'`"
    return f"no columns look like {pairs}; there are {known}: {way}"


class _Reading:
    """Choice of the units of a table, whose columns are known."""

    def __init__(
        self,
        sample: Sample,
        columns: ColumnByQuantity,
        units: UnitByQuantity,
        clock: DateForm,
        with_missing: Naming,
        why: ReasonByKey,
        user_columns: Collection[str],
    ) -> None:
        """Begin with the known ``units``, to which the methods add, with reasons in ``why``.

        ``clock`` is the form of dates, ``with_missing`` has the numbers that stand for missing cells.
        """
        self._user_columns = user_columns
        self._sample = sample
        self._clock = clock
        self._why = why
        self._columns = columns
        self._units = units
        self._with_missing = with_missing
        self._chosen_rows: Mask = np.array([], dtype=np.bool_)
        """rows of one target and sensor, by which units are chosen"""

    def choose_units(self, sensor: SensorGuess, has_velocity: bool) -> DateForm:
        """Add the likeliest units to the known ones; return the form of dates.

        ``sensor`` is the first sensor. The columns of a velocity that disagrees with the positions are
        removed. Raises DataError with a line for each candidate if several are equally likely.
        """
        numbers = self._numbers(sensor)
        clocks: dict[str, tuple[float, float]] = {}
        if self._clock.other:
            clocks = self._clocks()
        known_units = self._known_units(sensor)
        if numbers.is_angle and numbers.velocity is not None:
            numbers = self._with_north_first(numbers, known_units, clocks)
        first, *others = likely_units(numbers, known_units, clocks)
        self._check_bearings(sensor, numbers, first)
        if has_velocity and not (first.agrees and first.same_way):
            self._check_reflections(numbers, known_units)
        if sensor.quantities == _PLACE:
            self._check_course(numbers, first)
        questions = []
        if others:
            questions = self._questions([first, *others], numbers)
        for candidate in (first, *others):
            question = self._question_on_length(candidate, numbers, known_units, bool(others))
            if question is not None:
                questions.append(question)
                break
        if questions:
            raise DataError(*questions)
        self._write(first, numbers)
        if has_velocity and not first.same_way:
            for name in {*_VELOCITY, *COURSE} & self._columns.keys():
                self._columns.pop(name)
                self._units.pop(name, None)
            self._why["velocity"] = "velocities are left out: they disagree with the positions"
        # The chosen one of two forms of dates; it is empty for the form that the clock has already.
        if first.time in clocks and first.time:
            if first.time == "s":
                return DateForm()
            self._why["time_format"] = f"guess: {self._reason(first)}"
            return self._clock._replace(form=first.time)
        return self._clock

    def _check_bearings(self, sensor: SensorGuess, numbers: Numbers, chosen: Candidate) -> None:
        """Raise DataError for a bearing beside a position if it is not the direction of movement.

        It may then be measured from there, as by a ship with a sonar. A column that the user named, or
        one that is a course beside a speed, is no question.
        """
        columns = self._columns
        bearing = columns.get("azimuth")
        is_answered = not {*_PLACE, *GEODETIC[:2]}.isdisjoint(self._user_columns)
        if sensor.quantities != _PLACE or bearing is None or "speed" in columns or is_answered:
            return
        angles = self._values("azimuth")[self._chosen_rows]
        unit = self._unit_of_angles("azimuth", angles)
        if is_direction_of_movement(numbers, chosen, angles * UNITS[unit]):
            return
        names = _PLACE if columns.keys() >= {*_PLACE} else GEODETIC[:2]
        places = " and ".join(columns[name] for name in names)
        what = f"{bearing} is not the direction in which {places} move: was it measured from there?"
        way = f"Say --set 'columns.azimuth={in_option(bearing)}'"
        way += ", and give the sensor this path (`platform`)"
        options = [f"--set 'columns.{name}={in_option(columns[name])}'" for name in names]
        option = f"if positions were measured, say {' '.join(options)}"
        raise DataError(Place(self._sample.path, self._sample.line, 1, f"{what} {way}; {option}"))

    def _with_north_first(
        self,
        numbers: Numbers,
        known_units: dict[str, str],
        clocks: dict[str, tuple[float, float]],
    ) -> Numbers:
        """Return the numbers with vx and vy exchanged, if only then they are the movement's.

        Autopilots name the velocity to the north vx. Latitudes and longitudes leave no doubt of axes.
        """
        first = likely_units(numbers, known_units, clocks)[0]
        if (first.agrees and first.same_way) or numbers.velocity is None:
            return numbers
        exchanged = replace(numbers, velocity=numbers.velocity[::-1])
        other = likely_units(exchanged, known_units, clocks)[0]
        change = agreeing_reflection(numbers, known_units)
        is_answered = not {*_VELOCITY}.isdisjoint(self._user_columns)
        if not (other.agrees and other.same_way) or change is not None or is_answered:
            return numbers
        columns = self._columns
        units = self._units
        columns["vx"], columns["vy"] = columns["vy"], columns["vx"]
        for name, partner in (_VELOCITY, _VELOCITY[::-1]):
            if name in known_units:
                units[partner] = known_units[name]
        self._why["exchanged"] = f"{columns['vy']} points north, as the positions show"
        return exchanged

    def _check_reflections(self, numbers: Numbers, known_units: dict[str, str]) -> None:
        """Raise DataError if a speed and course agree with exchanged or mirrored positions alone."""
        change = agreeing_reflection(numbers, known_units)
        if change is not None:
            velocity = [name for name in (*COURSE, *_VELOCITY) if name in self._columns]
            raise DataError(self._question_on_axes(change, velocity))

    def _check_course(self, numbers: Numbers, chosen: Candidate) -> None:
        """Raise DataError if a course without a speed is the direction of changed positions alone.

        The heading of a vehicle is no course: it may count from x, and is not read without a speed.
        """
        column = self._columns.get("course")
        if column is None or numbers.course is None or numbers.speed is not None:
            return
        if not _HEADINGS.isdisjoint(words_of(column)) and not numbers.is_angle:
            return
        unit = self._unit_of_angles("course", numbers.course)
        change = reflection_of_course(numbers, chosen, numbers.course * UNITS[unit])
        if change is not None:
            raise DataError(self._question_on_axes(change, ["course"]))

    def _question_on_axes(self, change: Reflection, velocity: list[str]) -> Place:
        """Ask which of positions and velocities are right, if they agree only after a change.

        ``velocity`` are the quantities of the velocity.
        """
        names = ("longitude", "latitude")
        positive = ("east", "north")
        if {*_PLACE} <= self._columns.keys():
            names = _PLACE
        east, north = (self._columns[name] for name in names)
        first, second = sorted((east, north), key=self._sample.names.index)
        measured = " and ".join(self._columns[name] for name in velocity)
        agree = "agrees" if len(velocity) == 1 else "agree"
        leave_out = " ".join(f"--set 'columns.{name}=\"\"'" for name in velocity)
        signs = (change.sign_of_east, change.sign_of_north)
        if change.exchanged and signs == (1.0, 1.0):
            what = f"{first} and {second} agree with {measured} only if they are exchanged"
            options = f"--set 'columns.{names[0]}={in_option(north)}'"
            options += f" --set 'columns.{names[1]}={in_option(east)}'"
            way = f"say {options}"
            if names == _PLACE:
                way = f"if {east} points north and {north} east, {way}"
        elif change.exchanged:
            what = f"{measured} {agree} with {first} and {second} only after a quarter turn"
            way = f"turn the axes, so that {names[0]} is positive to the east"
            way += f" and {names[1]} to the north"
        elif signs == (-1.0, -1.0):
            what = f"{measured} {agree} with {first} and {second} only in the opposite direction"
            way = "correct the signs, or turn the directions by 180 deg"
        else:
            is_east = change.sign_of_east < 0.0
            column = east if is_east else north
            what = f"{column} agrees with {measured} only with the opposite sign"
            direction = "west" if is_east else "south"
            way = f"write degrees to the {direction} as negative numbers"
            if names == _PLACE:
                way = f"change its sign, so that it is positive to the {positive[not is_east]}"
        if names == _PLACE:
            way += f"; if {measured} counted otherwise, convert them"
        what = f"{what}: {way}, or leave {'it' if len(velocity) == 1 else 'the velocities'} out"
        return Place(self._sample.path, self._sample.line, 1, f"{what}, {leave_out}")

    def check_azimuths(self, sensors: list[SensorGuess]) -> None:
        """Raise DataError if azimuths without a unit may be in radians as well as in degrees.

        Numbers within a turn are taken for radians. Then a target that moves nearly always across the
        line of sight may rather have azimuths in degrees.
        """
        is_radar = [sensor.kind for sensor in sensors] == ["range-azimuth"]
        if not is_radar or "azimuth" in self._units:
            return
        azimuth = self._values("azimuth")
        ranges = self._values("range")
        known = np.flatnonzero(np.isfinite(azimuth) & np.isfinite(ranges))
        azimuth = azimuth[known]
        if len(known) < 3 or (np.abs(azimuth) > _TURN).any():
            return
        ranges = ranges[known]
        across = np.median(np.abs(np.diff(azimuth)) * ranges[1:])
        along = np.median(np.abs(np.diff(ranges)))
        if across > _MOST_TANGENTIAL * along:
            what = f"{self._columns['azimuth']}: no unit is named, and its numbers may be degrees"
            way = "say --set units.azimuth=deg or --set units.azimuth=rad"
            raise DataError(Place(self._sample.path, 1, 1, f"{what} or radians: {way}"))
        self._units["azimuth"] = "rad"
        self._why["azimuth"] = "guess: there is no angle beyond 2 pi"

    def _question_on_length(
        self,
        chosen: Candidate,
        numbers: Numbers,
        known_units: UnitByQuantity,
        has_others: bool,
    ) -> Place | None:
        """Ask for the unit of lengths if none is named, and in meters the speed would be unusual.

        It is also asked if another unit is as likely, unless there are other choices of units to ask for
        (``has_others``). ``chosen`` is a likely choice of units for the ``numbers``. None if there is
        nothing to ask; a range without a unit then gets the unit m.
        """
        names = [name for name in ("x", "y", "range", "1.range") if name in self._columns]
        is_named = not {"x", "range"}.isdisjoint(known_units)
        if chosen.as_angle or numbers.is_angle or not names or is_named or chosen.agrees:
            return None
        speed = chosen.usual_speed
        other_units: list[str] = []
        if is_usual_speed(speed) and not has_others:
            other_units = self._other_lengths(chosen, numbers)
        if not np.isfinite(speed) or (is_usual_speed(speed) and not other_units):
            # The config must have a unit of a range; x and y are in m without one.
            if names == ["range"]:
                self._units["range"] = "m"
                self._why["range"] = f"guess: no unit is named; {self._reason(chosen)}"
            return None
        # What is measured once an hour may well be slow; and azimuths of unknown unit tell no speed.
        seconds = 1.0 if numbers.dated else UNITS[chosen.time or "s"]
        if usual_interval(numbers.time[np.isfinite(numbers.time)]) * seconds >= _LONG_INTERVAL:
            return None
        largest_azimuth = 0.0
        if "azimuth" in self._columns and "azimuth" not in self._units:
            largest_azimuth = float(np.nanmax(np.abs(self._values("azimuth")), initial=0.0))
        if largest_azimuth > 360.0:
            return None
        fitting = [unit for unit in LENGTH_UNITS if is_usual_speed(speed * UNITS[unit])]
        fitting = other_units or fitting
        if not fitting:
            return None
        units = [*fitting, "m"]
        options = " ".join(f"--set units.{name}={units[0]}" for name in names)
        columns = ", ".join(self._columns[name] for name in names)
        what = f"{columns}: no unit is named, and in m the usual speed would be {speed:.2g} m/s"
        if other_units:
            what += f", in {units[0]} {speed * UNITS[units[0]]:.2g} m/s"
        way = f"say {options}, or with another unit: {', '.join(units[1:])}"
        if names == ["x", "y"] and look_like_degrees(numbers):
            x, y = (in_option(self._columns[name]) for name in names)
            way += f"; or in degrees, --set 'columns.longitude={x}' --set 'columns.latitude={y}'"
        return Place(self._sample.path, self._sample.line, 1, f"{what}: {way}")

    def _other_lengths(self, chosen: Candidate, numbers: Numbers) -> list[str]:
        """Return units that lengths without a named unit may have as well as m; empty for most tables.

        Something slow in m may be something fast in km, unless it turns as nothing fast can. Something
        fast that turns so in m is rather slow, in mm or cm. Names of ROS and of motion capture are in m.
        """
        speed = chosen.usual_speed
        words = {word for name in _PLACE for word in words_of(self._columns.get(name, ""))}
        if not np.isfinite(speed) or (numbers.dated and "time" not in self._columns):
            return []
        acceleration = usual_acceleration(numbers, chosen)
        turns_slowly = acceleration * 1e3 <= _LARGEST_ACCELERATION
        if speed <= _FASTEST_IN_KM * 1e-3 and turns_slowly and words.isdisjoint(_NAMES_IN_M):
            return [unit for unit in ("km", "nmi", "mi") if is_usual_speed(speed * UNITS[unit])]
        if acceleration > _LARGEST_ACCELERATION and speed >= _FAST:
            return [unit for unit in ("mm", "cm") if is_usual_speed(speed * UNITS[unit])]
        return []

    def _numbers(self, sensor: SensorGuess) -> Numbers:
        """Return the numbers of the rows of one target and sensor, as `likely_units` compares them.

        The words in the names of all columns tell formats, such as AIS, and units.
        """
        # Step 1: choose the rows of the sensor, and those of the longest run.
        sample = self._sample
        columns = self._columns
        rows = np.ones(len(sample), dtype=np.bool_)
        if sensor.name and columns.get("sensor"):
            rows &= np.array([cell == sensor.name for cell in sample.cells(columns["sensor"])])
        if columns.get("run"):
            runs = np.array(sample.cells(columns["run"]))
            labels, sizes = np.unique(runs[rows], return_counts=True)
            rows &= runs == labels[sizes.argmax()]
        self._chosen_rows = rows
        # Step 2: read the times, and the positions as they are written.
        time, is_dated = self._times()
        is_angle = False
        azimuth = None
        if sensor.kind == "range-azimuth":
            azimuth = self._azimuths()
            place = self._values("range") * np.stack([np.cos(azimuth), np.sin(azimuth)])
            named = ["range"]
        elif sensor.kind in ("bearing", "odometry") or sensor.kind.startswith("landmark"):
            place = np.empty((0, len(rows)))
            named = []
        elif sensor.kind == "range":
            named = list(sensor.quantities)
            place = np.stack([self._values(name) for name in named])
        else:
            is_angle = not {"x", "y"} <= columns.keys()
            named = ["longitude", "latitude"] if is_angle else ["x", "y"]
            place = np.stack([self._values(name) for name in named])
            if is_angle:
                place[:, no_fix(place[1], place[0], UNITS["deg"])] = np.nan
        # Step 3: read the speeds, and take only the chosen rows.
        speed = None
        if "speed" in columns:
            speed = self._values("speed")[rows]
        course = None
        if "course" in columns:
            course = self._values("course")[rows]
        velocity = None
        if columns.keys() >= {*_VELOCITY}:
            velocity = np.stack([self._values(name)[rows] for name in _VELOCITY])
        marks = frozenset("".join(words_of(name)) for name in sample.names)
        digits = [self._sample.decimals(columns[name]) for name in named]
        return Numbers(
            time=time[rows],
            dated=is_dated,
            place=place[:, rows],
            is_angle=is_angle,
            speed=speed,
            course=course,
            velocity=velocity,
            words=marks,
            least_digits=min(digits, default=0),
        )

    def _values(self, name: str) -> Array:
        """Parse a quantity's numbers, NaN where they are missing."""
        values = self._sample.numbers(self._columns[name])
        values[np.isin(values, self._with_missing.missing_numbers(name))] = np.nan
        return values

    def _azimuths(self) -> Array:
        """Return the azimuths (R,) in radians."""
        azimuth = self._values("azimuth")
        return azimuth * UNITS[self._unit_of_angles("azimuth", azimuth)]

    def _unit_of_angles(self, name: str, angles: Array) -> str:
        """Return the unit of a quantity's angles.

        If none is known, numbers beyond a turn are in degrees, and others in radians.
        """
        if name in self._units:
            return self._units[name]
        if (np.abs(angles) > _TURN).any():
            return "deg"
        return "rad"

    def _times(self) -> tuple[Array, bool]:
        """Return the times (R,) of the sample, and whether they need no unit.

        Dates are in seconds, and further parts of a time are added. Numbers of steps need no unit,
        either.
        """
        columns = self._columns
        sample = self._sample
        if "time" not in columns:
            return sample.numbers(columns["step"]), True
        cells = sample.cells(columns["time"])
        if self._clock.is_date:
            if "date" in columns and columns["time"] != columns["date"]:
                dates = sample.cells(columns["date"])
                cells = [f"{date} {time}" for date, time in zip(dates, cells, strict=True)]
            microseconds, _ = parse_cells(partial(instant, form=self._clock.form), cells)
            if np.isnan(microseconds).all():
                # The times are dates without those of the other column.
                microseconds, _ = parse_cells(instant, sample.cells(columns["time"]))
            seconds = microseconds / 1e6
        else:
            seconds = sample.numbers(columns["time"])
        return self._with_stamp_parts(seconds), self._clock.is_date

    def _with_stamp_parts(self, time: Array) -> Array:
        """Return the times (R,) with the week or the part of a second that a further column has.

        The column is added to the guessed ones.
        """
        columns = self._columns
        units = self._units
        clock = columns["time"]
        rest = rest_of_stamp(self._sample.names, clock, columns)
        unit = units.get("time")
        if "week" in rest and not self._clock.is_date and np.isfinite(time).any():
            column = rest["week"].column
            weeks = self._sample.numbers(column)
            largest = float(np.nanmax(time))
            if unit is None and largest <= _WEEK:
                unit = "s"
            elif unit is None and largest <= 1e3 * _WEEK:
                unit = "ms"
            # The clock's name says that it is a time of the week, or several weeks show it.
            is_known = not _TIME_OF_WEEK.isdisjoint(words_of(clock)) or np.ptp(weeks) > 0.0
            is_week = np.isfinite(weeks).all() and not (weeks % 1.0).any() and weeks.max() < 1e4
            if unit is not None and is_known and is_week and largest * UNITS[unit] <= _WEEK:
                columns["week"] = column
                if unit != "s":
                    units["time"] = unit
                    self._why["time"] = "guess: a week has 604800 s"
                return time + weeks * _WEEK / UNITS[unit]
        if "subsecond" in rest:
            column, part_unit = rest["subsecond"]
            part = self._sample.numbers(column) * UNITS[part_unit or "ns"]
            whole = np.isfinite(time).all() and not (time % 1.0).any() and unit in (None, "s")
            is_part = np.isfinite(part).all() and ((part >= 0.0) & (part < 1.0)).all()
            if whole and is_part and len(np.unique(time + part)) > len(np.unique(time)):
                columns["subsecond"] = column
                if part_unit not in (None, "ns"):
                    units["subsecond"] = str(part_unit)
                if not self._clock.is_date:
                    units["time"] = "s"
                self._why["subsecond"] = "guess: the part of a second"
                return time + part
        return time

    def _clocks(self) -> dict[str, tuple[float, float]]:
        """Return both possible forms of times, each with its factor and the points against it.

        Times such as 10:30 or 1030 are hours and minutes (the empty key), or minutes and seconds.
        Numbers from 1201 to 1259 may also be seconds.
        """
        cells = self._sample.cells(self._columns["time"])
        words = words_of(self._columns["time"])
        is_elapsed = not _ELAPSED.isdisjoint(words)
        if self._clock.other == "s":
            is_seconds = is_elapsed or not _SECONDS.isdisjoint(words)
            is_time_of_day = not _TIMES_OF_DAY.isdisjoint(words)
            as_clock, _ = self._times()
            as_numbers = self._sample.numbers(self._columns["time"])
            factor = usual_interval(as_numbers) / usual_interval(as_clock)
            # Of 100, 200 and 300 the interval of 100 s is unusual, and does not decide alone.
            return {"": (1.0, 0.5 + is_seconds), "s": (factor, 1.0 * is_time_of_day)}
        # 00:12 and 0012
        from_zero = bool(cells) and re.match(r"0+[:.,]|0*\d\d?$", cells[0]) is not None
        hours = 1.0 * is_elapsed + 0.5 * from_zero
        minutes = 0.0 if is_elapsed or from_zero else 1.0
        return {"": (1.0, hours), self._clock.other: (1.0 / 60.0, minutes)}

    def _known_units(self, sensor: SensorGuess) -> dict[str, str]:
        """Return the known units by quantity, with that of several columns of ranges as ``range``."""
        known = dict(self._units)
        if sensor.kind == "range":
            for name in sensor.quantities:
                if name in known:
                    known["range"] = known[name]
        return known

    def _write(self, chosen: Candidate, numbers: Numbers) -> None:
        """Add the chosen units to the columns that have none yet, with the reasons.

        ``numbers`` are those that were compared to choose them.
        """
        columns = self._columns
        units = self._units
        why = self._why
        reason = f"guess: {self._reason(chosen)}"
        if (
            "time" in columns
            and "time" not in units
            and chosen.time in UNITS
            and chosen.time != "s"
        ):
            units["time"] = chosen.time
            why["time"] = reason
        if chosen.as_angle and not numbers.is_angle:
            columns["longitude"] = columns.pop("x")
            columns["latitude"] = columns.pop("y")
            why["x"] = "x and y are a longitude and a latitude"
            units["longitude"] = units["latitude"] = chosen.place
            why["longitude"] = why["latitude"] = reason
        elif numbers.is_angle:
            for name in GEODETIC[:2]:
                if name not in units and chosen.place != "deg":
                    units[name] = chosen.place
                    why[name] = reason
        elif chosen.place != "m":
            for name in ("x", "y", "range"):
                if name in columns and name not in units:
                    units[name] = chosen.place
                    why[name] = reason
        names = _VELOCITY if numbers.velocity is not None else ("speed",)
        for name in names:
            if name in columns and name not in units and chosen.speed and chosen.agrees:
                units[name] = chosen.speed
                why[name] = "guess: agrees with the positions"
        if "course" in columns and "course" not in units and chosen.course not in ("", "deg"):
            units["course"] = chosen.course
            why["course"] = "guess: the direction of the positions"

    def _reason(self, chosen: Candidate) -> str:
        """Explain in a comment of the config why these units were chosen."""
        if chosen.agrees:
            return "times, positions and speeds agree"
        if np.isfinite(chosen.usual_speed):
            return f"the usual speed is {chosen.usual_speed:.2g} m/s"
        return "as large as its numbers are"

    def _questions(self, candidates: list[Candidate], numbers: Numbers) -> list[Place]:
        """Return a question to the user: a line for each candidate, with the options that choose it."""
        columns = self._columns
        first = candidates[0]
        questions = []
        differ_in_time = any(candidate.time != first.time for candidate in candidates)
        differ_in_place = any(candidate.place != first.place for candidate in candidates)
        for candidate in candidates:
            options = []
            units = []
            if differ_in_time:
                clock = candidate.time or self._clock.form
                if clock in UNITS:
                    options.append(f"--set 'units.time={clock}'")
                else:
                    options.append(f"--set 'time_format={json.dumps(clock)}'")
                units.append(f"{columns['time']} in {clock}")
            if differ_in_place:
                names = ["latitude", "longitude"] if numbers.is_angle else ["x", "y"]
                if candidate.as_angle and not numbers.is_angle:
                    options.append(f"--set 'columns.longitude={columns['x']}'")
                    options.append(f"--set 'columns.latitude={columns['y']}'")
                else:
                    for name in names:
                        if name in columns:
                            options.append(f"--set units.{name}={candidate.place}")
                shown = ", ".join(columns[name] for name in names if name in columns)
                units.append(f"{shown} in {candidate.place}")
            what = f"the units may be {' and '.join(units)}"
            if np.isfinite(candidate.usual_speed):
                what += f", with a usual speed of {candidate.usual_speed:.2g} m/s"
            what += f": say {' '.join(options)}"
            questions.append(Place(self._sample.path, self._sample.line, 1, what))
        return questions


def _missing(
    sample: Sample,
    columns: ColumnByQuantity,
    measured: set[str],
    user_columns: Collection[str],
) -> tuple[float, ...]:
    """Return whole numbers far outside the others, which stand for missing cells in all columns.

    They are searched in the columns of the ``measured`` quantities and in latitude and longitude. The
    ``user_columns`` are those that the user named.
    """
    names = sorted((measured | {*GEODETIC[:2], "speed", *_VELOCITY}) & columns.keys())
    values = {name: sample.numbers(columns[name]) for name in names}
    if "latitude" in values and "longitude" in values:
        has_fix = ~no_fix(values["latitude"], values["longitude"], UNITS["deg"])
        values = {name: column[has_fix] for name, column in values.items()}
    codes: list[float] = []
    far = {name: outlying(column) for name, column in values.items()}
    for name in sorted(values.keys() & (measured | {*GEODETIC[:2]})):
        if name == "azimuth":
            continue  # an azimuth of 0 may be far from others, and none of them is missing
        for value in far[name]:
            # A number that other columns measure is no code.
            is_code = all(
                value in far[other] or not (values[other] == value).any() for other in values
            )
            if value % 1 == 0 and is_code and value not in codes:
                codes.append(value)
    if not codes:
        codes = _no_detections(sample, columns, values, user_columns)
    return tuple(codes)


def _no_detections(
    sample: Sample,
    columns: ColumnByQuantity,
    values: dict[str, Array],
    user_columns: Collection[str],
) -> list[float]:
    """Return the number that stands for a position or range if nothing was detected; empty without one.

    It is 0, -1 or the largest range, and its rows lie far from all rows before and after. ``values``
    (R,) are those of the quantities. Raises DataError if another quantity has the number, too. A user
    who named the columns, among ``user_columns``, has said that they are measured.
    """
    for group in (_PLACE, ("range",)):
        if not all(name in values for name in group) or not {*group}.isdisjoint(user_columns):
            continue
        places = np.stack([values[name] for name in group])
        codes = [0.0, -1.0]
        if group == ("range",):
            # Some radars write their largest range if nothing was detected.
            largest = float(np.nanmax(places))
            if (places == largest).sum() >= _FEWEST_LARGEST:
                codes.append(largest)
        for code in codes:
            is_code = (places == code).all(axis=0)
            measured = np.flatnonzero(np.isfinite(places).all(axis=0) & ~is_code)
            if not is_code.any() or len(measured) < _FEWEST_MEASURED:
                continue
            steps = np.sqrt(np.square(np.diff(places[:, measured], axis=1)).sum(axis=0))
            rows = np.flatnonzero(is_code)
            after = np.searchsorted(measured, rows)
            away = np.full(len(rows), np.inf)
            for neighbor in (after - 1, after):
                inside = (neighbor >= 0) & (neighbor < len(measured))
                nearest = places[:, measured[neighbor[inside]]]
                distance = np.sqrt(np.square(nearest - code).sum(axis=0))
                away[inside] = np.minimum(away[inside], distance)
            is_far = away > _FAR_STEPS * np.quantile(steps, 0.9)
            # Some rows may be measured there, as those at the start of a path that begins at zero.
            if not is_far.any() or (code not in (0.0, -1.0) and not is_far.all()):
                continue
            others = [name for name, column in values.items() if (column[~is_code] == code).any()]
            if not others and is_far.all():
                return [code]
            rows = rows[is_far]
            shown = " and ".join(columns[name] for name in group)
            what = (
                f"{len(rows)} rows with {shown} = {code:g} lie far from the rows before and after"
            )
            way = "empty these cells if nothing was measured"
            option = " ".join(f"--set 'columns.{name}={columns[name]}'" for name in group)
            advice = f"{way}; if they are measured, say {option}"
            line = sample.line + int(rows[0])
            raise DataError(Place(sample.path, line, 1, f"{what}: {advice}"))
    return []


def _same_time(
    gathered: Gathered, rows: Rows, kind: str, in_degrees: bool
) -> Literal["spread"] | None:
    """Return "spread" for the key `same_time` if rows of one second differ and times are whole seconds.

    None otherwise. Raises DataError if these rows lie so far apart that they are those of several
    targets. ``kind`` is the type of the rows' sensor; ``in_degrees`` if its angles are in degrees.
    """
    twice = (np.diff(rows.ticks) == 0) & (np.diff(rows.values, axis=1) != 0.0).any(axis=0)
    if not twice.any():
        return None
    places = _places(rows, kind, in_degrees)
    if places is not None and _lie_apart(rows.ticks[:_MOST_COMPARED], places[:, :_MOST_COMPARED]):
        what = "rows of one time are far apart, and near those of other times: are they several"
        what += " targets, or false detections?"
        way = "Give each target a number in a column, and say --set 'columns.run=ITS NAME'"
        option = "if they are one target, say --set same_time=spread, or mean or last"
        place = gathered.place(rows, int(np.flatnonzero(twice)[0]) + 1, f"{what} {way}; {option}")
        raise DataError(place)
    seconds = len(np.unique(rows.time))
    if gathered.stepped or (rows.time % 1.0).any() or seconds < 2:
        return None
    # So many rows of one second may be those of many targets.
    if len(rows.time) > _MOST_A_SECOND * seconds:
        return None
    if gathered.dated and not (rows.time % _DAY).any():
        return None  # dates without a time of day
    return "spread"


def _places(rows: Rows, kind: str, in_degrees: bool) -> Array | None:
    """Return the positions (2, R) of rows, m; None for a sensor that measures none.

    ``kind`` is the type of the rows' sensor; ``in_degrees`` if its angles are in degrees.
    """
    if kind == "position":
        return rows.values[:2]
    if kind == "range-azimuth":
        azimuth = rows.values[1] * (UNITS["deg"] if in_degrees else 1.0)
        return rows.values[0] * np.stack([np.cos(azimuth), np.sin(azimuth)])
    return None


def _check_jumps(
    gathered: Gathered, rows: Rows, kind: str, in_degrees: bool, sample: Sample
) -> None:
    """Raise DataError if a run jumps to a place that no motion explains, and goes on from there.

    Its rows may be those of two targets: the name of the first one was given again, or two recordings
    stand in one table. ``kind`` is the type of the rows' sensor; ``in_degrees`` if its angles are in
    degrees. ``sample`` are the first rows as they are written.
    """
    places = _places(rows, kind, in_degrees)
    if places is None:
        return
    jump = unexplained_jump(rows.time, places)
    if jump is None:
        return
    column = gathered.naming.columns.get("run", "")
    name = gathered.runs[rows.run[jump.row]]
    what = f"{jump.distance:.3g} m in {jump.duration:.3g} {gathered.time_unit} are"
    what += f" {jump.times_as_fast:.2g} times as fast as all rows before and after"
    doubt = f"does {column} {name} name another target from here on?"
    way = f"Give it another name; if it is one target, say --set 'columns.run={in_option(column)}'"
    if not column:
        doubt = "is this another target, or another recording, from here on?"
        way = "Say which column names targets, --set 'columns.run=NAME'; if all rows are those of one,"
        way += " say --set 'columns.run=\"\"'"
    way += _way_without_fix(sample, gathered.naming.columns)
    raise DataError(gathered.place(rows, jump.row, f"{what}: {doubt} {way}"))


def _way_without_fix(sample: Sample, columns: Mapping[str, str]) -> str:
    """Return the option for positions in which 0 stands for a missing fix; empty if none has zeros."""
    options = []
    for quantity in ("latitude", "longitude", "x", "y", "range"):
        is_zero = sample.numbers(columns.get(quantity, "")) == 0.0
        # A position that crosses an axis is seldom exactly 0 in row after row.
        if (is_zero[1:] & is_zero[:-1]).any() and not is_zero.all():
            options.append(f"--set 'missing.{quantity}=[0]'")
    if not options:
        return ""
    return f"; if 0 stands for no fix, say {' '.join(options)}"


def _check_clock(gathered: Gathered, rows: Rows) -> None:
    """Raise DataError if a clock was set while it ran: dates of 1970 or 1980 before those of today."""
    times, first_rows_of_times = np.unique(rows.time, return_index=True)
    if gathered.stepped or len(times) < _FEWEST_MEASURED:
        return
    intervals = np.diff(times)
    longest = int(np.argmax(intervals))
    usual = usual_interval(times)
    if intervals[longest] <= max(_LONGEST_PAUSE, 1e6 * usual):
        return
    what = f"time rises by {intervals[longest] / _DAY / 365.25:.3g} years, where rows usually are"
    what += f" {usual:.6g} s apart: was the clock set only here?"
    count = int((rows.time <= times[longest]).sum())
    way = (
        f"Leave out or correct the rows before ({count}); or give both parts a number in a column,"
    )
    row = int(first_rows_of_times[longest + 1])
    raise DataError(gathered.place(rows, row, f"{what} {way} --set 'columns.run=ITS NAME'"))


def _check_daylight_saving(gathered: Gathered, rows: Rows) -> None:
    """Raise DataError if local times lack an hour because clocks were set forward in spring.

    It is an hour of a Sunday night, and the rows go on before and after it as usual. ``rows`` are in
    order.
    """
    has_local_times = gathered.clock is not None and gathered.clock.kind == "date"
    if not has_local_times or len(rows.time) < _FEWEST_MEASURED:
        return
    usual = usual_interval(rows.time)
    if usual > _LONG_INTERVAL:
        return
    seconds = rows.time + gathered.since / 1e6
    intervals = np.diff(seconds)
    for row in np.flatnonzero(np.abs(intervals - usual - _HOUR) < 0.5 * usual + 0.5).tolist():
        before = datetime.fromtimestamp(float(seconds[row]), UTC)
        after = datetime.fromtimestamp(float(seconds[row + 1]), UTC)
        is_full_hour = after.hour - before.hour == 2 and before.day == after.day
        in_season = before.month in _MONTHS_OF_SPRING and before.weekday() == _SUNDAY
        if not in_season or not is_full_hour or after.hour > _LATEST_HOUR:
            continue
        column = in_option(gathered.naming.columns["time"])
        what = f"after {before:%H:%M:%S} comes {after:%H:%M:%S}, on a Sunday of {before:%B}:"
        what += " are these local times, and was the clock set forward?"
        way = "Write times in UTC, or with their zone (+01:00)"
        option = f"if this hour has passed without a row, say --set 'columns.time={column}'"
        raise DataError(gathered.place(rows, row + 1, f"{what} {way}; {option}"))


def _lie_apart(ticks: NDArray[np.integer[Any]], places: Array) -> bool:
    """Test whether places (2, R) of one time lie farther apart than from those of the next time."""
    apart = []
    nearest = []
    times, first = np.unique(ticks, return_index=True)
    groups = [places[:, ticks == tick] for tick in times[np.argsort(first)]]
    for group, following in pairwise(groups):
        apart += np.hypot(*np.diff(group, axis=1)).tolist()
        away = group[:, :, None] - following[:, None, :]
        nearest += np.hypot(*away).min(axis=1).tolist()
    if not apart:
        return False
    # Of false detections most are far from all rows of the next time.
    return bool(np.quantile(apart, 0.25) > _TIMES_APART * np.quantile(nearest, 0.25))
