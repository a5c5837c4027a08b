"""Candidates of the units of times, positions and speeds, the best first, by which of them agree."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array, Index
from trackbench.core.latitude_longitude import SEMI_MAJOR_AXIS
from trackbench.scenarios.recordings.row_noise import error_of_line
from trackbench.scenarios.recordings.rows import usual_interval
from trackbench.scenarios.recordings.units import UNITS

NEAR = 0.07
"""Largest relative difference between a measured speed and that of the positions which agrees."""
_MARGIN = 0.6
"""Candidates whose penalty is less than this above the least one remain possible."""
_DISAGREES = 2.0
"""Penalty of a measured speed that does not agree with the positions in any unit."""
_MANY = 20.0
"""Standard deviations of a position's error, from which on a displacement hardly shows this error."""
_FEW = 0.3
"""Penalty of min, h or d, which are rare units of time, if the numbers fit the unit exactly."""
LEAST_COSINE = 0.8
"""Least cosine between two directions that agree."""
_LEAST_ANGLE = 0.03  # rad between directions that differ for sure
_REGULAR = 0.8  # of the intervals are the usual one
_AIS = ("mmsi", "sog", "cog", "imo", "sourcemmsi")
_RECEIVERS = (
    *("timeusec", "itow", "eph", "epv", "hacc", "vacc", "fixtype", "headmot", "satellitesused"),
    *("satellitesvisible", "timeutcusec", "late7", "lone7", "gpsraw", "hmsl"),
)
"""Names of columns of u-blox, MAVLink and PX4, whose positions are in 1e-7 deg."""
COURSE_UNITS = ("deg", "rad", "deg/10", "deg/100", "degE5")
_SMALLEST_WHOLE = 1e4
"""Whole numbers below are degrees."""
LENGTH_UNITS = {"m": 0.0, "km": 1.0, "mm": 1.0, "cm": 1.0, "ft": 1.0, "mi": 1.0, "nmi": 1.0}
SPEED_UNITS = {
    **{"m/s": 0.0, "kn": 0.0, "km/h": 0.25, "mph": 0.25, "ft/s": 0.5, "cm/s": 0.5, "mm/s": 1.0},
    **{"kn/10": 0.5, "km/s": 2.0},
}
"""Penalty of each unit. Lengths that are not m count only beside a speed that agrees."""
_USUAL_SPEEDS = ((0.05, 400.0, 0.0), (0.01, 3000.0, 1.0), (1e-3, 11200.0, 2.0))
"""Least and largest speed, m/s, and the penalty within; 4 beyond. 11.2 km/s leaves the Earth."""
_STANDSTILL = 0.5
"""m/s that something may seem to have whose measured speed is 0"""
_TODAY = (1.0e9, 2.1e9)
"""seconds since 1970 of the years 2001 to 2036"""
_OTHER_EPOCHS = (6e7, 6.5e8)
"""seconds that may be those since 2000, 2006 (BeiDou), 2010 and the like, or the ms of hours and days"""


class TimeUnit(NamedTuple):
    """Numbers that times in a unit have."""

    unit: str
    penalty: float
    """how unlikely the unit is before the numbers are considered"""
    largest: float
    """largest number of a clock that began at zero"""
    dates: tuple[tuple[float, float], ...] = ()
    """least and largest number of times that count from a date, such as 1970"""
    is_whole: bool = False
    """True if times in this unit usually are whole numbers"""


TIME_UNITS = (
    TimeUnit("s", 0.0, 4e7, ((6.5e8, 5e9),)),
    TimeUnit("ms", 0.0, 4e9, ((6.5e11, 5e12),), True),
    TimeUnit("us", 0.0, 4e12, ((6.5e14, 5e15),), True),
    TimeUnit("ns", 0.0, 4e15, ((6.5e17, 5e18),), True),
    # Ticks of Windows since 1601, and since the year 1.
    TimeUnit("100ns", 0.0, 0.0, ((1.2e17, 1.5e17), (6.25e17, 6.48e17)), True),
    # Days of spreadsheets, since the year 0, and Julian dates.
    TimeUnit("d", 0.0, 0.0, ((2e4, 8e4), (7e5, 8e5), (2.4e6, 2.5e6))),
    TimeUnit("d", 2.0, 4e3),
    TimeUnit("h", 2.0, 1e4),
    TimeUnit("min", 2.0, 1e6),
)


class PossibleFormat(NamedTuple):
    """One of several possible formats of dates."""

    factor: float
    """factor on the times that were read by another format, such as 1/60 for min:s read as h:min"""
    penalty: float
    """how unlikely the format is"""


class AngleUnit(NamedTuple):
    """Unit of latitude and longitude."""

    unit: str
    penalty: float
    """how unlikely the unit is before the numbers are considered"""
    is_whole: bool
    """True if coordinates in this unit are whole numbers"""
    words: tuple[str, ...] = ()
    """names of columns that files with this unit have"""


GEODETIC_UNITS = (
    AngleUnit("deg", 0.0, False),
    AngleUnit("rad", 0.0, False),
    AngleUnit("degE7", 0.0, True, _RECEIVERS),
    AngleUnit("degE6", 0.1, True),
    AngleUnit("semicircle", 0.2, True, ("positionlat", "positionlong")),
    AngleUnit("mas", 0.3, True),
    AngleUnit("deg/600000", 0.4, True, _AIS),
    AngleUnit("degE5", 0.5, True),
)
"""Penalties differ by less than `_MARGIN`: no unit is sure without a word or a measured speed."""


@dataclass(frozen=True, kw_only=True)
class UnscaledRows:
    """Rows of one target as they are written: the units of their numbers are unknown.

    A file measures a velocity, or a speed and perhaps a course, or none of them.
    """

    time: Array
    """times (R,), in seconds if they are dates"""
    is_dated: bool
    """True if times are dates or numbers of steps, which need no unit"""
    position: Array
    """longitude and latitude or x and y (2, R), or ranges (n, R); (0, R) without a position"""
    is_geodetic: bool
    """True if columns are named as longitude and latitude"""
    speed: Array | None = None
    """speeds (R,)"""
    course: Array | None = None
    """directions of movement (R,), clockwise from north"""
    velocity: Array | None = None
    """velocities (2, R) along x and y"""
    plain_column_names: frozenset[str] = frozenset()
    """names of all columns of the file, in small letters without marks"""
    least_decimals: int = 0
    """digits behind the decimal point, in the coordinate that has the fewest"""


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """One choice of units for a table; empty texts stand for quantities without a unit."""

    time_unit: str
    """unit of numbers; of dates their format, which is empty for the format already known"""
    position_unit: str
    as_geodetic: bool
    """True if positions are read as longitude and latitude"""
    speed_unit: str
    course_unit: str
    penalty: float
    """how unlikely the choice is: the least penalty is best"""
    usual_speed: float
    """median speed of the positions in these units, m/s"""
    speed_agrees: bool
    """True if a measured speed is that of the positions"""
    course_agrees: bool
    """True if a measured course, or velocity, has the direction in which the positions change"""
    seconds_per_unit: float = 1.0
    """factor from the times as they were read to seconds, such as 1/60 for min:s read as h:min"""

    @property
    def key(self) -> tuple[str, str]:
        """Units of time and position: of several candidates with these only the best one is kept."""
        return self.time_unit, self.position_unit


def likely_units(
    unscaled: UnscaledRows,
    known_units: Mapping[str, str],
    possible_formats: Mapping[str, PossibleFormat] = MappingProxyType({}),
) -> list[Candidate]:
    """Return the likeliest choices of units, the best first.

    These are the choices whose penalty is near the least one. ``known_units`` are units by quantity that
    need no guess. ``possible_formats`` are the possible formats of dates, if there are several.
    """
    candidates: list[Candidate] = []
    # Step 1: combine each unit of the position with each of the time, and then with those of the speed.
    combinations = product(
        _position_units(unscaled, known_units), _time_units(unscaled, known_units, possible_formats)
    )
    for of_position, of_time in combinations:
        position_unit, as_geodetic, position_penalty = of_position
        time_unit, seconds_per_unit, time_penalty = of_time
        meters = positions_in_meters(unscaled.position, position_unit, as_geodetic)
        displacements = Displacements.of_rows(unscaled.time * seconds_per_unit, meters)
        penalty = position_penalty + time_penalty
        # A target whose measured speed is always 0 seems to move by the errors of its positions alone.
        # The usual speed is NaN if nothing moves for sure: then neither comparison below is true.
        stands_still = (
            unscaled.speed is not None
            and bool(np.isfinite(unscaled.speed).any())
            and not np.nan_to_num(unscaled.speed).any()
        )
        if not (stands_still and displacements.usual_speed < _STANDSTILL):
            penalty += _penalty_of_speed(displacements.usual_speed, as_geodetic)
        if stands_still and displacements.usual_speed >= _STANDSTILL:
            penalty += 1.0
        penalty += _penalty_of_interval(unscaled.time * seconds_per_unit, as_geodetic)
        for speed_unit, speed_penalty, speed_agrees in _speed_units(
            unscaled, known_units, displacements, as_geodetic
        ):
            course_unit, course_agrees = _course_unit(
                unscaled, known_units, displacements, speed_agrees
            )
            candidates.append(
                Candidate(
                    time_unit=time_unit,
                    position_unit=position_unit,
                    as_geodetic=as_geodetic,
                    speed_unit=speed_unit,
                    course_unit=course_unit,
                    penalty=penalty + speed_penalty,
                    usual_speed=displacements.usual_speed,
                    speed_agrees=speed_agrees,
                    course_agrees=course_agrees,
                    seconds_per_unit=seconds_per_unit,
                )
            )
    # Step 2: keep the best of each unit of time and position. Without a measured speed that agrees, a
    # length is in m or in the known unit.
    candidates.sort(key=lambda candidate: candidate.penalty)
    best: dict[tuple[str, str], Candidate] = {}
    for candidate in candidates:
        is_length = not candidate.as_geodetic and candidate.position_unit not in (
            "m",
            *known_units.values(),
        )
        if candidate.speed_agrees or not is_length:
            best.setdefault(candidate.key, candidate)
    # Step 3: drop the choices that are clearly less likely than the best one.
    ranked = list(best.values())
    limit = ranked[0].penalty + _MARGIN
    return [candidate for candidate in ranked if candidate.penalty < limit]


def usual_acceleration(unscaled: UnscaledRows, chosen: Candidate) -> float:
    """Return the upper quartile of the target's acceleration, m/s^2; 0 if none is sure.

    The positions are those of the ``unscaled`` rows in the ``chosen`` units. Displacements of three
    lengths are tried: at least 100, 400 and 1600 standard deviations of a position's error, unless a
    quarter of the rows has no such displacements. The largest acceleration is returned: errors of
    positions hide the acceleration of short displacements, and a path turns too often within long ones.
    """
    time = unscaled.time * chosen.seconds_per_unit
    meters = positions_in_meters(unscaled.position, chosen.position_unit, chosen.as_geodetic)
    largest = 0.0
    for times_as_long in (5.0, 20.0, 80.0):  # as those of `likely_units`
        displacements = Displacements.of_rows(time, meters, times_as_long * _MANY)
        if np.isfinite(displacements.usual_speed):
            largest = max(largest, _sure_acceleration(displacements, len(unscaled.time)))
    return largest


def _sure_acceleration(displacements: "Displacements", rows: int) -> float:
    """Return the upper quartile of the acceleration, m/s^2, less two standard deviations of its error.

    It is 0 if this is negative. ``displacements`` are those between some of the table's rows, whose
    number is ``rows``.
    """
    velocities = displacements.vectors / displacements.duration
    # Pairs of displacements: the second one begins in the row in which the first one ends.
    number_from_row = np.full(rows, -1)  # number of the displacement that begins in a row
    number_from_row[displacements.first_row] = np.arange(len(displacements.first_row))
    second = number_from_row[displacements.last_row]
    first = np.flatnonzero(second >= 0)
    second = second[first]
    if not len(second):
        return 0.0
    # a = (v_2 - v_1) / t, where t is the time between the middles of both displacements
    changes = np.hypot.reduce(velocities[:, second] - velocities[:, first])
    interval = 0.5 * (displacements.duration[second] + displacements.duration[first])
    # (z_2 - 2 z_1 + z_0) / t^2 has the standard deviation sqrt(6) sigma / t^2.
    error = np.sqrt(6.0) * displacements.sigma / float(np.median(interval)) ** 2
    return max(float(np.quantile(changes / interval, 0.75)) - 2.0 * error, 0.0)


def is_usual_speed(speed: float) -> bool:
    """Test whether most targets may have this usual speed, m/s: it is within 0.05 and 400 m/s."""
    least, largest, _ = _USUAL_SPEEDS[0]
    return least <= speed <= largest


def _time_units(
    unscaled: UnscaledRows,
    known_units: Mapping[str, str],
    possible_formats: Mapping[str, PossibleFormat],
) -> Iterator[tuple[str, float, float]]:
    """Yield each possible unit of the time, its factor to seconds, and its penalty.

    Dates have no unit: in its place stands their format, empty for the format by which they were read.
    ``known_units`` are units by quantity that need no guess. ``possible_formats`` are the formats of
    dates, if there are several.
    """
    if unscaled.is_dated:
        yield "", 1.0, possible_formats.get("", PossibleFormat(factor=1.0, penalty=0.0)).penalty
        for time_format, possible in possible_formats.items():
            if time_format:
                yield time_format, possible.factor, possible.penalty
        return
    if "time" in known_units:
        yield known_units["time"], UNITS[known_units["time"]], 0.0
        return
    # Step 1: properties of the numbers that speak for some units.
    finite = unscaled.time[np.isfinite(unscaled.time)]
    largest = float(np.abs(finite).max(initial=0.0))
    is_whole = not (finite % 1.0).any()
    whole_seconds = _whole_seconds_of_days(finite)
    # The largest time may count from 1970: it then is within the years 2001 to 2036.
    is_today = any(
        _TODAY[0] <= largest * UNITS[unit] <= _TODAY[1] for unit in ("s", "ms", "us", "ns")
    )
    intervals = np.diff(np.unique(finite))
    in_minutes = bool(len(intervals)) and not (intervals % 60.0).any()
    has_degrees = unscaled.is_geodetic and _largest_coordinates(unscaled.position)[1] <= 90.0
    # Step 2: the penalty of each unit, the least one of a unit with several rows in `TIME_UNITS`. The
    # penalties add up, and those of two candidates are compared by `_MARGIN`. Numbers that fit a rare
    # unit exactly outweigh all other signs: `_FEW` replaces the sum.
    penalty_by_unit: dict[str, float] = {}
    for candidate in TIME_UNITS:
        penalty = candidate.penalty
        is_date = any(least <= largest <= most for least, most in candidate.dates)
        if not is_date and largest > candidate.largest:
            since_other_epoch = candidate.unit == "s" and largest >= _OTHER_EPOCHS[0]
            penalty += 0.5 if since_other_epoch and largest <= _OTHER_EPOCHS[1] else 3.0
        if candidate.is_whole and not is_whole:
            penalty += 1.0
        # Times since 1970 are likelier than a clock that has run so long in another unit.
        if not is_date and is_today:
            penalty += 1.5
        # Intervals of whole minutes, as in 0, 60 and 120, are rather seconds than ms.
        if candidate.unit == "ms" and is_whole and in_minutes:
            penalty += 0.5
        # Dates in days have fractions of days that are whole seconds; whole days are rare.
        if candidate.unit == "d" and is_date:
            if whole_seconds:
                penalty -= 1.0
            elif is_whole:
                penalty += 1.0
        # 0.01667 and 0.03333 are whole seconds in min; in s they may be 60 rows a second.
        if candidate.unit in ("min", "h") and _are_rounded_seconds(
            finite * UNITS[candidate.unit], finite
        ):
            penalty = _FEW
        # 0.00833 is 30 s in h; in min it may be half a second, which is less likely than h.
        elif candidate.unit == "min" and _are_rounded_seconds(finite * UNITS["h"], finite):
            penalty = 2.0 * _FEW
        # 0.041667 h is 150 s, and in d it is an hour.
        elif candidate.unit == "d" and not is_date and _may_be_days(finite):
            penalty = _FEW
        # 0, 1 and 2 may count minutes, hours or days, which alone have a penalty of their own here. It
        # is lowered, so that they win if degrees in so many s are the speed of a rocket: `likely_units`
        # adds the penalty of the speed.
        elif candidate.penalty and not is_date and is_whole and has_degrees:
            penalty -= 0.5
        penalty_by_unit[candidate.unit] = min(penalty, penalty_by_unit.get(candidate.unit, np.inf))
    for unit, penalty in penalty_by_unit.items():
        yield unit, UNITS[unit], penalty


def _whole_seconds_of_days(times: Array) -> bool:
    """Test whether times (R,), taken as days, have fractions of days that are whole seconds.

    Times in seconds with so many digits behind the point, taken as days, are no whole seconds.
    """
    # All times have at most three digits behind the point: too few to show whole seconds.
    if not len(times) or not (np.abs(times * 1e3 % 1.0 - 0.5) < 0.49).any():
        return False
    seconds = times * 86400.0
    # Nine digits behind the point are 1e-4 s, six are 0.09 s.
    return bool((np.abs(seconds - np.rint(seconds)) < 0.09).mean() > 0.95)


def _are_rounded_seconds(seconds: Array, written: Array) -> bool:
    """Test whether times (R,) in ``seconds`` are whole, but for the rounding of the ``written`` numbers.

    These are the times in the unit of the file. They must have three digits or more behind the point,
    and the rounding must be below 0.05 s.
    """
    # The least number of digits with which all numbers are written exactly.
    digits = next(
        (
            d
            for d in range(10)
            if not (np.abs(_difference_from_whole(written * 10.0**d)) > 1e-3).any()
        ),
        9,
    )
    if digits < 3 or not len(written):
        return False
    largest = np.abs(written).max()
    # Half of the last digit in s, and a tenth of it more.
    rounding = 0.55 * 10.0**-digits * float(seconds.max() / largest) if largest > 0.0 else 0.0
    return bool(
        0.0 < rounding < 0.05 and (np.abs(_difference_from_whole(seconds)) <= rounding).all()
    )


def _may_be_days(times: Array) -> bool:
    """Test whether times (R,) are whole seconds as hours, and multiples of ten minutes as days."""
    if not _are_rounded_seconds(times * UNITS["h"], times):
        return False
    # Distance in s from a multiple of ten minutes, which the rounding of the numbers explains if small.
    off_whole = 600.0 * _difference_from_whole(times * UNITS["d"] / 600.0)
    return bool((np.abs(off_whole) < 0.6).all())


def _difference_from_whole(values: Array) -> Array:
    """Return the differences of values from the nearest whole numbers."""
    return values - np.rint(values)


def _position_units(
    unscaled: UnscaledRows, known_units: Mapping[str, str]
) -> Iterator[tuple[str, bool, float]]:
    """Yield each possible unit of the position, whether it is read as latitude, and its penalty.

    The second value is True for longitude and latitude, and False for lengths. ``known_units`` are units
    by quantity that need no guess.
    """
    if not unscaled.is_geodetic:
        is_ais = bool(unscaled.plain_column_names.intersection(_AIS))
        known = known_units.get("x", known_units.get("range"))
        if known:
            yield known, False, 0.0
        else:
            yield from _length_units(unscaled, is_ais)
        if known is None and _may_be_degrees(unscaled):
            yield "deg", True, 0.0 if is_ais else 1.0
        return
    if "latitude" in known_units or "longitude" in known_units:
        yield known_units.get("latitude", known_units.get("longitude", "deg")), True, 0.0
        return
    longitude, latitude = _largest_coordinates(unscaled.position)
    is_whole = not (unscaled.position[np.isfinite(unscaled.position)] % 1.0).any()
    is_large = max(longitude, latitude) >= _SMALLEST_WHOLE
    # Some units are usual beside columns with certain names, such as degE7 beside those of MAVLink.
    has_words = {
        candidate.unit: not unscaled.plain_column_names.isdisjoint(candidate.words)
        for candidate in GEODETIC_UNITS
    }
    any_words = any(has_words.values())
    fitting = []
    for candidate in GEODETIC_UNITS:
        in_degrees = UNITS[candidate.unit] / UNITS["deg"]
        # 91 and 181 deg are codes of AIS.
        if latitude * in_degrees > 91.001 or longitude * in_degrees > 360.001:
            continue
        # Large whole numbers are in a unit for whole numbers, all others are not.
        if candidate.is_whole != (is_whole and is_large):
            continue
        penalty = 0.0
        if not has_words[candidate.unit]:
            penalty = candidate.penalty
            if candidate.is_whole and any_words:  # the names are those of another unit
                penalty += 1.0
        # Six digits behind the point are 6 m in rad, five are 64 m: too coarse for most files.
        if candidate.unit == "rad" and unscaled.least_decimals <= 6:
            penalty += 0.5 if unscaled.least_decimals == 6 else 1.0
        fitting.append((candidate.unit, True, penalty))
    # Numbers that are impossible in every unit are reported when they are read, as degrees.
    yield from fitting or [("deg", True, 0.0)]


def _length_units(unscaled: UnscaledRows, is_ais: bool) -> Iterator[tuple[str, bool, float]]:
    """Yield each possible unit of lengths, False, which says that it is none of angles, and its penalty.

    ``is_ais`` is True if the names of the columns are those of AIS messages.
    """
    # Without a measured speed nothing shows that lengths are not in m.
    is_alone = unscaled.speed is None and unscaled.velocity is None
    for unit, unit_penalty in LENGTH_UNITS.items():
        if unit != "m" and is_alone:
            continue
        penalty = unit_penalty
        if is_ais and _may_be_degrees(unscaled):  # x and y of AIS rather are degrees
            penalty += 1.0
        yield unit, False, penalty


def _largest_coordinates(position: Array) -> tuple[float, float]:
    """Return the largest absolute values of longitude and latitude, the two rows of positions (2, R)."""
    longitude, latitude = position
    largest_longitude = float(np.nanmax(np.abs(longitude), initial=0.0))
    largest_latitude = float(np.nanmax(np.abs(latitude), initial=0.0))
    return largest_longitude, largest_latitude


def _may_be_degrees(unscaled: UnscaledRows) -> bool:
    """Test whether x and y may be longitude and latitude, in a table that can show it.

    It can by a measured speed, or by the names of its columns if these are those of AIS.
    """
    has_speed = unscaled.speed is not None or unscaled.velocity is not None
    is_ais = bool(unscaled.plain_column_names.intersection(_AIS))
    return (has_speed or is_ais) and look_like_degrees(unscaled)


def look_like_degrees(unscaled: UnscaledRows) -> bool:
    """Test whether positions have the size and the decimals of longitude and latitude in degrees."""
    # Degrees with less than four digits behind the point would be too coarse, beyond 10 m.
    if len(unscaled.position) != 2 or unscaled.least_decimals < 4:
        return False
    longitude, latitude = _largest_coordinates(unscaled.position)
    # 181 and 91 deg are codes of AIS for a missing position.
    return longitude <= 181.0 and latitude <= 91.0


def positions_in_meters(position: Array, unit: str, as_geodetic: bool) -> Array:
    """Return positions (n, R) in meters; the given ones are in ``unit``.

    If they are longitude and latitude (``as_geodetic``), they become meters east and north on a sphere,
    with the scale of the median latitude.
    """
    if not as_geodetic:
        return position * UNITS[unit]
    longitude, latitude = position * UNITS[unit]
    median_latitude = 0.0
    if np.isfinite(latitude).any():
        median_latitude = float(np.nanmedian(latitude))
    # Longitudes relative to the first one, within half a turn: 179 and -179 deg are 2 deg apart.
    first_longitude = 0.0
    known = longitude[np.isfinite(longitude)]
    if len(known):
        first_longitude = float(known[0])
    east = np.remainder(longitude - first_longitude + np.pi, 2.0 * np.pi) - np.pi
    return SEMI_MAJOR_AXIS * np.stack([east * np.cos(median_latitude), latitude])


@dataclass(frozen=True)
class Displacements:
    """L displacements, each from one row to a later one."""

    first_row: Index
    """row (L,) in which each displacement begins"""
    last_row: Index
    """row (L,) in which it ends"""
    duration: Array
    """time (L,) between both rows, s"""
    vectors: Array
    """change (n, L) of the position, m"""
    usual_speed: float
    """median speed, m/s; NaN if nothing moved for sure"""
    sigma: float = 0.0
    """standard deviation of a position's error, m"""

    @classmethod
    def of_rows(cls, time: Array, meters: Array, many: float = _MANY) -> "Displacements":
        """Return displacements over so few rows that errors of the positions are just small beside them.

        ``time`` (R,) is in s, and ``meters`` (n, R) are the positions. The number of rows begins at 1,
        and is doubled until the median displacement is ``many`` standard deviations of a position's
        error. It is at most a quarter of all rows.
        """
        rows = np.array([], dtype=np.intp)
        if len(meters):
            rows = np.flatnonzero(np.isfinite(time) & np.isfinite(meters).all(axis=0))
        rows = rows[np.argsort(time[rows], kind="stable")]
        time = time[rows]
        meters = meters[:, rows]
        nothing = np.array([], dtype=np.intp)
        if len(rows) < 3:
            return cls(nothing, nothing, np.array([]), meters[:, :0], np.nan)
        sigma = float(np.hypot.reduce([error_of_line(time, axis) for axis in meters]))
        lag = 1
        while True:
            vectors = meters[:, lag:] - meters[:, :-lag]
            lengths = np.sqrt(np.square(vectors).sum(axis=0))
            if 2 * lag > max(1, len(rows) // 4) or np.median(lengths) > many * sigma:
                break
            lag *= 2
        duration = time[lag:] - time[:-lag]
        later = duration > 0.0
        speeds = lengths[later] / duration[later]
        # The long displacements must exceed the errors of positions, or nothing moves for sure.
        is_sure = later.any() and float(np.quantile(lengths, 0.9)) > 3.0 * sigma
        return cls(
            first_row=rows[:-lag][later],
            last_row=rows[lag:][later],
            duration=duration[later],
            vectors=vectors[:, later],
            usual_speed=float(np.median(speeds)) if is_sure else np.nan,
            sigma=sigma,
        )


def _penalty_of_speed(speed: float, on_earth: bool) -> float:
    """Return the penalty of a usual speed, m/s, that few targets have.

    It is added to the other penalties of a choice of units. A choice remains possible if the sum is less
    than `_MARGIN`, 0.6, above that of the best one. If positions are x and y, not latitudes
    (``on_earth`` is False), slow targets such as cells, robots and pixels get 1 at most.
    """
    # Nothing moves, or not for sure (NaN), so that the speed speaks against no unit.
    if not np.isfinite(speed) or speed == 0.0:
        return 0.0
    penalty = 4.0  # of a speed beyond all usual ones
    for least, largest, penalty_within in _USUAL_SPEEDS:
        if least <= speed <= largest:
            penalty = penalty_within
            break
    if on_earth or speed > 1.0:
        return penalty
    return min(penalty, 1.0)


def _penalty_of_interval(times: Array, is_gps: bool) -> float:
    """Return the penalty of the usual interval of times, s: whole seconds or a whole rate have none.

    It is added to the other penalties of a choice of units, and so has their scale (`_MARGIN`). If
    ``is_gps``, a high rate has a larger penalty, as receivers of GPS have fewer rows a second than other
    sensors. The caller takes latitudes and longitudes as those of GPS.
    """
    finite = np.sort(times[np.isfinite(times)])
    intervals = np.diff(finite)
    intervals = intervals[intervals > 0.0]
    if not len(intervals):
        return 0.0
    usual = usual_interval(finite)
    penalty = 0.0
    # More than 500 rows a second are rare; so are more than 67, or of GPS more than 25.
    if usual < 0.002:
        penalty += 3.0 if is_gps else 2.0
    elif usual < (0.039 if is_gps else 0.015):
        penalty += 1.0
    # Without a regular interval its length shows nothing more.
    if (np.abs(intervals - usual) > 0.02 * usual).mean() > 1.0 - _REGULAR:
        return penalty
    if usual >= 20.0:
        # Multiples of 30 s, and 20 s, are usual; 1000 s are not, and may be 1000 ms.
        if min(usual % 30.0, -usual % 30.0) <= 0.5 or abs(usual - 20.0) < 0.5:
            return penalty
        return penalty + (1.0 if usual > 60.0 else 0.5)
    # Longer intervals are multiples of half a second, and shorter ones belong to a whole rate.
    if usual >= 1.0:
        return penalty + 0.5 * (min(usual % 0.5, -usual % 0.5) > 0.02 * usual)
    rate = 1.0 / usual
    return penalty + (abs(rate - np.rint(rate)) > 0.03 * rate)


def _speed_units(
    unscaled: UnscaledRows,
    known_units: Mapping[str, str],
    displacements: Displacements,
    as_geodetic: bool,
) -> Iterator[tuple[str, float, bool]]:
    """Yield each possible unit of the measured speed, its penalty, and whether the speed agrees in it.

    The first units are those in which the speed agrees with that of the ``displacements``. The last one
    is the known unit, or empty, with the penalty of a disagreement, 0 if there is nothing to compare.
    ``known_units`` are units by quantity that need no guess. ``as_geodetic`` is True if positions are
    latitudes and longitudes.
    """
    measured_speed = _measured_speed(unscaled)
    if measured_speed is None:
        yield "", 0.0, False
        return
    ratio = _speed_ratio(measured_speed, displacements)
    known = known_units.get("speed", known_units.get("vx"))
    agreeing = []
    for unit, penalty in SPEED_UNITS.items():
        if known is not None and unit != known:
            continue
        difference = np.inf  # relative, of the measured speed from that of the positions
        if np.isfinite(ratio):
            difference = abs(ratio * UNITS[unit] - 1.0)
        if difference >= NEAR:
            continue
        # Beside latitudes, and in AIS messages, speeds are usually in knots.
        is_ais = not unscaled.plain_column_names.isdisjoint(_AIS)
        is_at_sea = (as_geodetic and unit == "kn") or (is_ais and unit.startswith("kn"))
        unit_penalty = 0.0 if is_at_sea or unit == known else penalty
        # Of two units in which the speed agrees the nearer one is likelier.
        agreeing.append((unit, unit_penalty + 0.5 * difference / NEAR, True))
    yield from agreeing
    disagreement = _DISAGREES if np.isfinite(ratio) else 0.0
    yield known or "", disagreement, False


def _measured_speed(unscaled: UnscaledRows) -> Array | None:
    """Return the measured speed (R,), in the unit of the file; None if there is none."""
    if unscaled.velocity is not None:
        return np.hypot(*unscaled.velocity)
    return unscaled.speed


def _speed_ratio(measured_speed: Array, displacements: Displacements) -> float:
    """Return the median ratio of measured speeds (R,), as written, to the positions' speed in m/s.

    It is the reciprocal of the unit in m/s, if the speeds agree. NaN if there is nothing to compare.
    """
    if not len(displacements.first_row) or not np.isfinite(displacements.usual_speed):
        return np.nan
    speed = np.sqrt(np.square(displacements.vectors).sum(axis=0)) / displacements.duration
    # A displacement's speed is compared with the mean of the measured speeds at both of its ends.
    mean = 0.5 * (measured_speed[displacements.first_row] + measured_speed[displacements.last_row])
    valid = np.isfinite(mean) & (mean > 0.0) & (speed > 0.0)
    if not valid.any():
        return np.nan
    # Only rows count where the target moves, at half of its median speed or more.
    moving = valid & (speed >= 0.5 * np.median(speed[valid]))
    return float(np.median(mean[moving] / speed[moving]))


def _course_unit(
    unscaled: UnscaledRows,
    known_units: Mapping[str, str],
    displacements: Displacements,
    speed_agrees: bool,
) -> tuple[str, bool]:
    """Return the unit in which the course agrees best with the displacements, and whether it agrees.

    The course is compared only if the measured speed agrees with that of the displacements
    (``speed_agrees``). A measured velocity has no course, so that the unit is empty, but its direction
    is compared, too.
    """
    if unscaled.velocity is not None:
        # If the direction agrees better with vx and vy exchanged, north stands before east.
        cosine = median_cosine(unscaled.velocity, displacements)
        exchanged = median_cosine(unscaled.velocity[::-1], displacements)
        return "", speed_agrees and cosine >= LEAST_COSINE and not is_nearer(exchanged, cosine)
    if unscaled.course is None or unscaled.speed is None or not speed_agrees:
        return known_units.get("course", ""), False
    largest = float(np.nanmax(np.abs(unscaled.course), initial=0.0))
    units: Sequence[str] = COURSE_UNITS
    if "course" in known_units:
        units = [known_units["course"]]
    elif (unscaled.course[np.isfinite(unscaled.course)] % 1.0).any():
        units = ("deg", "rad")  # the others are of whole numbers
    best = ""
    cosine = -1.0
    exchanged = -1.0
    for unit in units:
        course = unscaled.course * UNITS[unit]
        # 511 deg is a code of AIS.
        if largest * UNITS[unit] > UNITS["deg"] * 511.001:
            continue
        along = unscaled.speed * np.stack([np.sin(course), np.cos(course)])
        unit_cosine = median_cosine(along, displacements)
        # A later unit, which is rarer, must agree clearly better.
        if unit_cosine > cosine + 0.01:
            best = unit
            cosine = unit_cosine
            # A course that counts from x is one from north with both axes exchanged.
            exchanged = median_cosine(along[::-1], displacements)
    return best, cosine >= LEAST_COSINE and not is_nearer(exchanged, cosine)


def is_nearer(cosine: float, other: float) -> bool:
    """Test whether directions with the median ``cosine`` agree clearly better than those with ``other``.

    Their usual angle is then less than half as large, as 1 - cos(a) is a^2 / 2.
    """
    return 1.0 - other > 4.0 * (1.0 - cosine) + _LEAST_ANGLE**2 / 2.0


def are_courses(numbers: Array, time: Array, positions: Array) -> bool:
    """Test whether numbers (R,) are the directions in which positions move, deg clockwise from north.

    ``time`` (R,) may be in any unit, and ``positions`` (2, R), east and north, in any unit of a length.
    """
    if len(positions) != 2 or not ((numbers >= -180.0) & (numbers <= 360.0)).all():
        return False
    course = numbers * UNITS["deg"]
    along = np.stack([np.sin(course), np.cos(course)])
    return median_cosine(along, Displacements.of_rows(time, positions)) >= LEAST_COSINE


def median_cosine(velocity: Array, displacements: Displacements) -> float:
    """Return the median cosine of the angle between velocities (2, R) and the displacements.

    It is -1 if no row can be compared. The unit of the velocities does not matter.
    """
    if len(displacements.vectors) != 2 or not len(displacements.first_row):
        return -1.0
    mean = 0.5 * (velocity[:, displacements.first_row] + velocity[:, displacements.last_row])
    sizes = np.hypot(*mean) * np.hypot(*displacements.vectors)
    valid = np.isfinite(sizes) & (sizes > 0.0)
    if not valid.any():
        return -1.0
    return float(np.median((mean * displacements.vectors).sum(axis=0)[valid] / sizes[valid]))
