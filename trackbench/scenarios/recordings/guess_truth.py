"""Guess of the columns of a truth, which is a table of its own beside that of the measurements."""

from dataclasses import dataclass, replace

import numpy as np

from trackbench.errors import in_line
from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.guess_columns import check_given_keys
from trackbench.scenarios.recordings.guess_heading_of_truth import (
    HEADING_KEYS,
    guess_heading,
    without_heading,
)
from trackbench.scenarios.recordings.guess_record import Guess, Track
from trackbench.scenarios.recordings.guess_table import recognized
from trackbench.scenarios.recordings.guess_time_format import check_order_of_days
from trackbench.scenarios.recordings.naming_of_columns import Naming
from trackbench.scenarios.recordings.parse_tables import header
from trackbench.scenarios.recordings.quantity_keys import GEODETIC, PLACE
from trackbench.scenarios.recordings.recognize_column_names import (
    COORDINATES,
    TRUTH_WORDS,
    columns_of,
    words_of,
)
from trackbench.scenarios.recordings.yaml_values import quoted

_MOST_INTERVALS = 1.5
"""usual intervals between two rows within which the truth is a straight line"""

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
        check_given_keys(path, user_naming, further=HEADING_KEYS)
        naming = without_heading(path, user_naming)
    table_guess = recognized(path, _with_columns_of_truth(path, naming))
    check_order_of_days(path, table_guess, [guess.naming])
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
        heading = guess_heading(path, table_guess, user_naming)
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


def steps_before_truth(guess: Guess, truth: TruthGuess | None) -> int:
    """Return about how many steps of the longest run come before its truth; 0 without a truth.

    They are counted by the rows of the first sensor with positions or ranges and azimuths, if its times
    and those of the truth count from one moment.
    """
    # Tracks and the number of steps are those of the longest run.
    track = guess.positions or guess.radar
    if truth is None or truth.positions is None or track is None:
        return 0
    if track.is_dated != truth.positions.is_dated:
        return 0
    begin = float(track.time.min())
    later = truth.positions.time[truth.positions.time >= begin]
    if not len(later):
        return 0
    share = float((track.time < later.min()).mean())
    return int(share * guess.steps)
