"""A first look at a table of recorded data: what its columns may be, and a config that runs."""

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from itertools import chain, islice, product
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.column_mapping import UNITS, Naming, outlying
from trackbench.scenarios.recordings.csv_lines import table_lines
from trackbench.scenarios.recordings.csv_tables import header, instant, is_instant, number, parsed
from trackbench.scenarios.recordings.row_order import in_order
from trackbench.scenarios.recordings.rows import Gathered, Rows, chosen_runs, read_rows

_CALLED = {
    "time": (
        *("time", "timestamp", "t", "datetime", "utc", "timeutc", "utctime", "epoch"),
        *("basedatetime", "datetimeutc", "unixtime", "gpstime", "systime", "timeofday"),
    ),
    "date": ("date", "day", "dateutc", "utcdate"),
    "step": ("step", "k", "frame", "scan"),
    "received": ("received",),
    "sensor": (
        "sensor",
        "sensorid",
        "anchor",
        "anchorid",
        "beacon",
        "beaconid",
        "radar",
        "station",
    ),
    "run": ("run", "id", "trackid", "mmsi", "vessel", "object", "icao24", "icao", "callsign"),
    "latitude": ("latitude", "lat"),
    "longitude": ("longitude", "lon", "lng", "long"),
    "x": ("x", "px", "posx", "east", "easting"),
    "y": ("y", "py", "posy", "north", "northing"),
    "vx": ("vx", "velx", "eastspeed"),
    "vy": ("vy", "vely", "northspeed"),
    "range": ("range", "rmsd", "rho", "distance"),
    "azimuth": ("azimuth", "bearing", "theta"),
    "speed": ("speed", "sog", "groundspeed"),
    "course": ("course", "cog", "heading"),
}
_WRITTEN = {
    **{
        unit: unit
        for unit in ("m", "km", "ft", "nmi", "deg", "rad", "mrad", "kn", "s", "ms", "us", "ns", "h")
    },
    **{"feet": "ft", "nm": "nmi", "degrees": "deg", "knots": "kn", "kts": "kn", "kmh": "km/h"},
    **{"e7": "degE7", "dege7": "degE7"},
    **{"seconds": "s", "millis": "ms", "mps": "m/s", "meters": "m", "metres": "m"},
}
_TURN = 2.0 * np.pi
_SMALLEST_E7 = 1e6  # deg: angles beyond are whole numbers of 1e-7 deg
_SAMPLE = 10_000  # rows
_DAYS = ("%d/%m/%Y", "%m/%d/%Y", "%d.%m.%Y", "%d-%m-%Y", "%m-%d-%Y", "%Y/%m/%d", "%Y.%m.%d")
_TIMES = ("%H:%M:%S", "%H:%M:%S.%f", "%I:%M:%S %p", "%H:%M")
_FORMS = [*_TIMES, *map(" ".join, product(_DAYS, _TIMES))]
_MILLISECONDS = 1e11  # since 1970: from 1973 on; in seconds it would be the year 5138
_ONE_SIGMA = 0.683  # of a normal law's values are within its standard deviation


class NamedColumn(NamedTuple):
    """A column that may be a quantity, and the unit in its name."""

    column: str
    unit: str | None


@dataclass(frozen=True)
class Guess:
    """Guess at a table: columns by quantity, units, and noise levels by sensor for a first try."""

    columns: dict[str, NamedColumn]
    units: dict[str, str]
    why: dict[str, str]
    runs: list[tuple[str, int]]
    sigmas: dict[str, tuple[float, float]]
    speed: float
    time_format: str
    missing: list[float]

    @property
    def places(self) -> tuple[str, str]:
        """Two quantities of the position."""
        return places_of(self.columns)

    @property
    def moves(self) -> bool:
        """True if velocities are measured, too."""
        if self.places == ("range", "azimuth") or "sensor" in self.columns:
            return False
        both = [("vx", "vy"), ("speed", "course")]
        return any(self.columns.keys() >= {*pair} for pair in both)


def places_of(columns: dict[str, NamedColumn]) -> tuple[str, str]:
    """Return the pair of quantities that determines a position."""
    for pair in (("x", "y"), ("latitude", "longitude"), ("range", "azimuth")):
        if all(name in columns for name in pair):
            return pair
    raise KeyError


def recognized(path: str) -> Guess:
    """Return the guess. Raises DataError if no time or no position can be made out."""
    # Step 1: find time and position by the columns' names.
    names = header(path)
    columns, known = dict(_recognized(names)), ", ".join(names)[:200]
    if "date" in columns and "time" not in columns:
        columns["time"] = columns.pop("date")
    if "time" not in columns and "step" not in columns:
        what = f"no column looks like a time or a step; there are {known}"
        raise DataError(Place(path, 1, 1, what))
    sample = _Sample(path, names)
    sensors = sample.words(columns["sensor"].column) if "sensor" in columns else []
    if len(sensors) < 2:
        columns.pop("sensor", None)
    try:
        pair = places_of(columns)
    except KeyError:
        raise DataError(Place(path, 1, 1, _no_position(columns, sensors, known))) from None
    # Step 2: take the units from the columns' names, or from values that are impossible otherwise.
    units = {name: column.unit for name, column in columns.items() if column.unit is not None}
    why = dict.fromkeys(units, "as the column's name says")
    if "speed" in columns and columns["speed"].column.lower() == "sog" and "speed" not in units:
        units["speed"], why["speed"] = "kn", "guess: speed over ground mostly is in knots"
    for name in {"latitude", "longitude"} & {*pair} - {*units}:
        if (np.abs(sample.numbers(columns[name].column)) > _SMALLEST_E7).any():
            units[name], why[name] = "degE7", "guess: degrees would be impossible"
    # Step 3: read all rows.
    outliers = (outlying(sample.numbers(columns[name].column)) for name in pair)
    missing = [v for v in dict.fromkeys(map(float, chain.from_iterable(outliers))) if v % 1 == 0]
    form = _time_format(sample, columns)
    named = {name: f.column for name, f in columns.items()}
    naming = Naming(columns=named, units=units, time_format=form, missing=tuple(missing))
    gathered, wanted = Gathered(naming), pair if pair == ("range", "azimuth") else ("x", "y")
    every = read_rows(gathered, [path], [wanted] * max(len(sensors), 1), names=sensors)
    every = chosen_runs(gathered, every, ())
    # Step 4: guess further units from the values.
    latest = max(float(np.abs(rows.time).max(initial=0.0)) for rows in every)
    if "time" in columns and not gathered.dated and latest > _MILLISECONDS:
        units["time"], why["time"] = "ms", "guess: seconds would be thousands of years"
    widest = max(float(np.abs(rows.values[1]).max(initial=0.0)) for rows in every)
    if "azimuth" in wanted and "azimuth" not in naming.units and widest > _TURN:
        units["azimuth"], why["azimuth"] = "deg", "guess: there are angles beyond 2 pi"
    # Step 5: sort the runs by length; noise and speed are those of the longest.
    sizes = np.sum([np.bincount(rows.run, minlength=len(gathered.runs)) for rows in every], axis=0)
    runs = sorted(zip(gathered.runs, sizes.tolist(), strict=True), key=lambda run: -run[1])
    sigmas, speed = {}, 1.0
    for sensor, rows in zip(sensors or [""], every, strict=True):
        longest = in_order(gathered, rows.at(np.flatnonzero(rows.run == sizes.argmax())))
        longest = longest.at(np.flatnonzero(np.isfinite(longest.values).all(axis=0)))
        if sensor and not len(longest.time):
            raise DataError(Place(path, 1, 1, _no_position(columns, sensors, known, sensor)))
        sigmas[sensor], speed = _levels(longest, units, "azimuth" in wanted)
    return Guess(columns, units, why, runs, sigmas, speed, form, missing)


def _levels(rows: Rows, units: dict[str, str], polar: bool) -> tuple[tuple[float, float], float]:
    """Return deviations of both quantities and the usual speed, of whole rows in order."""
    time, (one, two) = rows.time, rows.values
    if units.get("time") == "ms" and np.abs(time).max(initial=0.0) > _MILLISECONDS:
        time = time / 1000.0
    if not polar:
        return (_scatter(time, one), _scatter(time, two)), _speed(time, one, two)
    if np.abs(two).max(initial=0.0) > _TURN:
        two = two * UNITS["deg"]
    sigma = _scatter(time, one), _scatter(time, np.unwrap(two))
    return sigma, _speed(time, one * np.cos(two), one * np.sin(two))


def _no_position(
    columns: dict[str, NamedColumn], sensors: list[str], known: str, sensor: str = ""
) -> str:
    """Return what to write where a table, or one of its sensors, holds no positions."""
    if len(sensors) < 2:
        pairs = "x and y, latitude and longitude, or range and azimuth"
        return f"no columns look like {pairs}: {known}"
    who = f"sensor {sensor}" if sensor else "a sensor"
    what = f"column {columns['sensor'].column} names {len(sensors)} sensors, and {who} has no positions"
    way = (
        f"`columns: {{sensor: {columns['sensor'].column}}}`, `sensors: [{', '.join(sensors[:8])}]`"
    )
    return f"{what}: write a config with {way} and a sensor for each, such as `function` from its place"


class _Sample:
    """First rows of a table, as text."""

    def __init__(self, path: str, names: list[str]) -> None:
        self._names, self._rows = names, []
        if not path.lower().endswith((".parquet", ".pq")):
            rows = islice(table_lines(path), 1, _SAMPLE)
            self._rows = [cells for _, cells, _ in rows if len(cells) == len(names)]

    def cells(self, column: str) -> list[str]:
        """Return the cells of a column."""
        return [cells[self._names.index(column)].strip() for cells in self._rows]

    def words(self, column: str) -> list[str]:
        """Return the words in a column."""
        return list(dict.fromkeys(self.cells(column)))

    def numbers(self, column: str) -> Array:
        """Return the numbers of a column, NaN for what is none."""
        values, _ = parsed(number, [cell.replace(",", ".") for cell in self.cells(column)])
        return values


def _time_format(sample: _Sample, columns: dict[str, NamedColumn]) -> str:
    """Return the form of dates that are neither numbers nor in ISO 8601: that of the shortest span."""
    if "time" not in columns:
        return ""
    cells = sample.cells(columns["time"].column)
    if "date" in columns:
        dates = sample.cells(columns["date"].column)
        cells = [f"{date} {cell}" for date, cell in zip(dates, cells, strict=True)]
    if not cells or is_instant(cells[0]):
        return ""
    if not parsed(number, [cells[0].replace(",", ".")])[1]:
        return ""
    spans = {}
    for form in _FORMS:
        times, mistakes = parsed(partial(instant, form=form), cells)
        if not mistakes:
            spans[form] = float(np.ptp(times))
    return min(spans, key=lambda form: spans[form]) if spans else ""


def _recognized(names: list[str]) -> Iterator[tuple[str, NamedColumn]]:
    """Yield each quantity with the first column that may be it."""
    for quantity, words in _CALLED.items():
        for name in names:
            # posX_km: words pos, x and km; unit km, name posx
            parts = re.findall(r"[a-z0-9/]+", re.sub(r"([a-z])([A-Z])", r"\1 \2", name).lower())
            unit = next((_WRITTEN[p] for p in reversed(parts[1:]) if p in _WRITTEN), None)
            bare = "".join(p for i, p in enumerate(parts) if i == 0 or p not in _WRITTEN)
            if bare in words:
                yield quantity, NamedColumn(name, unit)
                break


def _scatter(time: Array, value: Array) -> float:
    """Return the errors' deviation, from distances to the line between neighbors."""
    wide = time[2:] - time[:-2]
    if len(value) < 3 or not (wide > 0.0).any():
        return 1.0
    share = (time[1:-1] - time[:-2]) / np.where(wide > 0.0, wide, np.nan)
    # e = z_1 - (1 - s) z_0 - s z_2 has the variance sigma^2 (1 + s^2 + (1 - s)^2).
    off = value[1:-1] - (1.0 - share) * value[:-2] - share * value[2:]
    size = np.abs(off) / np.sqrt(1.0 + np.square(share) + np.square(1.0 - share))
    # 68.3 % of the scaled |e| are below sigma.
    sigma = float(np.nanquantile(size, _ONE_SIGMA))
    # A straight line leaves rounding errors alone.
    return float(f"{sigma:.1g}") if sigma > 1e-12 * np.abs(value).max() else 1.0


def _speed(time: Array, x: Array, y: Array) -> float:
    """Return the usual speed, m/s, over a tenth of the recording, where errors matter less."""
    lag = max(1, len(time) // 10)
    if len(time) <= lag:
        return 1.0
    gone, passed = np.hypot(x[lag:] - x[:-lag], y[lag:] - y[:-lag]), time[lag:] - time[:-lag]
    return float(f"{np.median(gone[passed > 0] / passed[passed > 0]):.1g}") or 1.0


def config_parts(guess: Guess) -> dict[str, str]:
    """Return the parts of a config that are guessed, as lines of YAML."""
    polar, speed = guess.places == ("range", "azimuth"), guess.speed
    each = ["ekf", "ukf"] if polar else ["kf"]
    lines = [f"  {kind.upper()}: {{kind: {kind}}}" for kind in each]
    # Process noise from the usual speed; the IMM's motions have a tenth of it and ten times it.
    q = float(f"{max(0.0025 * speed * speed, 1e-3):.1g}")
    motions = f"[{{kind: cwna, q: {q / 10:g}}}, {{kind: cwna, q: {q * 10:g}}}]"
    chances = "[[0.95, 0.05], [0.05, 0.95]]"
    lines.append(f"  IMM: {{kind: imm, motions: {motions}, transition: {chances}}}")
    lines.append("  RPF: {kind: rpf, N: 1000}")
    return {
        "@TARGET@": "\n".join(f"    {line}" for line in _target_lines(guess)),
        "@SENSOR@": "\n".join(f"    {line}" for line in _sensor_lines(guess)),
        "@START@": f"  start: {{kind: one-scan, sigma_velocity: {2 * speed:g}}}  # guess",
        "@Q@": f"{q:g}",
        "@LATE@": ", late: refilter" if "received" in guess.columns else "",
        "@HOLD@": f"{max(2, min(5, guess.runs[0][1] // 2))}",
        "@FILTERS@": "\n".join(lines),
        "@SHOWN@": f"{each[0].upper()}, IMM",
    }


def _target_lines(guess: Guess) -> Iterator[str]:
    yield "columns:  # guess, from their names"
    # Only what the sensors below measure: a file of several sensors has further columns.
    velocity = ("vx", "vy", "speed", "course") if guess.moves else ()
    read = {"time", "date", "step", "received", "run", "sensor", *guess.places, *velocity}
    columns = {name: named.column for name, named in guess.columns.items() if name in read}
    yield from (f"  {name}: {_quoted(column)}" for name, column in columns.items())
    units = {name: unit for name, unit in guess.units.items() if name in read}
    if units:
        yield "units:"
        yield from (f"  {name}: {unit}  # {guess.why[name]}" for name, unit in units.items())
    if guess.time_format:
        yield f"time_format: {json.dumps(guess.time_format)}  # guess: %d is the day, %m the month"
    if guess.missing:
        numbers = ", ".join(f"{value:.9g}" for value in guess.missing)
        yield f"missing: [{numbers}]  # guess: far outside the others"
    if "sensor" in guess.columns:
        yield f"sensors: [{', '.join(map(_quoted, guess.sigmas))}]"
    if "latitude" in guess.places:
        yield "# x and y are metres east and north of the first position, or of `origin: [lat, lon]`"
    if len(guess.runs) > 1:
        (longest, _), *others = guess.runs
        names = ", ".join([*(name for name, _ in others[:7]), *(["..."] if others[7:] else [])])
        yield f"runs: [{_quoted(longest)}]  # the longest of {len(guess.runs)}; there are {names}"


def _sensor_lines(guess: Guess) -> Iterator[str]:
    source = "guess: how far measurements are from the line between their neighbors"
    polar = guess.places == ("range", "azimuth")
    for one, two in guess.sigmas.values():
        if polar:
            keys = f"sigma_range: {one:g}, sigma_azimuth_mrad: {float(f'{1000.0 * two:.3g}'):g}"
            yield f"- {{kind: range-azimuth, {keys}}}  # {source}"
        else:
            yield f"- {{kind: position, sigma: {max(one, two):g}}}  # {source}"
    if guess.moves:
        velocity = float(f"{max(0.05 * guess.speed, 0.05):.1g}")
        yield f"- {{kind: velocity, sigma: {velocity:g}}}  # guess: 5 % of the usual speed"


def _quoted(word: str) -> str:
    """Return a word of YAML; in quotes if it is more than letters, digits and lines."""
    return word if re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*|[1-9][0-9]*", word) else json.dumps(word)
