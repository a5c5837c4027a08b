"""Candidates of the units of times, positions and speeds, the best first, by which of them agree."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array, Index
from trackbench.core.conversions import SEMI_MAJOR_AXIS
from trackbench.scenarios.recordings.row_noise import error_of_line
from trackbench.scenarios.recordings.rows import usual_interval
from trackbench.scenarios.recordings.units import UNITS

NEAR = 0.07
"""Largest relative difference between a measured speed and that of the positions which agrees."""
_MARGIN = 0.6  # points between candidates of which one is sure
_DISAGREES = 2.0  # points for speeds that do not agree, and in another unit do
_MANY = 20.0  # sigmas of an error, from which on a way between two rows is sure
_FEW = 0.3  # points for what is rarer and fits exactly
SAME_WAY = 0.8  # cosine between directions that agree
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
"""Points against a unit. Lengths that are not m count only beside a speed that agrees."""
_USUAL_SPEEDS = ((0.05, 400.0, 0.0), (0.01, 3000.0, 1.0), (1e-3, 11200.0, 2.0))
"""Least and largest speed, m/s, and the points within; 4 beyond. 11.2 km/s leaves the Earth."""
_STANDSTILL = 0.5
"""m/s that something may seem to have whose measured speed is 0"""
_TODAY = (1.0e9, 2.1e9)
"""seconds since 1970 of the years 2001 to 2036"""
_OTHER_EPOCHS = (6e7, 6.5e8)
"""seconds that may be those since 2000, 2006 (BeiDou), 2010 and the like, or the ms of hours and days"""


class TimeUnit(NamedTuple):
    """Numbers that times in a unit have.

    ``largest`` is that of a clock that began at zero; ``dates`` are numbers that count from a date.
    """

    unit: str
    points: float
    largest: float
    dates: tuple[tuple[float, float], ...] = ()
    is_whole: bool = False


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


class AngleUnit(NamedTuple):
    """Unit of latitude and longitude; names of columns that stand beside it are its ``words``."""

    unit: str
    points: float
    is_whole: bool
    words: tuple[str, ...] = ()


PLACE_UNITS = (
    AngleUnit("deg", 0.0, False),
    AngleUnit("rad", 0.0, False),
    AngleUnit("degE7", 0.0, True, _RECEIVERS),
    AngleUnit("degE6", 0.1, True),
    AngleUnit("semicircle", 0.2, True, ("positionlat", "positionlong")),
    AngleUnit("mas", 0.3, True),
    AngleUnit("deg/600000", 0.4, True, _AIS),
    AngleUnit("degE5", 0.5, True),
)
"""Units of which none is sure without a word or a speed: their points differ by less than `_MARGIN`."""


@dataclass(frozen=True, kw_only=True)
class Numbers:
    """Numbers (R,) of one target's rows as they are written, in order of the table.

    ``time`` is in seconds if it is ``dated``. ``place`` (2, R) is longitude and latitude or x and y,
    (1, R) a range; empty if there is no position. A velocity (2, R) is measured, or a ``speed``,
    perhaps with a ``course``.
    """

    time: Array
    dated: bool
    place: Array
    is_angle: bool
    speed: Array | None = None
    course: Array | None = None
    velocity: Array | None = None
    words: frozenset[str] = frozenset()
    """names of all columns, in small letters without marks"""
    least_digits: int = 0
    """digits behind the point that cells of positions have"""


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """One choice of units for a table, the points against it, and the speed that it gives, m/s."""

    time: str
    place: str
    as_angle: bool
    speed: str
    course: str
    points: float
    usual_speed: float
    agrees: bool
    """True if a measured speed is that of the positions"""
    same_way: bool
    """True if a measured course is their direction"""

    @property
    def key(self) -> tuple[str, str]:
        """Units of which no two candidates may remain."""
        return self.time, self.place


def likely_units(
    numbers: Numbers, known_units: Mapping[str, str], clocks: Mapping[str, tuple[float, float]] = {}
) -> list[Candidate]:
    """Return the likeliest choices of units, the best first.

    ``known_units`` are units by quantity that need no guess. ``clocks`` are other possible forms of
    dates, each with its factor on the times and the points against it.
    """
    candidates: list[Candidate] = []
    times = list(_times(numbers, known_units, clocks))
    for (place, as_angle, place_points), (time, seconds, time_points) in product(
        _places(numbers, known_units), times
    ):
        meters = in_meters(numbers.place, place, as_angle)
        moves = Moves.of_rows(numbers.time * seconds, meters)
        points = place_points + time_points
        # What stands still by its measured speed only seems to move, by its errors.
        stands_still = numbers.speed is not None and not np.nan_to_num(numbers.speed).any()
        if not (stands_still and moves.usual_speed < _STANDSTILL):
            points += _points_of_speed(moves.usual_speed, as_angle)
        if stands_still and moves.usual_speed >= _STANDSTILL:
            points += 1.0
        points += _points_of_interval(numbers.time * seconds, as_angle)
        for speed, speed_points, agrees in _speeds(numbers, known_units, moves, as_angle):
            course, same_way = _course(numbers, known_units, moves, agrees)
            candidates.append(
                Candidate(
                    time=time,
                    place=place,
                    as_angle=as_angle,
                    speed=speed,
                    course=course,
                    points=points + speed_points,
                    usual_speed=moves.usual_speed,
                    agrees=agrees,
                    same_way=same_way,
                )
            )
    candidates.sort(key=lambda candidate: candidate.points)
    # Other lengths are likely only if a speed agrees.
    best: dict[tuple[str, str], Candidate] = {}
    for candidate in candidates:
        is_length = not candidate.as_angle and candidate.place not in ("m", *known_units.values())
        if candidate.agrees or not is_length:
            best.setdefault(candidate.key, candidate)
    ranked = list(best.values())
    limit = ranked[0].points + _MARGIN
    return [candidate for candidate in ranked if candidate.points < limit]


def usual_acceleration(numbers: Numbers, chosen: Candidate) -> float:
    """Return an acceleration, m/s^2, that one of four ways exceeds; 0 if none is sure.

    The positions are those of the ``numbers`` in the ``chosen`` units. Ways of several lengths are
    compared, as errors of positions hide the acceleration of short ones, and long ones are bent.
    """
    seconds = UNITS.get(chosen.time, 1.0)
    meters = in_meters(numbers.place, chosen.place, chosen.as_angle)
    largest = 0.0
    for times_as_long in (5.0, 20.0, 80.0):
        moves = Moves.of_rows(numbers.time * seconds, meters, times_as_long * _MANY)
        if np.isfinite(moves.usual_speed):
            largest = max(largest, _sure_acceleration(moves, len(numbers.time)))
    return largest


def _sure_acceleration(moves: "Moves", rows: int) -> float:
    """Return the acceleration that one of four ways exceeds, less two standard deviations of its error.

    ``rows`` is the number of rows of the table.
    """
    velocities = moves.ways / moves.time
    # Ways that follow each other: each begins in the row in which the one before ends.
    way_from_row = np.full(rows, -1)
    way_from_row[moves.first] = np.arange(len(moves.first))
    following = way_from_row[moves.last]
    inside = np.flatnonzero(following >= 0)
    following = following[inside]
    if not len(following):
        return 0.0
    changes = np.hypot.reduce(velocities[:, following] - velocities[:, inside])
    lasting = 0.5 * (moves.time[following] + moves.time[inside])
    # (z_2 - 2 z_1 + z_0) / t^2 has the standard deviation sqrt(6) sigma / t^2.
    error = np.sqrt(6.0) * moves.sigma / float(np.median(lasting)) ** 2
    return max(float(np.quantile(changes / lasting, 0.75)) - 2.0 * error, 0.0)


def is_usual_speed(speed: float) -> bool:
    """Test whether most things that are tracked may have this usual speed, m/s."""
    least, largest, _ = _USUAL_SPEEDS[0]
    return least <= speed <= largest


def _times(
    numbers: Numbers, known_units: Mapping[str, str], clocks: Mapping[str, tuple[float, float]]
) -> Iterator[tuple[str, float, float]]:
    """Yield units of the time, their factor to seconds, and points against them.

    Dates have no unit: in its place stands the form of the dates, empty for the usual one. The
    arguments are those of `likely_units`.
    """
    if numbers.dated:
        _, points_of_usual_form = clocks.get("", (1.0, 0.0))
        yield "", 1.0, points_of_usual_form
        for form, (factor, points) in clocks.items():
            if form:
                yield form, factor, points
        return
    if "time" in known_units:
        yield known_units["time"], UNITS[known_units["time"]], 0.0
        return
    finite = numbers.time[np.isfinite(numbers.time)]
    largest = float(np.abs(finite).max(initial=0.0))
    is_whole = not (finite % 1.0).any()
    whole_seconds = _whole_seconds_of_days(finite)
    is_today = any(
        _TODAY[0] <= largest * UNITS[unit] <= _TODAY[1] for unit in ("s", "ms", "us", "ns")
    )
    intervals = np.diff(np.unique(finite))
    in_minutes = bool(len(intervals)) and not (intervals % 60.0).any()
    has_degrees = numbers.is_angle and _largest_sizes(numbers.place)[1] <= 90.0
    points_by_unit: dict[str, float] = {}
    for row in TIME_UNITS:
        points = row.points
        is_date = any(least <= largest <= most for least, most in row.dates)
        if not is_date and largest > row.largest:
            since_other_epoch = row.unit == "s" and largest >= _OTHER_EPOCHS[0]
            points += 0.5 if since_other_epoch and largest <= _OTHER_EPOCHS[1] else 3.0
        if row.is_whole and not is_whole:
            points += 1.0
        # Times since 1970 are likelier than a clock that has run so long in another unit.
        if not is_date and is_today:
            points += 1.5
        # Whole minutes, such as 0, 60 and 120, are rather those of seconds.
        if row.unit == "ms" and is_whole and in_minutes:
            points += 0.5
        # Dates in days have fractions of days that are whole seconds; whole days are rare.
        if row.unit == "d" and is_date:
            if whole_seconds:
                points -= 1.0
            elif is_whole:
                points += 1.0
        # 0.01667 and 0.03333 are whole seconds in min; in s they may be those of 60 pictures a second.
        # Half seconds in min are 30 s in h.
        if row.unit in ("min", "h") and _are_rounded_seconds(finite * UNITS[row.unit], finite):
            points = _FEW
        elif row.unit == "min" and _are_rounded_seconds(finite * UNITS["h"], finite):
            points = 2.0 * _FEW
        # 0.041667 h is 150 s, and in d it is an hour.
        elif row.unit == "d" and not is_date and _may_be_days(finite):
            points = _FEW
        # 0, 1 and 2 may count minutes, hours or days if in s the speed is that of a rocket.
        elif row.points and not is_date and is_whole and has_degrees:
            points -= 0.5
        points_by_unit[row.unit] = min(points, points_by_unit.get(row.unit, np.inf))
    for unit, points in points_by_unit.items():
        yield unit, UNITS[unit], points


def _whole_seconds_of_days(times: Array) -> bool:
    """Test whether times as days are whole seconds with fractions of days.

    Times in seconds with so many digits behind the point would not be whole seconds as days.
    """
    # Without a fourth digit behind the point the days are no whole seconds.
    if not len(times) or not (np.abs(times * 1e3 % 1.0 - 0.5) < 0.49).any():
        return False
    seconds = times * 86400.0
    # Nine digits behind the point are 1e-4 s, six are 0.09 s.
    return bool((np.abs(seconds - np.rint(seconds)) < 0.09).mean() > 0.95)


def _are_rounded_seconds(seconds: Array, written: Array) -> bool:
    """Test whether times (R,) are whole seconds but for the rounding of the numbers that were written.

    These must have three digits or more behind the point, and the rounding must be small.
    """
    digits = next(
        (d for d in range(10) if not (np.abs(_off_whole(written * 10.0**d)) > 1e-3).any()), 9
    )
    if digits < 3 or not len(written):
        return False
    largest = np.abs(written).max()
    rounding = 0.55 * 10.0**-digits * float(seconds.max() / largest) if largest > 0.0 else 0.0
    return bool(0.0 < rounding < 0.05 and (np.abs(_off_whole(seconds)) <= rounding).all())


def _may_be_days(times: Array) -> bool:
    """Test whether times that are whole seconds in hours are multiples of ten minutes in days."""
    if not _are_rounded_seconds(times * UNITS["h"], times):
        return False
    off_whole = 600.0 * _off_whole(times * UNITS["d"] / 600.0)
    return bool((np.abs(off_whole) < 0.6).all())


def _off_whole(values: Array) -> Array:
    """Return the differences of values from the nearest whole numbers."""
    return values - np.rint(values)


def _places(numbers: Numbers, known_units: Mapping[str, str]) -> Iterator[tuple[str, bool, float]]:
    """Yield possible units of the position, whether each is of angles, and the points against it.

    ``known_units`` are units by quantity that need no guess.
    """
    if not numbers.is_angle:
        is_ais = bool(numbers.words.intersection(_AIS))
        known = known_units.get("x", known_units.get("range"))
        if known:
            yield known, False, 0.0
        else:
            yield from _lengths(numbers, is_ais)
        if known is None and _may_be_degrees(numbers):
            yield "deg", True, 0.0 if is_ais else 1.0
        return
    if "latitude" in known_units or "longitude" in known_units:
        yield known_units.get("latitude", known_units.get("longitude", "deg")), True, 0.0
        return
    longitude, latitude = _largest_sizes(numbers.place)
    is_whole = not (numbers.place[np.isfinite(numbers.place)] % 1.0).any()
    is_large = max(longitude, latitude) >= _SMALLEST_WHOLE
    has_words = {row.unit: bool(numbers.words.intersection(row.words)) for row in PLACE_UNITS}
    any_words = any(has_words.values())
    fitting = []
    for row in PLACE_UNITS:
        in_degrees = UNITS[row.unit] / UNITS["deg"]
        # 91 and 181 deg are codes of AIS.
        if latitude * in_degrees > 91.001 or longitude * in_degrees > 360.001:
            continue
        # Large whole numbers are in a unit for whole numbers, all others are not.
        if row.is_whole != (is_whole and is_large):
            continue
        points = 0.0
        if not has_words[row.unit]:
            points = row.points
            if row.is_whole and any_words:
                points += 1.0
        # Six digits of a radian are 6 m; five are 64 m.
        if row.unit == "rad" and numbers.least_digits <= 6:
            points += 0.5 if numbers.least_digits == 6 else 1.0
        fitting.append((row.unit, True, points))
    yield from fitting or [("deg", True, 0.0)]


def _lengths(numbers: Numbers, is_ais: bool) -> Iterator[tuple[str, bool, float]]:
    """Yield units of lengths, as `_places` does: each with False, and the points against it.

    ``is_ais`` if the names of the columns are those of AIS messages.
    """
    # Without a measured speed nothing shows that lengths are not in m.
    is_alone = numbers.speed is None and numbers.velocity is None
    for unit, unit_points in LENGTH_UNITS.items():
        if unit != "m" and is_alone:
            continue
        points = unit_points
        if is_ais and _may_be_degrees(numbers):
            points += 1.0
        yield unit, False, points


def _largest_sizes(place: Array) -> tuple[float, float]:
    """Return the largest absolute values of longitude and latitude, the rows of ``place`` (2, R)."""
    longitude, latitude = place
    largest_longitude = float(np.nanmax(np.abs(longitude), initial=0.0))
    largest_latitude = float(np.nanmax(np.abs(latitude), initial=0.0))
    return largest_longitude, largest_latitude


def _may_be_degrees(numbers: Numbers) -> bool:
    """Test whether x and y, the place in the ``numbers``, may be a longitude and a latitude."""
    has_speed = numbers.speed is not None or numbers.velocity is not None
    is_ais = bool(numbers.words.intersection(_AIS))
    return (has_speed or is_ais) and look_like_degrees(numbers)


def look_like_degrees(numbers: Numbers) -> bool:
    """Test whether the place in the ``numbers`` has the size and the digits of degrees."""
    # Degrees with less than four digits behind the point would be too coarse, beyond 10 m.
    if len(numbers.place) != 2 or numbers.least_digits < 4:
        return False
    longitude, latitude = _largest_sizes(numbers.place)
    # 181 and 91 deg are codes of AIS for a missing position.
    return longitude <= 181.0 and latitude <= 91.0


def in_meters(place: Array, unit: str, as_angle: bool) -> Array:
    """Return positions ``place`` (n, R), in ``unit``, in meters.

    If they are longitude and latitude (``as_angle``), they are converted near their middle latitude.
    """
    if not as_angle:
        return place * UNITS[unit]
    longitude, latitude = place * UNITS[unit]
    middle = 0.0
    if np.isfinite(latitude).any():
        middle = float(np.nanmedian(latitude))
    # Differences of longitudes are those of angles.
    first = 0.0
    known = longitude[np.isfinite(longitude)]
    if len(known):
        first = float(known[0])
    east = np.remainder(longitude - first + np.pi, 2.0 * np.pi) - np.pi
    return SEMI_MAJOR_AXIS * np.stack([east * np.cos(middle), latitude])


@dataclass(frozen=True)
class Moves:
    """Ways (n, L) between rows that lie far enough apart to be sure, and the time that they took, s."""

    first: Index
    last: Index
    time: Array
    ways: Array
    usual_speed: float
    """median speed, m/s; NaN if nothing moved for sure"""
    sigma: float = 0.0
    """standard deviation of a position's error, m"""

    @classmethod
    def of_rows(cls, time: Array, meters: Array, many: float = _MANY) -> "Moves":
        """Return the ways over the smallest number of rows at which errors of the positions are small.

        ``meters`` (n, R) are the positions. The number of rows is doubled until the median way is
        ``many`` standard deviations of a position, or too few ways are left.
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
            ways = meters[:, lag:] - meters[:, :-lag]
            sizes = np.sqrt(np.square(ways).sum(axis=0))
            if 2 * lag > max(1, len(rows) // 4) or np.median(sizes) > many * sigma:
                break
            lag *= 2
        duration = time[lag:] - time[:-lag]
        later = duration > 0.0
        speeds = sizes[later] / duration[later]
        # The longest ways must be more than errors of position.
        is_sure = later.any() and float(np.quantile(sizes, 0.9)) > 3.0 * sigma
        usual = float(np.median(speeds)) if is_sure else np.nan
        return cls(
            rows[:-lag][later], rows[lag:][later], duration[later], ways[:, later], usual, sigma
        )


def _points_of_speed(speed: float, on_earth: bool) -> float:
    """Return the points against a usual speed, m/s, that few things have.

    Slow things that are not ``on_earth``, such as cells, robots and pixels, get few points.
    """
    if not np.isfinite(speed) or speed == 0.0:
        return 0.0
    points = 4.0  # of a speed beyond all usual ones
    for least, largest, points_within in _USUAL_SPEEDS:
        if least <= speed <= largest:
            points = points_within
            break
    if on_earth or speed > 1.0:
        return points
    return min(points, 1.0)


def _points_of_interval(times: Array, is_gps: bool) -> float:
    """Return the points against the usual interval of times, s: whole seconds or a whole rate have none.

    A receiver of GPS has fewer rows a second than other sensors (``is_gps``).
    """
    finite = np.sort(times[np.isfinite(times)])
    apart = np.diff(finite)
    apart = apart[apart > 0.0]
    if not len(apart):
        return 0.0
    usual = usual_interval(finite)
    points = 0.0
    # More than 500 rows a second are rare; so are more than 67, or of GPS more than 25.
    if usual < 0.002:
        points += 3.0 if is_gps else 2.0
    elif usual < (0.039 if is_gps else 0.015):
        points += 1.0
    # Intervals that differ say nothing more.
    if (np.abs(apart - usual) > 0.02 * usual).mean() > 1.0 - _REGULAR:
        return points
    if usual >= 20.0:
        # Multiples of 30 s, and 20 s, are usual; 1000 s are not, and may be 1000 ms.
        if min(usual % 30.0, -usual % 30.0) <= 0.5 or abs(usual - 20.0) < 0.5:
            return points
        return points + (1.0 if usual > 60.0 else 0.5)
    if usual >= 1.0:
        return points + 0.5 * (min(usual % 0.5, -usual % 0.5) > 0.02 * usual)
    rate = 1.0 / usual
    return points + (abs(rate - np.rint(rate)) > 0.03 * rate)


def _speeds(
    numbers: Numbers, known_units: Mapping[str, str], moves: Moves, as_angle: bool
) -> Iterator[tuple[str, float, bool]]:
    """Yield units of the measured speed, with points against each and whether it agrees.

    The first units are those in which the speed agrees with that of the ``moves``. The last one is the
    known unit, or none, with points for a disagreement. ``as_angle`` if positions are angles.
    """
    shown = _shown_speed(numbers)
    if shown is None:
        yield "", 0.0, False
        return
    ratio = _ratio(shown, moves)
    known = known_units.get("speed", known_units.get("vx"))
    agreeing = []
    for unit, points in SPEED_UNITS.items():
        if known is not None and unit != known:
            continue
        away = np.inf
        if np.isfinite(ratio):
            away = abs(ratio * UNITS[unit] - 1.0)
        if away >= NEAR:
            continue
        # A knot is likelier beside latitudes.
        is_ais = not numbers.words.isdisjoint(_AIS)
        is_at_sea = (as_angle and unit == "kn") or (is_ais and unit.startswith("kn"))
        unit_points = 0.0 if is_at_sea or unit == known else points
        agreeing.append((unit, unit_points + 0.5 * away / NEAR, True))
    yield from agreeing
    disagreement = _DISAGREES if np.isfinite(ratio) else 0.0
    yield known or "", disagreement, False


def _shown_speed(numbers: Numbers) -> Array | None:
    """Return the measured speed (R,), in its unit; None if there is none."""
    if numbers.velocity is not None:
        return np.hypot(*numbers.velocity)
    return numbers.speed


def _ratio(shown: Array, moves: Moves) -> float:
    """Return the median ratio of the written speeds ``shown`` (R,) to those of the ``moves``.

    NaN without any.
    """
    if not len(moves.first) or not np.isfinite(moves.usual_speed):
        return np.nan
    speed = np.sqrt(np.square(moves.ways).sum(axis=0)) / moves.time
    # A way is compared with the mean of the speeds at both of its ends, where the target moves.
    mean = 0.5 * (shown[moves.first] + shown[moves.last])
    valid = np.isfinite(mean) & (mean > 0.0) & (speed > 0.0)
    if not valid.any():
        return np.nan
    moving = valid & (speed >= 0.5 * np.median(speed[valid]))
    return float(np.median(mean[moving] / speed[moving]))


def _course(
    numbers: Numbers, known_units: Mapping[str, str], moves: Moves, agrees: bool
) -> tuple[str, bool]:
    """Return the unit in which the course is best the direction of the ways, and whether it agrees.

    The ways are those of ``moves``. Without a speed that agrees with theirs (``agrees``) the course is
    not compared. A measured velocity has no unit of a course, but its direction is compared, too.
    """
    if numbers.velocity is not None:
        # North may stand before east.
        cosine = median_cosine(numbers.velocity, moves)
        exchanged = median_cosine(numbers.velocity[::-1], moves)
        return "", agrees and cosine >= SAME_WAY and not is_nearer(exchanged, cosine)
    if numbers.course is None or numbers.speed is None or not agrees:
        return known_units.get("course", ""), False
    largest = float(np.nanmax(np.abs(numbers.course), initial=0.0))
    units: Sequence[str] = COURSE_UNITS
    if "course" in known_units:
        units = [known_units["course"]]
    elif (numbers.course[np.isfinite(numbers.course)] % 1.0).any():
        units = ("deg", "rad")  # the others are of whole numbers
    best = ""
    cosine = -1.0
    exchanged = -1.0
    for unit in units:
        course = numbers.course * UNITS[unit]
        # 511 deg is a code of AIS.
        if largest * UNITS[unit] > UNITS["deg"] * 511.001:
            continue
        along = numbers.speed * np.stack([np.sin(course), np.cos(course)])
        unit_cosine = median_cosine(along, moves)
        if unit_cosine > cosine + 0.01:
            best = unit
            cosine = unit_cosine
            # A course that counts from x is one from north with both axes exchanged.
            exchanged = median_cosine(along[::-1], moves)
    return best, cosine >= SAME_WAY and not is_nearer(exchanged, cosine)


def is_nearer(cosine: float, other: float) -> bool:
    """Test whether directions with the median ``cosine`` agree clearly better than with the other one.

    Their usual angle is then less than half as large, as 1 - cos(a) is a^2 / 2.
    """
    return 1.0 - other > 4.0 * (1.0 - cosine) + _LEAST_ANGLE**2 / 2.0


def median_cosine(velocity: Array, moves: Moves) -> float:
    """Return the median cosine between velocities (2, R) and the ways; -1 without any."""
    if len(moves.ways) != 2 or not len(moves.first):
        return -1.0
    shown = 0.5 * (velocity[:, moves.first] + velocity[:, moves.last])
    sizes = np.hypot(*shown) * np.hypot(*moves.ways)
    valid = np.isfinite(sizes) & (sizes > 0.0)
    if not valid.any():
        return -1.0
    return float(np.median((shown * moves.ways).sum(axis=0)[valid] / sizes[valid]))
