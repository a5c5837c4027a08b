"""Names and units of a table's columns, and the quantities computed from them."""

import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from math import inf, pi
from typing import Literal, NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.conversions import Geodetic, east_north_up
from trackbench.core.elementary import cos_sin
from trackbench.field_types import DataError, Finite, InvalidKeyError, Place
from trackbench.scenarios.recordings.csv_lines import TextFormat
from trackbench.scenarios.recordings.csv_tables import Content, Table, header, read_table

_DEGREES = 180.0 / pi
_LIMITS = {
    "latitude": (-90.0, 90.0, _DEGREES, "deg"),
    "longitude": (-180.0, 180.0, _DEGREES, "deg"),
    "course": (-360.0, 360.0, _DEGREES, "deg"),
    "range": (0.0, inf, 1.0, "m"),
    "speed": (0.0, inf, 1.0, "m/s"),
}
"""Least and largest value, in a unit of which SI has so many."""
SMALLEST_E7 = 1e6  # deg; angles beyond are whole numbers of 1e-7 deg
_LEAST_CELLS = 5
_NINES = re.compile(r"9{3,}(\.9+)?")
_ENDS = (32767.0, 32768.0, 2147483647.0, 2147483648.0)
_CODES = {"latitude": 91.0, "longitude": 181.0, "course": 511.0}
"""Codes of AIS (ITU-R M.1371) that are impossible values in any table; a course may be a heading."""
_CODES_OF_AIS = {"speed": 102.3, "course": 360.0}
"""Codes of AIS that are possible values in other tables: an aircraft's 102.3 kn, a course due north."""


class Impossible(NamedTuple):
    """The first row with an impossible value, and the message on it."""

    row: int
    what: str


def blank_codes(quantity: str, values: Array, of_ais: bool) -> Counter[str]:
    """Replace "not available" codes by NaN in place, and count the cells of each code."""
    counts: Counter[str] = Counter()
    for codes in (_CODES, _CODES_OF_AIS) if of_ais else (_CODES,):
        code = codes.get(quantity)
        coded = values == code
        if code is not None and coded.any():
            counts[f"{quantity} {code:g}"] = int(coded.sum())
            values[coded] = np.nan
    return counts


def outlying(values: Array) -> dict[float, int]:
    """Find numbers far outside all others, as -9999 for a missing cell, and count how often each stands.

    A number is far if its distance to the next is ten times the span of the others; a row of nines, and
    the end of a whole number's range, at a tenth of the span already.
    """
    rest, outliers = values[np.isfinite(values)], {}
    while len(rest) >= _LEAST_CELLS:
        for end in (float(rest.min()), float(rest.max())):
            others = rest[rest != end]
            if len(others) < _LEAST_CELLS:
                continue
            low, high = float(others.min()), float(others.max())
            usual = _NINES.fullmatch(f"{abs(end):.9g}") or abs(end) in _ENDS
            if max(low - end, end - high) > (0.1 if usual else 10.0) * (high - low) > 0.0:
                outliers[end] = len(rest) - len(others)
                rest = others
                break
        else:
            break
    return outliers


def impossible(quantity: str, values: Array, scale: float) -> Impossible | None:
    """Find values, which are ``scale`` times as large in SI, that the quantity cannot have."""
    if quantity not in _LIMITS:
        return None
    least, largest, per_si, unit = _LIMITS[quantity]
    shown = values * scale * per_si
    # Rounding in the conversion to SI and back must not make 90 deg too many.
    room = 1e-9 * largest if largest < inf else 0.0
    rows = np.flatnonzero((shown < least - room) | (shown > largest + room))
    if not len(rows):
        return None
    limits = f"at least {least:g}" if largest == inf else f"within {least:g} and {largest:g}"
    more = f", as are {len(rows) - 1} more" if len(rows) > 1 else ""
    what = f"{shown[rows[0]]:.9g} {unit} is impossible{more}; a {quantity} is {limits} {unit}"
    first = float(values[rows[0]])
    says = f"`missing: [{first:.9g}]` for a missing cell"
    if abs(shown[rows[0]]) > SMALLEST_E7 and unit == "deg":
        says += f", or `units: {{{quantity}: degE7}}` for whole numbers of 1e-7 deg"
    return Impossible(
        int(rows[0]), f"{what}: correct or empty the cells, or name their unit; say {says}"
    )


_DIMENSIONS = {
    "length": {
        **{"m": 1.0, "km": 1000.0, "ft": 0.3048, "mi": 1609.344, "nmi": 1852.0, "cm": 1e-2},
        "mm": 1e-3,
    },
    "speed": {
        **{"m/s": 1.0, "km/h": 1 / 3.6, "kn": 1852.0 / 3600.0, "ft/s": 0.3048, "mph": 0.44704},
        "cm/s": 1e-2,
    },
    "angle": {"rad": 1.0, "mrad": 1e-3, "deg": pi / 180.0, "degE7": pi / 180.0e7},
    "turn rate": {"rad/s": 1.0, "deg/s": pi / 180.0},
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0, "d": 86400.0},
}
UNITS = dict(chain.from_iterable(units.items() for units in _DIMENSIONS.values()))
"""SI value of each unit."""
_DIMENSION_OF = {
    "time": "time",
    **dict.fromkeys(("x", "y", "z", "altitude", "range"), "length"),
    **dict.fromkeys(("vx", "vy", "vz", "speed", "range_rate"), "speed"),
    **dict.fromkeys(("latitude", "longitude", "course", "azimuth", "elevation"), "angle"),
}
"""Dimension of each quantity; that of a plugin's own quantities may be any."""
KEYS = ("run", "time", "step", "sensor", "date", "received")
"""What a row may say beside its quantities."""
_OBJECTS = ("mmsi", "icao24", "icao", "callsign", "trackid", "vessel", "object")
"""Columns that name what moves."""
GEODETIC = ("latitude", "longitude", "altitude")
COURSE = ("speed", "course")
_DEFAULT_UNITS = {"latitude": "deg", "longitude": "deg", "course": "deg"}
_PLANE = ("x", "y", "z")


@dataclass(frozen=True, kw_only=True, eq=False)
class Naming:
    """Keys of whatever reads tables: what their columns are called and what they are in."""

    columns: dict[str, str] = field(default_factory=dict)
    """names of columns, where they differ: {x: east_m, time: t}; latitude and longitude stand for x
    and y (altitude for z), speed and course for vx and vy"""
    units: dict[str, str] = field(default_factory=dict)
    """units that are not SI: {x: km, speed: kn, azimuth: deg}; latitude, longitude and course are in
    degrees unless they are said to be in rad, or in degE7, whole numbers of 1e-7 deg"""
    origin: tuple[Finite, ...] = ()
    """latitude and longitude (deg), perhaps height (m), of the point from which x counts east and y
    north; default: the first position"""
    time_format: str = ""
    """form of dates that are not in ISO 8601, as strptime has it: "%d/%m/%Y %H:%M:%S"; a column `date`
    stands before a time of day"""
    missing: tuple[Finite, ...] = ()
    """numbers that stand for a missing cell: [-9999]"""
    same_time: Literal["mean", "last", "spread"] | None = None
    """what becomes of different rows of one sensor, run and time: their mean, the last of them, or times
    spread evenly until the next; default: they are a mistake"""
    format: TextFormat | None = None
    """how a text file is written, where its first lines do not show it: {separator: ";", skip: 1}"""

    def __post_init__(self) -> None:
        for key, unit in self.units.items():
            if unit not in UNITS:
                what = f"{unit!r} is not one of {', '.join(UNITS)}"
                raise InvalidKeyError(what, "units", key)
        if self.origin and len(self.origin) not in (2, 3):
            raise InvalidKeyError("is latitude, longitude and perhaps height", "origin")
        for name, degrees in zip(GEODETIC, self.origin[:2], strict=False):
            least, largest, *_ = _LIMITS[name]
            if not least <= degrees <= largest:
                what = f"{degrees:g} deg is impossible; a {name} is within {least:g} and {largest:g} deg"
                raise InvalidKeyError(what, "origin", GEODETIC.index(name))

    def check_names(self, components: Sequence[str], *within: str) -> None:
        """Raise InvalidKeyError for an unknown name, and for a unit of another dimension."""
        known = [*KEYS, *GEODETIC, *COURSE, *components]
        for part, entries in (("columns", self.columns), ("units", self.units)):
            for key in entries:
                if key not in known:
                    what = f"there is no {key}; known: {', '.join(known)}"
                    raise InvalidKeyError(what, *within, part, key)
        for key, unit in self.units.items():
            mistake = _mistaken_unit(key, unit, is_scalar=not {"px", "vx"} & {*components})
            if mistake is not None:
                raise InvalidKeyError(mistake, *within, "units", key)

    def called(self, name: str, names: Sequence[str]) -> str | None:
        """Find the column of a quantity among ``names``; the second sensor's 2.x falls back to x."""
        for key in dict.fromkeys((name, name.rpartition(".")[2], _plain(name))):
            if self.columns.get(key, key) in names:
                return self.columns.get(key, key)
        return None

    def scale(self, name: str) -> float:
        """Look up the factor from a quantity's unit to SI."""
        plain = _plain(name)
        unit = self.units.get(name) or self.units.get(plain) or _DEFAULT_UNITS.get(plain)
        return 1.0 if unit is None else UNITS[unit]


def is_unit_of(quantity: str, unit: str) -> bool:
    """Test whether a unit is one of the quantity's dimension."""
    return unit in _DIMENSIONS.get(_DIMENSION_OF.get(_plain(quantity), ""), ())


def _mistaken_unit(key: str, unit: str, is_scalar: bool) -> str | None:
    """Explain why a quantity cannot have this unit. A scalar's x and z may have any."""
    if key in KEYS and key != "time":
        return f"a {key} has no unit: leave it out"
    dimension = None if is_scalar and key in ("x", "z") else _DIMENSION_OF.get(_plain(key))
    if dimension is None or unit in _DIMENSIONS[dimension]:
        return None
    allowed = ", ".join(_DIMENSIONS[dimension])
    return f"{unit!r} is not a unit of {dimension}, which {key} has; allowed: {allowed}"


class Columns:
    """Sources of one table's quantities: their own columns, or others that determine them."""

    def __init__(self, path: str, naming: Naming, wanted: Sequence[str], least: int = 1) -> None:
        """Find a file's columns for these quantities; raises DataError if fewer than ``least`` exist."""
        self.path, self.naming, self.names = path, naming, header(path, naming.format)
        self.contents: dict[str, Content] = {}
        self.unavailable: Counter[str] = Counter()
        self.far: list[str] = []
        self._used: dict[str, str] = {}
        # Sources of each quantity: its column, or other columns that determine it.
        self._of = {name: self._sources(name) for name in wanted}
        missing = [name for name, sources in self._of.items() if not sources]
        if len(wanted) - len(missing) < least:
            known = ", ".join(self.names)[:200]
            raise self.mistake(f"no column {missing[0]}; there are {known} (see `columns`)")
        for source in chain.from_iterable(self._of.values()):
            self.take(source, "number")

    def column(self, name: str) -> str | None:
        """Find the name of a quantity's column in this file."""
        return self.naming.called(name, self.names)

    def take(self, name: str, content: Content) -> str | None:
        """Note the column of a quantity or of a key such as ``run``, which then is read.

        Raises DataError if it is the column of another quantity, too.
        """
        column = self.column(name)
        if column is not None:
            other = self._used.setdefault(column, _plain(name))
            if other != _plain(name):
                what = f"column {column} is both {other} and {_plain(name)}; a quantity has a column of"
                raise self.mistake(f"{what} its own (see `columns`)")
            self.contents[column] = content
        return column

    def take_unnamed_runs(self) -> str | None:
        """Find a column that names objects, such as MMSI, unless the config says what runs are."""
        if "run" in self.naming.columns:
            return None
        named = (name for name in self.names if re.sub("[^a-z0-9]", "", name.lower()) in _OBJECTS)
        column = next((name for name in named if name not in self._used), None)
        if column is not None:
            self._used[column], self.contents[column] = "run", "label"
        return column

    def mistake(self, what: str) -> DataError:
        """Report a mistake of the table as a whole."""
        return DataError(Place(self.path, 1, 1, what))

    def read(self) -> Table:
        """Read the table, codes of "not available" as NaN. Raises DataError for impossible values."""
        table = read_table(self.path, self.contents, self.naming.time_format, self.naming.format)
        heads = {re.split("[^a-z]", name.lower())[0] for name in self.names}
        of_ais = not heads.isdisjoint(("mmsi", "sog", "cog"))
        mistakes = []
        for column, quantity in self._used.items():
            if self.contents[column] == "number":
                values = table.columns[column]
                # Blank the codes of "not available" first: most are impossible values.
                for code in self.naming.missing:
                    self.unavailable[f"{quantity} {code:g}"] += int((values == code).sum())
                    values[values == code] = np.nan
                self.unavailable += blank_codes(quantity, values, of_ais)
                if quantity == "speed" and COURSE not in self._of.values():
                    continue  # a speed without a course may be that of a state, which has a sign
                impossible_value = impossible(quantity, values, self.naming.scale(quantity))
                if impossible_value is not None:
                    line = int(table.lines[impossible_value.row])
                    mistakes.append(Place(self.path, line, 1, f"{column}: {impossible_value.what}"))
                if quantity in ("course", "azimuth"):
                    continue  # an angle of 0.01 deg is near one of 359.99 deg
                for value, n in outlying(values).items():
                    what = f"{n} cells are {value:.9g}, far outside the others: empty them, or say"
                    way = f"`missing: [{value:.9g}]`, if they hold no measurement"
                    self.far.append(f"{self.path}: {column}: {what} {way}")
        if mistakes:
            raise DataError(*mistakes)
        return table

    @property
    def is_geodetic(self) -> bool:
        """True if positions are made of latitude and longitude."""
        return any("latitude" in sources for sources in self._of.values())

    def of_columns(self, names: Collection[str]) -> str:
        """Find the first of these quantities that has a column of its own; empty without one."""
        return next(
            (name for name, sources in self._of.items() if name in names and sources == (name,)), ""
        )

    def first_place(self, table: Table) -> tuple[float, ...] | None:
        """Find the latitude, longitude (deg) and height of the first row that has them."""
        if not self.is_geodetic:
            return None
        place = self._geodetic(table)
        complete = np.flatnonzero(np.isfinite(np.stack(place)).all(axis=0))
        if not len(complete):
            return None
        latitude, longitude, height = (float(part[complete[0]]) for part in place)
        return latitude * 180.0 / pi, longitude * 180.0 / pi, height

    def quantities(self, table: Table, origin: tuple[float, ...] | None) -> dict[str, Array]:
        """Compute the quantities (R,) by name, in SI; NaN where they are missing, or all of them are."""
        plane: Mapping[str, Array] = {}
        if origin is not None and self.is_geodetic:
            # Step 1: east, north and up of the origin, from latitude, longitude and altitude.
            latitude, longitude, *height = origin
            at = (latitude * pi / 180.0, longitude * pi / 180.0, *height, 0.0)[:3]
            places = np.stack(self._geodetic(table))
            finite = np.isfinite(places).all(axis=0)
            known = Geodetic(*np.where(finite, places, 0.0))
            enu = east_north_up(known, Geodetic(*map(np.asarray, at)))
            plane = dict(zip(_PLANE, np.where(finite, enu, np.nan), strict=True))
        out = {}
        # Step 2: each quantity from its column, from speed and course, or from Step 1.
        for name, sources in self._of.items():
            if sources == (name,):
                out[name] = self._value(table, name)
            elif sources == COURSE:
                out[name] = self._along(table, name)
            elif sources and plane:
                out[name] = plane[_plain(name)]
            else:
                out[name] = np.full(len(table.lines), np.nan)
        return out

    def _sources(self, name: str) -> tuple[str, ...]:
        """Find the source of a quantity: a column, geodetic coordinates, speed and course, or none."""
        if self.column(name) is not None:
            return (name,)
        plain = _plain(name)
        both = GEODETIC if plain == "z" else GEODETIC[:2]
        if plain in _PLANE and all(map(self.column, both)):
            # Heights count wherever there are any: a plane touches the ground at one height only.
            return tuple(part for part in GEODETIC if self.column(part))
        if plain in ("vx", "vy") and all(map(self.column, COURSE)):
            return COURSE
        return ()

    def _value(self, table: Table, name: str) -> Array:
        column = self.column(name)
        assert column is not None
        scale = self.naming.scale(name)
        values = table.columns[column]
        return values if scale == 1.0 else values * scale

    def _geodetic(self, table: Table) -> Geodetic:
        latitude, longitude = (self._value(table, name) for name in GEODETIC[:2])
        if "altitude" in chain.from_iterable(self._of.values()):
            return Geodetic(latitude, longitude, self._value(table, "altitude"))
        return Geodetic(latitude, longitude, np.zeros_like(latitude))

    def _along(self, table: Table, name: str) -> Array:
        """Compute the velocity east (vx) or north of a speed and a course clockwise from north."""
        speed, course = (self._value(table, part) for part in COURSE)
        c, s = cos_sin(np.where(np.isnan(course), 0.0, course))
        # vx = v sin(course), vy = v cos(course)
        velocity = speed * (s if _plain(name) == "vx" else c)
        return np.where(np.isnan(course), np.nan, velocity)


def _plain(name: str) -> str:
    """Return the quantity of a component: x of ``px``, and of the second sensor's ``2.x``."""
    plain = name.rpartition(".")[2]
    return plain[1:] if plain in ("px", "py", "pz") else plain
