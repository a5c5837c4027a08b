"""Origins from which positions count: one of all runs, or one of each run that begins far away."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array, Index
from trackbench.core.elementary import cos_sin
from trackbench.core.latitude_longitude import SEMI_MAJOR_AXIS, Geodetic, east_north_up
from trackbench.errors import and_others, counted, first_names, form_for
from trackbench.field_types import DataError, InvalidKeyError, Place
from trackbench.scenarios.recordings.east_north_up_axes import Frame
from trackbench.scenarios.recordings.parse_tables import Table, WholeNumbers
from trackbench.scenarios.recordings.quantities_from_columns import Columns
from trackbench.scenarios.recordings.rows_and_reading_context import ReadingContext, in_kilometers

_FEW_FAR = 0.1
"""largest share of the rows that are taken for mistaken ones if they are far from most others"""
_NEAR_ORIGIN = 5e4
"""m: an origin within is not asked whether its numbers are exchanged, nor whether north differs"""
_FAR = 3e5
"""m from the origin, beyond which a note says by how much the plane shortens distances; 0.1 %"""
_MOST_RUNS_SHOWN = 8

MOST_DISTANCE = 2e6
"""m from the origin; a plane there shortens distances along the way by 5 %"""


def check_origin(context: ReadingContext, origin: tuple[float, ...], *path: str) -> None:
    """Raise InvalidKeyError if an origin is needed and not given, or given and not needed.

    ``path`` is the path of its key in the config.
    """
    if origin and not context.geodetic_file:
        message = (
            "no file has latitude and longitude, which alone count from an origin; leave it out"
        )
        raise InvalidKeyError(message, *path)
    if context.geodetic_file and context.planar_file and not origin:
        message = (
            f"{context.geodetic_file} has latitude and longitude, and {context.planar_file}, which"
        )
        remedy = "counts from x = y = 0: say where that is, `origin: [latitude, longitude]`"
        raise InvalidKeyError(f"{message} {remedy}", *path)


def frames_of_runs(
    context: ReadingContext, columns: Columns, table: Table, runs: WholeNumbers
) -> tuple[Geodetic, list[Frame]]:
    """Return the positions of a table's rows, and frames: origins with the rows that count from them.

    Runs share one origin, that of the config or the first position that is read. If the config has none,
    a run that begins far from the first position gets an origin of its own. Origins and notices are
    added to ``context``. ``runs`` (R,) are the numbers of the rows' runs. Raises an error for rows too
    far from their origin.
    """
    height = 0.0
    if context.origin is not None and len(context.origin) > 2:
        height = context.origin[2]
    positions = columns.geodetic_positions(table, height)
    known = np.flatnonzero(np.isfinite(positions.latitude))
    missing = columns.rows_without_height(table)
    if missing:
        verb = form_for(missing, "has", "have")
        message = (
            f"{counted(missing, 'row')} of {columns.path} {verb} no altitude, and so no position"
        )
        message += " in space"
        context.notices.append(f"{message}: `axes: 2` takes their latitude and longitude alone")
    if not len(known):
        return positions, []
    # Step 1: the common origin.
    if context.origin is None:
        context.origin = _coordinates_of_row(positions, int(known[0]))
        context.first_position = f"{Path(columns.path).name}:{table.lines[known[0]]}"
    # The first position is recorded only if it serves as the origin.
    is_given = not context.first_position
    # Step 2: runs that begin far from it get an origin of their own, unless the config has one. A run
    # whose rows are in several files gets its origin by the first file.
    numbers, first = np.unique(runs[known], return_index=True)
    names = [context.runs[number] for number in numbers]
    if not is_given:
        begins = known[first]
        distances = _distances_from_origin(positions, begins, context.origin)
        for name, row, distance in zip(names, begins.tolist(), distances.tolist(), strict=True):
            if name not in context.located_runs and distance > _FAR:
                context.own_origins[name] = _coordinates_of_row(positions, row)
                context.far_runs.append(f"{name} by {in_kilometers(distance)}")
            context.located_runs.add(name)
    # Step 3: the rows of each origin, and how far from it they lie.
    far_runs = [
        number for number, name in zip(numbers, names, strict=True) if name in context.own_origins
    ]
    shared = np.flatnonzero(~np.isin(runs, far_runs))
    frames = []
    if len(shared):
        frames.append(Frame(context.origin, shared))
    for number in far_runs:
        origin = context.own_origins[context.runs[number]]
        frames.append(Frame(origin, np.flatnonzero(runs == number)))
    for frame in frames:
        _check_distances(context, columns, table, positions, frame)
    return positions, frames


def _coordinates_of_row(positions: Geodetic, row: int) -> tuple[float, ...]:
    """Return latitude and longitude, deg, and height, m, of one row."""
    latitude = float(positions.latitude[row]) * 180.0 / np.pi
    longitude = float(positions.longitude[row]) * 180.0 / np.pi
    return latitude, longitude, float(positions.height[row])


def _distance_of_places(place: tuple[float, ...], other: tuple[float, ...]) -> float:
    """Return the distance, m along the Earth, of two places, each with latitude and longitude, deg."""
    latitude, longitude = np.radians(place[:2])
    position = Geodetic(np.array([latitude]), np.array([longitude]), np.zeros(1))
    return float(_distances_from_origin(position, np.array([0]), other)[0])


def _distances_from_origin(
    positions: Geodetic, rows: WholeNumbers, origin: tuple[float, ...]
) -> Array:
    """Return the distances (R,), m along the Earth, of the rows with these R indices from an origin.

    ``origin`` has latitude and longitude, deg; heights do not count.
    """
    # Positions and the origin at the height 0. The frame only converts the origin to radians, for which
    # it needs no rows.
    on_ground = Geodetic(positions.latitude[rows], positions.longitude[rows], np.zeros(len(rows)))
    origin_on_ground = Frame((*origin[:2], 0.0), rows=np.asarray(rows, dtype=np.intp)).position
    chord = np.sqrt(np.square(east_north_up(on_ground, origin_on_ground)).sum(axis=0))
    # d = 2 R asin(c / 2 R) of a chord c
    radius = SEMI_MAJOR_AXIS
    return 2.0 * radius * np.arcsin(np.minimum(chord / (2.0 * radius), 1.0))


def _check_distances(
    context: ReadingContext, columns: Columns, table: Table, positions: Geodetic, frame: Frame
) -> None:
    """Raise an error for a mistaken origin or rows too far from it; record the largest distance.

    The distance is recorded in ``context``. If this has ``refuses_far_rows`` unset, as while a table is
    guessed at, rows that are too far away are no error; that is raised when the config reads them.
    ``frame`` has the origin and its rows of the ``table``, whose ``positions`` are those of all rows.
    """
    known = frame.rows[np.isfinite(positions.latitude[frame.rows])]
    if not len(known):
        return
    distances = _distances_from_origin(positions, known, frame.origin)
    # The first position is recorded only if it serves as the origin.
    is_given = not context.first_position
    # Case 1: the origin in the config is far from the first position, perhaps by a mistake in its
    # numbers.
    limit = f"a plane serves for {MOST_DISTANCE / 1e3:.0f} km"
    if is_given and distances[0] > _NEAR_ORIGIN:
        change = _likely_change(frame.origin, _coordinates_of_row(positions, int(known[0])))
        hint = f"{change}: correct it" if change else ""
        where = f"{Path(columns.path).name}:{table.lines[known[0]]}"
        message = f"lies {in_kilometers(distances[0])} from the first position ({where})"
        if hint or distances[0] > MOST_DISTANCE:
            remedy = hint or f"{limit}: write latitude and longitude of a point near the positions"
            raise InvalidKeyError(f"{message}; {remedy}", *context.origin_key)
    # Case 2: single positions are far from the origin.
    too_far = np.flatnonzero(distances > MOST_DISTANCE)
    if len(too_far) and context.refuses_far_rows:
        origin = "the first position of its run, the origin"
        if is_given:
            origin = "`origin`"
        elif frame.origin == context.origin:
            origin = f"the first position ({context.first_position}), the origin"
        fault = _explain_far_rows(
            positions, known, distances, origin, has_one_origin=not context.own_origins
        )
        message = f"latitude and longitude: {fault.message}; {limit}: {fault.remedy}"
        is_of_first_file = context.first_position.startswith(f"{Path(columns.path).name}:")
        change = _likely_change(_coordinates_of_row(positions, fault.row), frame.origin)
        if change and not is_given and not is_of_first_file:
            message = (
                f"latitude and longitude: {fault.message}; {change}: correct the columns or the"
                " signs of one of the two files"
            )
        raise DataError(Place(columns.path, int(table.lines[fault.row]), 1, message))
    context.largest_distance = max(context.largest_distance, float(distances.max()))


def note_distances(context: ReadingContext) -> None:
    """Add notes on runs with an origin of their own, and on positions far from their origin."""
    if context.far_runs:
        shown = first_names(context.far_runs, _MOST_RUNS_SHOWN)
        message = f"runs that begin far from the first position that is read: {shown}"
        context.notices.append(f"{message}; x and y of each count from its own first position")
    distance = context.largest_distance
    if distance > _FAR:
        # The tangent plane shortens a way away from the origin by the share 1 - cos(d / R).
        share = 1.0 - np.cos(distance / SEMI_MAJOR_AXIS)
        message = f"positions lie up to {in_kilometers(distance)} from the origin"
        reason = f"where the tangent plane shortens distances by {100.0 * share:.2g} %"
        context.notices.append(
            f"{message}, {reason}: an `origin` in their middle halves the distance"
        )
    if context.unrotated_velocity_file and context.origin is not None and distance > _NEAR_ORIGIN:
        # Meridians converge by (d / R) tan(phi) on a way to the east.
        slope = np.tan(np.deg2rad(min(abs(context.origin[0]), 89.0)))
        turn = np.rad2deg(distance / SEMI_MAJOR_AXIS * slope)
        message = f"{context.unrotated_velocity_file} has velocities without latitude and longitude"
        reason = f"north at the target differs from that of the origin by up to {turn:.2g} deg"
        context.notices.append(f"{message}, which are not rotated: {reason}")


class _FarRows(NamedTuple):
    """Row that lies too far away for a plane, with the message on it."""

    row: int
    message: str
    remedy: str


def _explain_far_rows(
    positions: Geodetic, known: Index, distances: Array, origin: str, has_one_origin: bool
) -> _FarRows:
    """Return the row to be blamed if some of the rows ``known`` (R,) are too far from their origin.

    ``distances`` (R,), m, are those from the origin, whose name for a message is ``origin``. With
    ``has_one_origin`` all runs have this origin, so that another one may be advised.
    """
    # Step 1: the middle of most rows shows whether few rows are far from all others.
    median = _middle(positions, known, np.arange(len(known)))
    from_median = _distances_from_origin(positions, known, median)
    far_from_median = np.flatnonzero(from_median > MOST_DISTANCE)
    # Step 2: an origin that serves for all rows: the middle of most, or that of the two ends.
    start = int(distances.argmax())
    start_position = _coordinates_of_row(positions, int(known[start]))
    end = int(_distances_from_origin(positions, known, start_position).argmax())
    serving = ""
    for middle in (median, _middle(positions, known, np.array([start, end]))):
        rounded = (round(middle[0], 1), round(middle[1], 1))
        largest = float(_distances_from_origin(positions, known, rounded).max())
        if largest <= MOST_DISTANCE and has_one_origin:
            serving = f", or say `origin: [{rounded[0]:g}, {rounded[1]:g}]`, in the middle"
            break
    # Step 3: blame the few rows that are far from the others, else the first one far from the origin.
    if 0 < len(far_from_median) <= _FEW_FAR * len(known):
        row = int(far_from_median[0])
        away = in_kilometers(from_median[row])
        message = f"{away} from most positions{and_others(len(far_from_median))}"
        return _FarRows(int(known[row]), message, f"correct or empty the cells{serving}")
    too_far = np.flatnonzero(distances > MOST_DISTANCE)
    row = int(too_far[0])
    message = f"{in_kilometers(distances[row])} from {origin}{and_others(len(too_far))}"
    remedy = f"correct or empty the cells{serving}"
    if not serving:
        remedy = "no one origin serves for all: take a part of the recording, or name its runs"
    return _FarRows(int(known[row]), message, remedy)


def _middle(positions: Geodetic, known: Index, rows: Index) -> tuple[float, float]:
    """Return latitude and longitude, deg, of the median of some of the rows ``known``.

    It is the median of their directions from the center of the Earth, which has no cut at 180 deg.
    """
    c, s = cos_sin(positions.latitude[known[rows]])
    cos_lon, sin_lon = cos_sin(positions.longitude[known[rows]])
    x, y, z = np.median([c * cos_lon, c * sin_lon, s], axis=1)
    return float(np.degrees(np.arctan2(z, np.hypot(x, y)))), float(np.degrees(np.arctan2(y, x)))


def _likely_change(place: tuple[float, ...], other: tuple[float, ...]) -> str:
    """Return the exchange or sign of a place's numbers that would bring it near another; empty if none.

    It is a text for a message. Both have latitude and longitude, deg.
    """
    latitude, longitude = place[:2]
    changes = {
        "latitude and longitude exchanged": (longitude, latitude),
        "the other sign of the longitude": (latitude, -longitude),
        "the other sign of the latitude": (-latitude, longitude),
    }
    distance = _distance_of_places(place, other)
    for message, (new_latitude, new_longitude) in changes.items():
        if abs(new_latitude) > 90.0:
            continue
        new_distance = _distance_of_places((new_latitude, new_longitude), other)
        if new_distance < 0.1 * distance:
            changed = f"[{new_latitude:g}, {new_longitude:g}]"
            return f"with {message}, {changed}, it would be {in_kilometers(new_distance)} away"
    return ""


def explain_far_truth(context: ReadingContext, place: tuple[float, ...]) -> str:
    """Explain that a truth begins at a ``place`` far from the origin, the measurements' first position.

    The place has latitude and longitude, deg, and ``context`` is that of the measurements.
    """
    assert context.origin is not None
    away = in_kilometers(_distance_of_places(place, context.origin))
    message = f"begins {away} from the first position ({context.first_position})"
    change = _likely_change(place, context.origin)
    if change:
        return f"{message}; {change}: correct the columns or the signs of one of the two files"
    return f"{message}: is it the truth of these measurements, and are its units right?"
