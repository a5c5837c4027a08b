"""Guess of the columns of a truth, which is a table of its own beside that of the measurements."""

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.errors import in_line
from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.detect_csv_layout import TextFormat
from trackbench.scenarios.recordings.directions_of_movement import (
    LEAST_COSINE,
    is_nearer,
    median_cosine,
)
from trackbench.scenarios.recordings.guess_azimuths import with_azimuths_by_positions
from trackbench.scenarios.recordings.guess_columns import check_given_keys
from trackbench.scenarios.recordings.guess_record import Guess, Track
from trackbench.scenarios.recordings.guess_table import recognized
from trackbench.scenarios.recordings.guess_table_sample import TableSample
from trackbench.scenarios.recordings.odometry_columns import heading_of, quaternion_of
from trackbench.scenarios.recordings.parse_tables import header
from trackbench.scenarios.recordings.quantity_column_names import (
    COORDINATES,
    TRUTH_WORDS,
    NamedColumn,
    columns_of,
    shown_names,
    unit_of,
    words_of,
)
from trackbench.scenarios.recordings.quantity_keys import GEODETIC, PLACE, QUATERNION
from trackbench.scenarios.recordings.quaternions import Quaternions
from trackbench.scenarios.recordings.recording_keys import Naming
from trackbench.scenarios.recordings.unit_names_and_sizes import DIMENSIONS, UNITS
from trackbench.scenarios.recordings.unscaled_rows import Displacements
from trackbench.scenarios.recordings.yaml_values import in_option, quoted

_MOST_INTERVALS = 1.5
"""usual intervals between two rows within which the truth is a straight line"""

_HEADING_KEYS = ("heading", *QUATERNION)
"""keys of `columns` that only the truth of a robot has"""

_LEAST_ROTATIONS = 0.5
"""share of the rows whose quaternion must have the norm 1"""

_FAR = 1e5
"""m: positions farther from x = y = 0 count from the origin of a grid"""


@dataclass(frozen=True)
class TruthGuess:
    """Guess at a table with the true path."""

    naming: Naming
    gap: float
    """longest time between two rows within which the truth is interpolated, s, or steps"""
    is_geodetic: bool
    """True if positions are latitudes and longitudes"""
    has_velocity: bool
    """True if the config reads velocities of the truth"""
    origin: tuple[float, ...]
    """latitude and longitude of its first position, deg; empty without one"""
    positions: Track | None = None
    """its positions"""
    names: tuple[str, ...] = ()
    """names of its columns"""

    @property
    def unused_columns(self) -> list[str]:
        """Names of the columns that the config does not read, as YAML."""
        used = self.naming.columns.values()
        return [quoted(" ".join(name.split())) for name in self.names if name not in used]


def recognized_truth(path: str, guess: Guess, user_naming: Naming | None = None) -> TruthGuess:
    """Guess the columns of a truth, a table of the true path beside the measurements in ``guess``.

    Keys that are set in ``user_naming`` are not guessed. Raises DataError if the table has no time or no
    positions.
    """
    user_naming = user_naming or Naming()
    # Step 1: guess it as a table of measurements, which must be those of one sensor of positions.
    # A table of measurements has no heading, and only the truth of a robot may have one.
    naming = user_naming
    if guess.inputs:
        check_given_keys(path, user_naming, further=_HEADING_KEYS)
        naming = _without_heading(path, user_naming)
    table_guess = recognized(path, _with_columns_of_truth(path, naming))
    _check_order_of_days(path, table_guess, [guess.naming])
    _check_sources(path, table_guess)
    if [sensor.quantities for sensor in table_guess.sensors] != [("x", "y")]:
        measured = ", ".join(dict.fromkeys(sensor.kind for sensor in table_guess.sensors))
        message = (
            f"a truth has positions, x and y or latitude and longitude, and this file {measured}"
        )
        remedy = "say which columns these are, --set 'truth_naming.columns.x=NAME'"
        raise DataError(
            Place(path, 1, 1, f"{message}: {remedy} --set 'truth_naming.columns.y=NAME'")
        )
    _check_grid(path, guess, table_guess)
    # Step 2: keep the columns that a truth may have, with the names of the state's components.
    columns = dict(table_guess.naming.columns)
    units = dict(table_guess.naming.units)
    is_geodetic = not {"x", "y"} <= columns.keys()
    read_quantities = {
        "time",
        "date",
        "step",
        "week",
        "subsecond",
        "run",
        "north_south",
        "east_west",
    }
    read_quantities |= {*GEODETIC[:2]} if is_geodetic else {"x", "y"}
    # Only the log of a robot has inputs. Its state has a heading and no velocity.
    has_velocity = table_guess.measures_velocity and not guess.inputs
    if has_velocity:
        read_quantities |= {"vx", "vy", "speed", "course"}
    # Without a sensor that measures x and y these are components of the state alone, px and py.
    if all("x" not in sensor.quantities for sensor in guess.sensors):
        columns = {{"x": "px", "y": "py"}.get(name, name): c for name, c in columns.items()}
        units = {{"x": "px", "y": "py"}.get(name, name): unit for name, unit in units.items()}
        read_quantities |= {"px", "py"}
    columns = {name: column for name, column in columns.items() if name in read_quantities}
    units = {name: unit for name, unit in units.items() if name in read_quantities}
    # Inputs show a robot, whose state has a heading.
    is_compass = False
    if guess.inputs:
        heading = _guess_heading(path, table_guess, user_naming)
        columns |= heading.columns
        units |= heading.units
        is_compass = heading.is_compass
    # A truth of one run is that of every run, so the column of its name is not read. A column that is
    # called run would still be read, unless an empty name says that no column names runs.
    if len(table_guess.runs) == 1:
        columns.pop("run", None)
        if "run" in table_guess.names:
            columns["run"] = ""
    # No azimuth is kept, so that none counts clockwise from north. A heading may do so.
    clockwise: tuple[str, ...] = ("heading",) if is_compass else ()
    if user_naming.clockwise is not None:
        clockwise = tuple(name for name in user_naming.clockwise if name == "heading")
    return TruthGuess(
        naming=replace(table_guess.naming, columns=columns, units=units, clockwise=clockwise),
        # Between rows farther apart, such as those beside a pause, nothing is interpolated.
        gap=float(f"{_MOST_INTERVALS * table_guess.interval:.3g}"),
        is_geodetic=is_geodetic,
        has_velocity=has_velocity,
        origin=table_guess.origin,
        positions=table_guess.positions,
        names=tuple(table_guess.names),
    )


def _without_heading(path: str, user_naming: Naming) -> Naming:
    """Return the user's naming without the keys on a heading.

    Raises DataError if the file at ``path`` lacks the column that the user named, and for a unit that is
    none of angles.
    """
    unit = user_naming.units.get("heading")
    angles = DIMENSIONS["angle"]
    if unit is not None and unit not in angles:
        message = f"units.heading: {unit} is not one of {', '.join(angles)}"
        raise DataError(Place(path, 1, 1, message))
    names = header(path, user_naming.format)
    for key in _HEADING_KEYS:
        column = user_naming.columns.get(key)
        if column and column not in names:
            message = f"no column {column}, which columns.{key} names"
            raise DataError(Place(path, 1, 1, f"{message}; there are {shown_names(names)}"))
    columns = {
        name: each for name, each in user_naming.columns.items() if name not in _HEADING_KEYS
    }
    units = {name: unit for name, unit in user_naming.units.items() if name != "heading"}
    clockwise = user_naming.clockwise
    if clockwise is not None:
        clockwise = tuple(name for name in clockwise if name != "heading")
    return replace(user_naming, columns=columns, units=units, clockwise=clockwise)


def _heading_of_truth(names: Sequence[str], user_naming: Naming) -> NamedColumn | None:
    """Return the column of a robot's heading, with its unit if it is known; None without a column.

    The column and the unit that the user named come first, and otherwise the ``names`` of the columns
    say them.
    """
    heading = heading_of(names)
    column = user_naming.columns.get("heading")
    if column:
        heading = heading_of([column]) or NamedColumn(column=column, unit=unit_of(column, "course"))
    unit = user_naming.units.get("heading")
    if heading is not None and unit is not None:
        heading = heading._replace(unit=unit)
    return heading


class _HeadingGuess(NamedTuple):
    """Keys of a truth's naming on its heading; all are empty if the truth has none."""

    columns: Mapping[str, str] = {}
    """its column, or those of a quaternion"""
    units: Mapping[str, str] = {}
    is_compass: bool = False
    """True if it counts clockwise from north"""


def _guess_heading(path: str, table_guess: Guess, user_naming: Naming) -> _HeadingGuess:
    """Guess the heading of a robot's truth: a column of it, or the four columns of a quaternion.

    ``table_guess`` is the guess at the table of the truth at ``path``. Keys that are set in
    ``user_naming`` are not guessed.
    """
    if user_naming.columns.get("heading") == "":
        return _HeadingGuess(columns={"heading": ""})  # the user's answer that there is none
    sample = TableSample(path, table_guess.names, table_guess.naming.format or TextFormat())
    answers = {name: column for name, column in user_naming.columns.items() if name in QUATERNION}
    heading = _heading_of_truth(table_guess.names, user_naming)
    if heading is not None and not answers:
        numbers = sample.numbers(heading.column)
        reading = _reading_of_heading(sample, table_guess, numbers, heading.unit)
        return _HeadingGuess(
            columns={"heading": heading.column},
            units={"heading": reading.unit},
            is_compass=reading.is_compass,
        )
    columns = {**quaternion_of(table_guess.names), **answers}
    missing = [name for name in QUATERNION if not columns.get(name)]
    if missing and answers:
        options = " ".join(f"--set columns.{name}=NAME" for name in missing)
        message = f"a quaternion has four columns: name the others, too, {options}"
        raise DataError(Place(path, 1, 1, message))
    if missing:
        return _HeadingGuess()
    if "heading" in user_naming.units:
        message = "a heading from a quaternion has no unit: leave units.heading out"
        raise DataError(Place(path, 1, 1, message))
    x, y, z, w = (sample.numbers(columns[name]) for name in QUATERNION)
    quaternions = Quaternions(x=x, y=y, z=z, w=w)
    if not answers:
        _check_quaternions(path, quaternions, columns)
    numbers = np.where(quaternions.is_unit, quaternions.heading, np.nan)
    reading = _reading_of_heading(sample, table_guess, numbers, "rad")
    return _HeadingGuess(columns=columns, is_compass=reading.is_compass)


def _check_quaternions(path: str, quaternions: Quaternions, columns: Mapping[str, str]) -> None:
    """Raise DataError, a question, if quaternions are hardly rotations about the vertical axis.

    ``columns`` are their columns in the file at ``path``, by component.
    """
    known = quaternions.is_known
    reason = ""
    if known.any() and quaternions.is_unit[known].mean() < _LEAST_ROTATIONS:
        reason = "most have not the norm 1"
    elif quaternions.tilts_far:
        reason = "its axis z is often more than 30 deg from the vertical"
    if not reason:
        return
    shown = ", ".join(in_line(column) for column in columns.values())
    question = f"{shown}: is the heading the turn of this quaternion about z, though {reason}?"
    name = in_option(columns["qx"])
    yes = Place(path, 1, 1, f"{question} Say --set 'columns.qx={name}'")
    no = Place(path, 1, 1, "or is there no heading? Say --set 'columns.heading=\"\"'")
    raise DataError(yes, no)


def _with_columns_of_truth(path: str, naming: Naming) -> Naming:
    """Return the naming with columns such as gt_x and true_y, in a file of the truth alone.

    They are used for a position or velocity that no other columns have. ``path`` is the file.
    """
    names = header(path, naming.format)
    stripped_names: dict[str, str] = {}
    for name in names:
        words = [word for word in words_of(name) if word not in TRUTH_WORDS]
        stripped_names.setdefault("_".join(words), name)
    known = columns_of(names, naming.columns)
    of_truth = columns_of(stripped_names)
    columns = dict(naming.columns)
    for pair in COORDINATES:
        is_known = any(quantity in known or quantity in columns for quantity in pair)
        if not is_known and of_truth.keys() >= {*pair}:
            columns |= {quantity: stripped_names[of_truth[quantity].column] for quantity in pair}
    return replace(naming, columns=columns)


def _check_sources(path: str, table_guess: Guess) -> None:
    """Raise DataError if a column names several sources of the truth's positions.

    ``table_guess`` is the guess at the table of the truth at ``path``.
    """
    column = table_guess.naming.columns.get("sensor")
    if not column or len(table_guess.sensors) < 2:
        return
    names = ", ".join(sensor.name for sensor in table_guess.sensors)[:200]
    message = f"column {in_line(column)} names {in_line(names)}, and a truth is of one source"
    raise DataError(Place(path, 1, 1, f"{message}: leave out the rows of the others"))


def _check_grid(path: str, guess: Guess, table_guess: Guess) -> None:
    """Raise DataError if x and y count from far away, as on a map's grid, beside latitudes.

    One of the two tables, the measurements of ``guess`` and the truth of ``table_guess``, has x and y,
    and the other has latitudes. ``path`` is the file of the truth.
    """
    # A guess has an origin, the first position, only if the table has latitudes. An origin in the config
    # (`naming`) says from where x and y count. The guess at several files has no columns of positions.
    if guess.files or guess.naming.origin or bool(guess.origin) == bool(table_guess.origin):
        return
    planar = guess if table_guess.origin else table_guess
    columns = planar.naming.columns
    if planar.positions is None or not columns.keys() >= {*PLACE}:
        return
    distance = float(np.nanmin(np.hypot(*planar.positions.values)))
    if distance < _FAR:
        return
    names = f"{in_line(columns['x'])} and {in_line(columns['y'])}"
    message = f"{names} count from a point {distance / 1e3:.0f} km away, as on a map's grid (UTM),"
    remedy = "convert them to latitude and longitude"
    where = path if planar is table_guess else guess.path
    raise DataError(Place(where, 1, 1, f"{message} and the other table has latitudes: {remedy}"))


def settled(
    guess: Guess,
    truth: TruthGuess | None,
    user_keys: Collection[str] = (),
    others: Sequence[Guess] = (),
) -> Guess:
    """Return the guess at measurements, with open questions answered by the truth or another file.

    A question may be from where azimuths count, which their positions can show. ``user_keys`` are the
    keys that the user set, ``others`` the guesses at further files of the recording. Raises DataError
    with the questions that remain, and if two files may have the day and the month in different orders.
    """
    # Step 1: compare the order of day and month with that of the other files.
    namings = [other.naming for other in others]
    if truth is not None:
        namings.append(truth.naming)
    _check_order_of_days(guess.path, guess, namings)
    # Step 2: take the positions of the truth, or of another file, that decide from where azimuths count.
    # The user's key `clockwise`, even if it is empty, says it: angles in it count from north, clockwise,
    # and others from x to y. Of the reasons for a guess those that begin with "as" are sure.
    is_known = "clockwise" in user_keys or guess.reasons.get("clockwise", "").startswith("as ")
    tracks: list[tuple[Track | None, str]] = []
    if truth is not None:
        tracks.append((truth.positions, "the truth shows"))
    for other in others:
        tracks.append((other.positions, f"the positions of {in_line(Path(other.path).name)} show"))
    for track, reason in tracks:
        if is_known or track is None:
            continue
        decided = with_azimuths_by_positions(guess, track, reason)
        if decided is not None:
            guess = decided
            break
    if guess.questions:
        raise DataError(*guess.questions)
    return guess


def _check_order_of_days(path: str, guess: Guess, others: Sequence[Naming]) -> None:
    """Raise DataError if day and month may be in either order, and another file does not show which.

    `Guess.format_of_other_order` is set only if both orders give the same times since the first row, as
    of dates within one day. They then matter beside other files alone. ``path`` is the file of
    ``guess``, and ``others`` have the formats of the other files.
    """
    date_format = guess.naming.time_format
    order = _order_of_days(date_format)
    if not guess.format_of_other_order or all(
        _order_of_days(o.time_format) == order for o in others
    ):
        return
    message = "dates may be a day in either order, which matters beside the other file: say which, "
    remedy = f"`--set 'time_format=\"{date_format}\"'` or "
    remedy += f"`--set 'time_format=\"{guess.format_of_other_order}\"'`"
    raise DataError(Place(path, 1, 1, message + remedy))


def _order_of_days(date_format: str) -> str:
    """Return the letters of day, month and year in a format of dates: dmy of %d/%m/%y."""
    return "".join(re.findall("%([dmy])", date_format.replace("%Y", "%y")))


class _HeadingReading(NamedTuple):
    """Unit of a truth's headings, and whether they count clockwise from north."""

    unit: str
    is_compass: bool = False


def _reading_of_heading(
    sample: TableSample, table_guess: Guess, numbers: Array, known_unit: str | None
) -> _HeadingReading:
    """Return how the headings of the truth, the ``numbers`` (R,) of its ``sample``, are written.

    A vehicle moves in the direction of its heading, so that the positions decide. If they do not, the
    headings count from x, and, without a ``known_unit``, in deg if one is beyond 2 pi.
    """
    largest = float(np.nanmax(np.abs(numbers), initial=0.0))
    unit = known_unit or ("deg" if largest > 2.0 * np.pi else "rad")
    columns = table_guess.naming.columns
    if not columns.keys() >= {*PLACE}:
        return _HeadingReading(unit)
    position = np.stack([sample.numbers(columns[name]) for name in PLACE])
    known = np.flatnonzero(np.isfinite(position).all(axis=0) & np.isfinite(numbers))
    # Numbers of rows stand for their times, as only the directions of displacements are used. A
    # displacement from one run to the next is one of few.
    displacements = Displacements.of_rows(known.astype(float), position[:, known])
    # Median cosines between the movement and the direction by each reading, the usual ones first.
    cosines: dict[_HeadingReading, float] = {}
    for each_unit in dict.fromkeys((unit, "rad", "deg")):
        if known_unit and each_unit != unit:
            continue
        angle = numbers[known] * UNITS[each_unit]
        along = np.stack([np.cos(angle), np.sin(angle)])
        cosines[_HeadingReading(each_unit)] = median_cosine(along, displacements)
        compass = _HeadingReading(each_unit, is_compass=True)
        cosines[compass] = median_cosine(along[::-1], displacements)
    for reading, cosine in cosines.items():
        if all(not is_nearer(other, cosine) for other in cosines.values()):
            return reading if cosine >= LEAST_COSINE else _HeadingReading(unit)
    return _HeadingReading(unit)
