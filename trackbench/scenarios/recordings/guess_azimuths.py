"""Guess of the direction from which measured azimuths count, and the question if it is open."""

from typing import Literal, NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.scenarios.recordings.column_names import words_of

Convention = Literal["named", "compass", "polar", "open"]
"""Azimuths count clockwise from north as the column's name says (named) or as numbers beyond 180 deg do
(compass), from x to y as polar coordinates do, or either way (open)."""

_NORTH = frozenset(("north", "true", "compass", "magnetic", "mag", "clockwise", "cw"))
_POLAR = frozenset(("theta", "phi", "angle"))
_FEWEST = 5
"""rows of a radar that are compared with other positions"""
_NEARER = 0.3
"""ratio of the distances from other positions of the right convention and of the wrong one"""


class Track(NamedTuple):
    """Measured rows of one sensor in the longest run."""

    time: Array
    """times (R,), s; those of dates and of UNIX times count from 1970"""
    values: Array
    """x and y, m, or range, m, and azimuth, rad (2, R)"""
    is_dated: bool


def convention_of(column: str, unit: str, angles: list[Array]) -> Convention:
    """Return from where the azimuths of a column count, by its name, its unit and its numbers.

    ``angles`` are those of each sensor, in rad.
    """
    words = {*words_of(column)}
    if words & _NORTH:
        return "named"
    finite = np.concatenate([a[np.isfinite(a)] for a in angles])
    is_compass = len(finite) > 0 and (finite >= 0.0).all() and finite.max() > np.pi
    if unit.startswith("deg") and is_compass:
        return "compass"
    if not unit.startswith("deg") and words & _POLAR:
        return "polar"
    return "open"


def is_clockwise_by_places(radar: Track, places: Track) -> bool | None:
    """Return whether a radar's azimuths count clockwise from north, as other positions show.

    The ``places`` have x to the east and y to the north. They may count from another point than the
    radar, so that only the shapes of both paths are compared. None if these do not decide.
    """
    if radar.is_dated != places.is_dated:
        return None
    order = np.argsort(places.time, kind="stable")
    time = places.time[order]
    known = (radar.time >= time[0]) & (radar.time <= time[-1])
    if known.sum() < _FEWEST:
        return None
    path = np.stack([np.interp(radar.time[known], time, axis[order]) for axis in places.values])
    ranges, azimuths = radar.values[:, known]
    anticlockwise = ranges * np.stack([np.cos(azimuths), np.sin(azimuths)])
    distance, mirrored_distance = (
        _distance_of_shapes(place, path) for place in (anticlockwise, anticlockwise[::-1])
    )
    if distance < _NEARER * mirrored_distance:
        return False
    if mirrored_distance < _NEARER * distance:
        return True
    return None


def _distance_of_shapes(place: Array, path: Array) -> float:
    """Return the median distance of positions (2, R) from a path (2, R) of another origin."""
    away = place - path
    away = away - np.median(away, axis=1, keepdims=True)
    return float(np.median(np.hypot(*away)))


def question_on_azimuths(column: str) -> list[str]:
    """Return the question from where azimuths count, and its answers."""
    return [
        f"{column}: do these angles count clockwise from north, as those of radars and compasses? "
        "Say --set 'clockwise=[azimuth]'",
        "or do they count from x to y, anticlockwise from east? Say --set 'clockwise=[]'",
    ]
