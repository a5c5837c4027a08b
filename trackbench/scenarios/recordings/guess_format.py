"""Guess of a recording's format, columns, units and errors, for a config that runs."""

import json
import re
from dataclasses import dataclass, field, fields, replace
from itertools import chain, islice
from typing import Any, Literal, NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.column_mapping import (
    COURSE,
    GEODETIC,
    HEMISPHERES,
    SMALLEST_E7,
    UNITS,
    Naming,
    outlying,
)
from trackbench.scenarios.recordings.column_names import columns_of, ranges_of, unit_in, words_of
from trackbench.scenarios.recordings.csv_lines import (
    TextFormat,
    is_value,
    layout_of,
    table_rows,
)
from trackbench.scenarios.recordings.csv_tables import (
    first_rows,
    header,
    is_parquet,
    number,
    parsed,
    read_table,
)
from trackbench.scenarios.recordings.dates import instant
from trackbench.scenarios.recordings.guess_errors import (
    SENSORS,
    levels_of,
    not_finer,
    velocities_agree,
)
from trackbench.scenarios.recordings.guess_time import (
    DateForm,
    date_form,
    unit_by_size,
    unit_by_speed,
)
from trackbench.scenarios.recordings.row_order import in_order
from trackbench.scenarios.recordings.rows import (
    Gathered,
    MixedRowsError,
    Rows,
    check_turns,
    chosen_runs,
    read_rows,
)

_TURN = 2.0 * np.pi
_SAMPLE = 10_000  # rows
_MOST_SENSORS = 50
_FIRST = 200  # rows that show the format
_MOST_A_SECOND = 20
_PLACE, _VELOCITY = ("x", "y"), ("vx", "vy")
_MEASURED = ("x", "y", "latitude", "longitude", "range", "azimuth")
_NORTH = frozenset(("north", "true", "compass", "magnetic", "mag", "clockwise", "cw"))
_TUM = ("timestamp", "tx", "ty", "tz", "qx", "qy", "qz", "qw")


class SensorGuess(NamedTuple):
    """A sensor of the table: its name there, its type, and the deviations of its errors."""

    name: str
    kind: str
    quantities: tuple[str, ...]
    sigmas: tuple[float, ...] = ()


@dataclass(frozen=True)
class Guess:
    """Guess at a table: how it is read, why so, and noise levels by sensor for a first try."""

    naming: Naming
    why: dict[str, str]
    runs: list[tuple[str, int]]
    sensors: list[SensorGuess]
    speed: float
    names: list[str] = field(default_factory=list)
    """all columns of the table"""

    @property
    def moves(self) -> bool:
        """True if velocities are measured, too."""
        is_one = [sensor.quantities for sensor in self.sensors] == [_PLACE]
        return is_one and _has_velocity(self.naming.columns)


def recognized(path: str, given: Naming | None = None) -> Guess:
    """Guess how a table is written, but for ``given`` keys. Raises DataError without time or place."""
    given = given or Naming()
    found: dict[str, str] = {}
    # A column whose words split the rows names runs or sensors; there may be one of each.
    while True:
        try:
            guess = _recognized_columns(path, replace(given, columns=given.columns | found))
        except MixedRowsError as error:
            key = _key_of_labels(error)
            if key in found or key in given.columns:
                raise
            found[key] = error.column
            continue
        guess.why.update(
            dict.fromkeys(found, "guess: rows of one of its words agree with each other")
        )
        return guess


def _key_of_labels(error: MixedRowsError) -> str:
    """Choose whether a column names runs or sensors. Raises DataError if neither is evident."""
    if error.role == "place":
        return "sensor"
    if error.split == "errors" or (error.role == "sensor" and error.split == "unknown"):
        return "sensor"
    if error.role != "sensor":
        return "run"
    column = json.dumps(error.column)[1:-1]
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


def _recognized_columns(path: str, given: Naming) -> Guess:
    """Guess how a table is written; raises MixedRowsError if a column splits its rows."""
    # Step 1: find the columns by their names.
    why: dict[str, str] = {}
    form = _text_format(path, given.format or TextFormat(), why)
    names = header(path, form)
    sample = _Sample(path, names, form)
    columns, units = _columns(names, sample, given, why)
    if "time" not in columns and "step" not in columns:
        raise DataError(Place(path, 1, 1, _no_time(names)))
    if not sample and any(name in columns for name in _MEASURED):
        read_table(path, {names[0]: "label"}, form=form)  # which reports why no row can be read
    # Step 2: find the sensors, and units that other units would make impossible.
    sensors = _sensors(path, sample, columns, names, units)
    measured = set(chain.from_iterable(sensor.quantities for sensor in sensors))
    for name in GEODETIC[:2]:
        values = sample.numbers(columns.get(name, ""))
        if name not in units and (np.abs(values) > SMALLEST_E7).any():
            units[name], why[name] = "degE7", "guess: degrees would be impossible"
    clock = DateForm(given.time_format, bool(given.time_format))
    if "time" in columns and not clock.form:
        times, dates = (sample.cells(columns[k]) if k in columns else [] for k in ("time", "date"))
        clock = date_form(path, times, dates, sample.line)
        # A column `day` may be a number of days: only beside times of a day, and with whole dates.
        day = next((name for name in names if name.lower() == "day"), "")
        if clock.form and "%d" not in clock.form and not parsed(instant, sample.cells(day))[1]:
            columns["date"] = day
            clock = date_form(path, times, sample.cells(day), sample.line)
    if clock.why:
        why["time_format"] = clock.why
    elif "time" in columns and "time" not in units and not clock.is_date:
        unit = unit_by_size(sample.numbers(columns["time"]))
        if unit is not None:
            units["time"], why["time"] = unit, "guess: seconds would be thousands of years"
    missing = given.missing or _missing(sample, columns, measured)
    naming = replace(
        given,
        columns=columns,
        units=units,
        time_format=clock.form,
        missing=missing,
        format=form if form != TextFormat() else None,
    )
    if missing and not given.missing:
        why["missing"] = "guess: far outside the others"
    # Step 3: read all rows.
    guess = _measured(path, naming, why, sensors)
    sensors = [
        s._replace(sigmas=not_finer(s.sigmas, s.quantities, guess.naming, sample.cells))
        for s in guess.sensors
    ]
    return replace(guess, sensors=sensors, names=names)


def _measured(path: str, naming: Naming, why: dict[str, str], sensors: list[SensorGuess]) -> Guess:
    """Add what all rows show to the guess: runs, errors, speed, and further units."""
    # Errors and speeds are those of the mirror image, too, whatever the unit of angles.
    # A row far from the others in any of the runs is reported when its run is read.
    gathered = Gathered(replace(naming, clockwise=()), refuses_far_rows=False)
    units, columns = naming.units, naming.columns
    by_name = [sensor.name for sensor in sensors] if columns.get("sensor") else []
    wanted = [sensor.quantities for sensor in sensors]
    velocity = _VELOCITY if wanted == [_PLACE] and not by_name and _has_velocity(columns) else ()
    every = read_rows(gathered, [path], [(*names, *velocity) for names in wanted], names=by_name)
    every = chosen_runs(gathered, every, ())
    angles = [r.values[-1] for names, r in zip(wanted, every, strict=True) if "azimuth" in names]
    is_wide = any((np.abs(a[np.isfinite(a)]) > _TURN).any() for a in angles)
    in_degrees = "azimuth" not in units and is_wide
    if in_degrees:
        units["azimuth"], why["azimuth"] = "deg", "guess: there are angles beyond 2 pi"
    for names, rows in zip(wanted, every, strict=True):
        scaled = rows._replace(values=rows.values * (UNITS["deg"] if in_degrees else 1.0))
        check_turns(gathered, scaled, {"azimuth": len(names) - 1} if "azimuth" in names else {})
    # Sort the runs by length; noise and speed are those of the longest.
    sizes = np.sum([np.bincount(rows.run, minlength=len(gathered.runs)) for rows in every], axis=0)
    runs = sorted(zip(gathered.runs, sizes.tolist(), strict=True), key=lambda run: -run[1])
    longest = []
    for sensor, rows in zip(sensors, every, strict=True):
        measured = np.isfinite(rows.values[: len(sensor.quantities)]).all(axis=0)
        rows = rows.at(np.flatnonzero(measured & (rows.run == sizes.argmax())))
        if naming.same_time is None and (way := _same_time(gathered, rows)):
            naming = replace(naming, same_time=way)
            gathered.naming = replace(naming, clockwise=())
            why["same_time"] = "guess: several rows of a whole second; or mean, or last"
        longest.append(in_order(gathered, rows))
    levels = [
        levels_of(rows, sensor.kind, in_degrees)
        for sensor, rows in zip(sensors, longest, strict=True)
    ]
    speed = next((speed for _, speed in levels if speed), 0.0)
    # Guess the unit of times and of speeds, now that the path is known.
    if "time" in columns and "time" not in units and not gathered.dated:
        unit = unit_by_speed(longest[0].time, speed)
        if unit is not None:
            units["time"] = unit
            why["time"] = f"guess: with seconds the usual speed would be {speed:.1g} m/s"
            speed /= UNITS[unit]
            longest[0] = longest[0]._replace(time=longest[0].time * UNITS[unit])
    if velocity and not velocities_agree(longest[0], columns, units, why):
        for name in {*_VELOCITY, *COURSE} & columns.keys():
            columns.pop(name)
        why["velocity"] = "velocities are left out: they disagree with the positions"
    naming = _with_clockwise(naming, wanted, every, why)
    guesses = [s._replace(sigmas=level[0]) for s, level in zip(sensors, levels, strict=True)]
    return Guess(naming, why, runs, guesses, float(f"{speed:.1g}") or 1.0)


def _with_clockwise(
    naming: Naming, wanted: list[tuple[str, ...]], every: list[Rows], why: dict[str, str]
) -> Naming:
    """Guess whether azimuths count clockwise from north: those of radars and compasses, 0 to 360 deg."""
    angles = [r.values[-1] for names, r in zip(wanted, every, strict=True) if "azimuth" in names]
    column = naming.columns.get("azimuth")
    if not angles or column is None or naming.clockwise:
        return naming
    is_positive = all((a[np.isfinite(a)] >= 0.0).all() for a in angles)
    says_so = not _NORTH.isdisjoint(words_of(column))
    if not says_so and not (is_positive and naming.units.get("azimuth") == "deg"):
        return naming
    why["clockwise"] = (
        "guess: from 0 to 360 deg, as of radars; leave it out if it counts from x to y"
    )
    if says_so:
        why["clockwise"] = "as the column's name says: from north"
    return replace(naming, clockwise=("azimuth",))


def _has_velocity(columns: dict[str, str]) -> bool:
    """Test whether there are columns of a velocity, or of speed and course."""
    return columns.keys() >= {*_VELOCITY} or columns.keys() >= {*COURSE}


def _text_format(path: str, given: TextFormat, why: dict[str, str]) -> TextFormat:
    """Guess the format: separator and decimal sign, header, a row of units."""
    if is_parquet(path):
        return given
    layout = layout_of(path, given)
    rows = [cells for _, cells in islice(table_rows(path, layout), _FIRST)]
    keys: dict[str, Any] = {}
    if layout.separator != ",":
        keys["separator"] = {"\t": "tab", " ": "space"}.get(layout.separator, layout.separator)
    if layout.encoding != "utf-8-sig":
        keys["encoding"] = layout.encoding
    if layout.header > 1 and not layout.is_comment:
        keys["header"] = layout.header
    # Beside commas only quotes can hold decimal commas, and three digits may be thousands.
    cells = (cell.strip() for cell in chain.from_iterable(rows))
    digits = r"[-+]?\d+,\d+" if layout.separator != "," else r"[-+]?\d+,(\d\d?|\d{4,})"
    if any(re.fullmatch(digits, cell) for cell in cells):
        keys["decimal"] = ","
    if keys:
        why["format"] = "guess: as its first lines are"
    if layout.header and not given.header and all(map(is_value, layout.names)):
        width = len(layout.names)
        names = _TUM if width == len(_TUM) else ("time", "x", "y") if width == 3 else ()
        if not names or (width == 3 and _may_be_degrees([layout.names, *rows])):
            what = f"no line names the columns: name all {width},"
            way = "`--set 'format.names=[time, x, y, ...]'` (or latitude, longitude, range, ...)"
            raise DataError(Place(path, layout.header, 1, f"{what} {way}"))
        keys |= {"names": names, "header": 0}
        why["format"] = "guess: no line names the columns"
    elif not given.skip and _are_units(rows):
        keys["skip"], why["format"] = 1, "guess: below the names is a line of units"
    chosen = {field.name for field in fields(given) if getattr(given, field.name)}
    return replace(given, **{key: value for key, value in keys.items() if key not in chosen})


def _may_be_degrees(rows: list[list[str]]) -> bool:
    """Test whether three columns may be a time, a latitude and a longitude, by their digits."""
    places = list(chain.from_iterable(row[1:] for row in rows))
    return all(re.fullmatch(r" *-?\d{1,3}\.\d{4,} *", cell) for cell in places)


def _are_units(rows: list[list[str]]) -> bool:
    """Test whether the first of these rows holds words above values."""
    if len(rows) < 2 or any(map(is_value, rows[0])):
        return False
    return any(map(str.strip, rows[0])) and any(map(is_value, rows[1]))


def _columns(
    names: list[str], sample: "_Sample", given: Naming, why: dict[str, str]
) -> tuple[dict[str, str], dict[str, str]]:
    """Guess columns and units by quantity, as the names of columns and a row of units show them."""
    recognized_columns = columns_of(names)
    columns = {name: named.column for name, named in recognized_columns.items()}
    columns = {n: c for n, c in columns.items() if c not in given.columns.values()} | given.columns
    for key, column in _hemispheres(names, sample, columns).items():
        columns = {n: c for n, c in columns.items() if c != column} | {key: column}
    if columns.keys() >= {*_VELOCITY}:
        columns = {name: column for name, column in columns.items() if name not in COURSE}
    if "date" in columns and "time" not in columns:
        columns["time"] = columns.pop("date")
    if "time" in columns:
        columns.pop("step", None)
    _settle_twice_named(columns, given)
    for key, least, most in (("sensor", 2, _MOST_SENSORS), ("run", 1, max(1, len(sample) // 3))):
        words = set(sample.cells(columns.get(key, "")))
        if key not in given.columns and ("" in words or not least <= len(words) <= most):
            columns.pop(key, None)
    units = {
        n: c.unit for n, c in recognized_columns.items() if c.unit and columns.get(n) == c.column
    }
    why |= dict.fromkeys(units, "as the column's name says")
    for name, column in columns.items():
        unit = sample.unit(column, name)
        if unit is not None:
            units[name], why[name] = unit, "as the line of units says"
    return columns, units | given.units


def _hemispheres(names: list[str], sample: "_Sample", columns: dict[str, str]) -> dict[str, str]:
    """Find the columns of the letters N and S, and E and W, beside latitude and longitude."""
    out: dict[str, str] = {}
    for quantity, (key, positive, negative) in HEMISPHERES.items():
        for name in names if quantity in columns and key not in columns else ():
            words = {cell.lower() for cell in sample.cells(name)} - {""}
            if name != columns[quantity] and words and words <= {*positive, *negative}:
                out.setdefault(key, name)
    return out


def _settle_twice_named(columns: dict[str, str], given: Naming) -> None:
    """Decide in place what a column is that two quantities claim: a track, and a sensor's id."""
    run = columns.get("run")
    if run is None or "run" in given.columns:
        return
    if run == columns.get("course"):
        # Beside a speed a track is a course; else it names what moves.
        columns.pop("run" if "speed" in columns else "course")
    elif run == columns.get("sensor"):
        columns.pop("run")


def _no_time(names: list[str]) -> str:
    """Explain what to write where no column looks like a time."""
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
    path: str, sample: "_Sample", columns: dict[str, str], names: list[str], units: dict[str, str]
) -> list[SensorGuess]:
    """Guess the sensors; columns of several ranges are added. Raises DataError if there is none."""
    # Quantities by row: a position is x and y, or latitude and longitude.
    numbers = {n: np.isfinite(sample.numbers(c)) for n, c in columns.items() if n in _MEASURED}
    for part, other in (("x", "latitude"), ("y", "longitude")):
        if not {"x", "y"} <= numbers.keys() and {"latitude", "longitude"} <= numbers.keys():
            numbers[part] = numbers[other]
    words = sample.words(columns["sensor"]) if columns.get("sensor") else [""]
    out = []
    for word in words:
        cells = sample.cells(columns.get("sensor", ""))
        rows = np.array([cell == word or not word for cell in cells], dtype=np.bool_)
        for kind, quantities in SENSORS.items():
            if all(name in numbers and (numbers[name] & rows).any() for name in quantities):
                out.append(SensorGuess(word, kind, quantities))
                break
    has_position = {"x", "y"} <= numbers.keys() or {"range", "azimuth"} <= numbers.keys()
    ranges = {} if has_position else ranges_of(names)
    if ranges and words == [""]:
        columns.pop("range", None)
        out = []
        for number, (name, named) in enumerate(ranges.items(), 1):
            quantity = f"{number}.range"
            columns[quantity] = named.column
            out.append(SensorGuess(name.upper(), "range", (quantity,)))
            if named.unit is not None:
                units[quantity] = named.unit
    if len(out) < len(words):
        raise DataError(Place(path, 1, 1, _no_position(columns, sample, names)))
    return out


def _no_position(columns: dict[str, str], sample: "_Sample", names: list[str]) -> str:
    """Explain what to write where a table, or one of its sensors, has nothing that is measured."""
    pairs = "x and y, latitude and longitude, range and azimuth, or range"
    known = ", ".join(names)[:200]
    for name in filter(columns.get, _MEASURED):
        cell = next((cell for cell in sample.cells(columns[name]) if cell), "")
        if cell and not np.isfinite(sample.numbers(columns[name])).any():
            what = f"{columns[name]}: {cell[:40]!r} is not a number, nor is any other of its cells"
            return f"{what}: write decimal numbers, such as -8.5042, without letters"
    for name in names:
        if any(re.fullmatch(r"-?\d+\.\d+, *-?\d+\.\d+", cell) for cell in sample.cells(name)[:1]):
            return f"column {name} has two numbers in a cell: give each a column, latitude and longitude"
    if columns.get("sensor"):
        words = ", ".join(sample.words(columns["sensor"]))[:80]
        what = f"column {columns['sensor']} names {words}, and one of them has no {pairs}"
        return f"{what}; there are {known}: `--set 'columns.sensor=\"\"'` mixes all"
    way = f"say which are, `--set 'columns.x={names[0]}' --set 'columns.y={names[-1]}'`"
    return f"no columns look like {pairs}; there are {known}: {way}"


class _Sample:
    """First rows of a table, as text."""

    def __init__(self, path: str, names: list[str], form: TextFormat) -> None:
        self._names = names
        self.line = 1 if is_parquet(path) else layout_of(path, form).before + 1
        self._rows = first_rows(path, form, _SAMPLE)
        self._units: list[str] = []
        if form.skip:
            rows = first_rows(path, replace(form, skip=0), 1)
            self._units = rows[0] if rows else []

    def __len__(self) -> int:
        return len(self._rows)

    def cells(self, column: str) -> list[str]:
        """List the cells of a column."""
        if column not in self._names:
            return [""] * len(self) if column == "" else []
        return [cells[self._names.index(column)] for cells in self._rows]

    def words(self, column: str) -> list[str]:
        """List the words in a column."""
        return [word for word in dict.fromkeys(self.cells(column)) if word]

    def numbers(self, column: str) -> Array:
        """Parse the numbers of a column, NaN for what is none."""
        values, _ = parsed(number, [cell.replace(",", ".") for cell in self.cells(column)])
        return values

    def unit(self, column: str, quantity: str) -> str | None:
        """Find the unit of a quantity's column in the line of units."""
        if column not in self._names or len(self._units) != len(self._names):
            return None
        return unit_in(words_of(self._units[self._names.index(column)]), quantity)


def _missing(sample: _Sample, columns: dict[str, str], measured: set[str]) -> tuple[float, ...]:
    """Find whole numbers far outside the others, which mark missing cells."""
    out: dict[float, None] = {}
    # An azimuth of 0 may be far from others, and none of them is missing.
    for name in sorted((measured | {*GEODETIC[:2]}) & columns.keys() - {"azimuth"}):
        out |= dict.fromkeys(v for v in outlying(sample.numbers(columns[name])) if v % 1 == 0)
    return tuple(out)


def _same_time(gathered: Gathered, rows: Rows) -> Literal["spread"] | None:
    """Choose what becomes of several rows of a whole second, which differ."""
    seconds = len(np.unique(rows.time))
    if gathered.stepped or (rows.time % 1.0).any() or not 1 < seconds < len(rows.time):
        return None
    if len(rows.time) > _MOST_A_SECOND * seconds:
        return None
    twice = (np.diff(rows.ticks) == 0) & (np.diff(rows.values, axis=1) != 0.0).any(axis=0)
    return "spread" if twice.any() else None
