"""A first look at a table of recorded data: what its columns may be, and a config that runs."""

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.column_mapping import UNITS, Naming
from trackbench.scenarios.recordings.csv_tables import header
from trackbench.scenarios.recordings.row_order import in_order
from trackbench.scenarios.recordings.rows import Gathered, chosen_runs, read_rows

_CALLED = {
    "time": ("time", "timestamp", "t", "datetime", "date", "utc", "timeutc", "utctime", "epoch"),
    "step": ("step", "k", "frame", "scan"),
    "run": ("run", "id", "trackid", "mmsi", "vessel", "object", "icao24", "icao", "callsign"),
    "latitude": ("latitude", "lat"),
    "longitude": ("longitude", "lon", "lng", "long"),
    "x": ("x", "px", "posx", "east", "easting"),
    "y": ("y", "py", "posy", "north", "northing"),
    "vx": ("vx", "velx", "eastspeed"),
    "vy": ("vy", "vely", "northspeed"),
    "range": ("range", "rmsd", "rho"),
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
    **{"seconds": "s", "millis": "ms", "mps": "m/s", "meters": "m", "metres": "m"},
}
_TURN = 2.0 * np.pi
_MILLISECONDS = 1e11  # since 1970: from 1973 on; in seconds it would be the year 5138
_ONE_SIGMA = 0.683  # of a normal law's values are within its standard deviation


class Found(NamedTuple):
    """A column that may be a quantity, and the unit in its name."""

    column: str
    unit: str | None


@dataclass(frozen=True)
class Guess:
    """Guess at a table: columns by quantity, units, and noise levels for a first try."""

    columns: dict[str, Found]
    units: dict[str, str]
    why: dict[str, str]
    runs: list[tuple[str, int]]
    sigma: tuple[float, float]
    speed: float

    @property
    def places(self) -> tuple[str, str]:
        """Return the two quantities of the position."""
        return places_of(self.columns)

    @property
    def moves(self) -> bool:
        """Return whether velocities are measured, too."""
        both = [("vx", "vy"), ("speed", "course")]
        polar = self.places == ("range", "azimuth")
        return not polar and any(all(name in self.columns for name in pair) for pair in both)


def places_of(columns: dict[str, Found]) -> tuple[str, str]:
    """Return the pair of quantities that determines a position."""
    for pair in (("x", "y"), ("latitude", "longitude"), ("range", "azimuth")):
        if all(name in columns for name in pair):
            return pair
    raise KeyError


def recognized(path: str) -> Guess:
    """Return the guess. Raises DataError if no time or no position can be made out."""
    # Step 1: find time and position by the columns' names.
    names = header(path)
    columns, there = dict(_recognized(names)), ", ".join(names)[:200]
    if "time" not in columns and "step" not in columns:
        what = f"no column looks like a time or a step; there are {there}"
        raise DataError(Place(path, 1, 1, what))
    try:
        pair = places_of(columns)
    except KeyError:
        what = (
            f"no columns look like x and y, latitude and longitude, or range and azimuth: {there}"
        )
        raise DataError(Place(path, 1, 1, what)) from None
    # Step 2: take the units from the columns' names.
    units = {name: found.unit for name, found in columns.items() if found.unit is not None}
    why = dict.fromkeys(units, "as the column's name says")
    if "speed" in columns and columns["speed"].column.lower() == "sog" and "speed" not in units:
        units["speed"], why["speed"] = "kn", "guess: speed over ground mostly is in knots"
    # Step 3: read the run that has most rows.
    naming = Naming(columns={name: f.column for name, f in columns.items()}, units=units)
    found, wanted = Gathered(naming), pair if pair == ("range", "azimuth") else ("x", "y")
    (rows,) = chosen_runs(found, read_rows(found, [path], [wanted]), ())
    sizes = np.bincount(rows.run, minlength=len(found.runs))
    own = in_order(found, rows.at(np.flatnonzero(rows.run == sizes.argmax())))
    whole = np.flatnonzero(np.isfinite(own.values).all(axis=0))
    time, (one, two) = own.time[whole], own.values[:, whole]
    # Step 4: guess further units from the values.
    if "time" in columns and not found.dated and np.abs(time).max(initial=0.0) > _MILLISECONDS:
        units["time"], why["time"] = "ms", "guess: seconds would be thousands of years"
        time = time / 1000.0
    if "azimuth" in wanted and "azimuth" not in units and np.abs(two).max(initial=0.0) > _TURN:
        units["azimuth"], why["azimuth"] = "deg", "guess: there are angles beyond 2 pi"
        two = two * UNITS["deg"]
    # Step 5: sort the runs by length; noise and speed are those of the longest.
    runs = sorted(zip(found.runs, sizes.tolist(), strict=True), key=lambda run: -run[1])
    sigma = _scatter(time, one), _scatter(time, np.unwrap(two) if "azimuth" in wanted else two)
    place = (one * np.cos(two), one * np.sin(two)) if "azimuth" in wanted else (one, two)
    return Guess(columns, units, why, runs, sigma, _speed(time, *place))


def _recognized(names: list[str]) -> Iterator[tuple[str, Found]]:
    """Yield each quantity with the first column that may be it."""
    for quantity, words in _CALLED.items():
        for name in names:
            # posX_km: words pos, x and km; unit km, name posx
            parts = re.findall(r"[a-z0-9/]+", re.sub(r"([a-z])([A-Z])", r"\1 \2", name).lower())
            unit = next((_WRITTEN[p] for p in reversed(parts[1:]) if p in _WRITTEN), None)
            bare = "".join(p for i, p in enumerate(parts) if i == 0 or p not in _WRITTEN)
            if bare in words:
                yield quantity, Found(name, unit)
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
    return float(f"{np.nanquantile(size, _ONE_SIGMA):.1g}") or 1.0


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
        "@FILTERS@": "\n".join(lines),
        "@SHOWN@": f"{each[0].upper()}, IMM",
    }


def _target_lines(guess: Guess) -> Iterator[str]:
    yield "columns:  # guess, from their names"
    # Only what the sensors below measure: a file of several sensors has further columns.
    velocity = ("vx", "vy", "speed", "course") if guess.moves else ()
    read = {"time", "step", "run", *guess.places, *velocity}
    columns = {name: found.column for name, found in guess.columns.items() if name in read}
    yield from (f"  {name}: {_quoted(column)}" for name, column in columns.items())
    units = {name: unit for name, unit in guess.units.items() if name in read}
    if units:
        yield "units:"
        yield from (f"  {name}: {unit}  # {guess.why[name]}" for name, unit in units.items())
    if "latitude" in guess.places:
        yield "# x and y are metres east and north of the first position, or of `origin: [lat, lon]`"
    if len(guess.runs) > 1:
        (longest, _), *others = guess.runs
        names = ", ".join([*(name for name, _ in others[:7]), *(["..."] if others[7:] else [])])
        yield f"runs: [{_quoted(longest)}]  # the longest of {len(guess.runs)}; there are {names}"


def _sensor_lines(guess: Guess) -> Iterator[str]:
    told = "guess: how far measurements are from the line between their neighbors"
    one, two = guess.sigma
    if guess.places == ("range", "azimuth"):
        mrad = float(f"{1000.0 * two:.3g}")
        yield f"kind: range-azimuth  # {told}"
        yield f"sigma_range: {one:g}"
        yield f"sigma_azimuth_mrad: {mrad:g}"
        return
    position = f"{{kind: position, sigma: {max(one, two):g}}}  # {told}"
    yield f"- {position}"
    if guess.moves:
        velocity = float(f"{max(0.05 * guess.speed, 0.05):.1g}")
        yield f"- {{kind: velocity, sigma: {velocity:g}}}  # guess: 5 % of the usual speed"


def _quoted(word: str) -> str:
    """Return a word of YAML; in quotes if it is more than letters, digits and lines."""
    return word if re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*|[1-9][0-9]*", word) else json.dumps(word)
