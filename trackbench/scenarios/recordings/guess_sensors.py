"""Guess of the sensors of a table and of the kind of each."""

import re
from collections.abc import Sequence

import numpy as np

from trackbench.core.arrays import Array, Mask
from trackbench.errors import in_line
from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.column_mapping import Naming
from trackbench.scenarios.recordings.column_names import (
    looks_like,
    odometry_of,
    ranges_of,
    role_of,
    shown_names,
    words_of,
)
from trackbench.scenarios.recordings.guess_columns import measured_columns
from trackbench.scenarios.recordings.guess_record import (
    ColumnByQuantity,
    ReasonByKey,
    SensorGuess,
    UnitByQuantity,
)
from trackbench.scenarios.recordings.quantities import GEODETIC, MEASURED, ODOMETRY, PLACE
from trackbench.scenarios.recordings.rows import Rows
from trackbench.scenarios.recordings.table_sample import TableSample
from trackbench.scenarios.recordings.units import UNITS
from trackbench.scenarios.recordings.yaml_values import in_option

SENSORS = {
    "landmark": ("range", "bearing"),
    "landmark-bearing": ("bearing",),
    "position": ("x", "y"),
    "range-azimuth": ("range", "azimuth"),
    "range": ("range",),
    "bearing": ("azimuth",),
}
"""Types of sensors that a table may hold, the most telling first, and what they measure.

A ``bearing`` counts from the heading of what moves, an ``azimuth`` from the axis x or from north.
"""
ANGLES = ("azimuth", "bearing")
_LATITUDE = re.compile(r"lat(itude)?\d*$")
_LONGITUDE = re.compile(r"(lon|lng|long|longitude)\d*$")
_MOST_CANDIDATES = 4
"""columns that a question offers"""


def guess_sensors(
    sample: TableSample,
    columns: ColumnByQuantity,
    units: UnitByQuantity,
    user_naming: Naming,
    reasons: ReasonByKey,
) -> list[SensorGuess]:
    """Return the guessed sensors of a table, those first whose columns ``user_naming`` has.

    ``columns`` and ``units`` are by quantity. Columns of ranges to several places are added to them in
    place. Raises DataError if a sensor measures no known quantity, unless the user named the column of
    sensors: its rows are then left out, and ``reasons`` has the comment on it.
    """
    # Step 1: the rows in which each quantity is a number. A position is x and y, or longitude and
    # latitude.
    # Of sensors that begin to measure after the first rows there are later ones.
    cells = sample.cells(columns.get("sensor", ""))
    measuring_words: list[str] = []
    samples = [sample]
    if columns.get("sensor"):
        measured = measured_columns(columns)
        measuring_words = sample.measuring_words(columns["sensor"], measured)
        samples.append(sample.further(columns["sensor"], measured))
        cells = cells + samples[1].cells(columns["sensor"])
    is_number = {}
    for name, column in columns.items():
        if name in MEASURED:
            is_number[name] = np.isfinite(np.concatenate([s.numbers(column) for s in samples]))
    if not is_number.keys() >= {*PLACE} and is_number.keys() >= {*GEODETIC[:2]}:
        is_number["x"] = is_number["longitude"]
        is_number["y"] = is_number["latitude"]
    # Step 2: find what each sensor measures. A table without names of sensors has one sensor.
    words = [""]
    if columns.get("sensor"):
        words = [word for word in dict.fromkeys(cells) if word]
        # Sensors that measure in the first rows come first, as these rows show the units.
        words.sort(key=lambda word: word not in measuring_words)
    # Of several types of sensors that fit, the first one of `SENSORS` counts. But a type whose columns
    # the user named comes first.
    answered = {*user_naming.columns}
    if answered & {*GEODETIC[:2]}:
        answered |= {*PLACE}
    kinds = sorted(SENSORS.items(), key=lambda kind: -len(answered.intersection(kind[1])))
    sensors = []
    for word in words:
        rows = np.array([cell == word or not word for cell in cells], dtype=np.bool_)
        if answered.isdisjoint((*PLACE, "range", "azimuth", "bearing")):
            _check_one_kind(sample.path, columns, is_number, rows)
        for kind, quantities in kinds:
            if all(name in is_number and (is_number[name] & rows).any() for name in quantities):
                sensors.append(SensorGuess(name=word, kind=kind, quantities=quantities))
                break
    # Step 3: ranges to several places, one in each column, are a sensor each.
    has_position = {"x", "y"} <= is_number.keys() or {"range", "azimuth"} <= is_number.keys()
    ranges = {}
    if not has_position and "range" not in user_naming.columns:
        ranges = ranges_of(sample.names)
    if ranges and words == [""]:
        columns.pop("range", None)
        units.pop("range", None)
        sensors = []
        for number, (name, named) in enumerate(ranges.items(), 1):
            quantity = f"{number}.range"
            columns[quantity] = named.column
            sensors.append(SensorGuess(name=name.upper(), kind="range", quantities=(quantity,)))
            # The user's unit of the range is that of all of them.
            unit = user_naming.units.get(quantity) or user_naming.units.get("range")
            unit = unit or sample.unit(named.column, "range") or named.unit
            if unit is not None:
                units[quantity] = unit
    # Step 4: report the sensors without a known quantity.
    if len(sensors) < len(words):
        measuring = {sensor.name for sensor in sensors}
        idle = [word for word in words if word not in measuring]
        if columns.keys() >= {"sensor", "bearing", *ODOMETRY} and sensors:
            message = (
                f"{columns['sensor']}: rows of {', '.join(idle)[:80]} have no range and no bearing"
            )
            remedy = "leave this cell of theirs empty, as rows of odometry alone see no landmark"
            raise DataError(Place(sample.path, 1, 1, f"{message}; {remedy}"))
        # If the user named the column of sensors, rows of sensors without a known quantity are left out.
        if not sensors or "sensor" not in user_naming.columns:
            message = _explain_missing_quantities(columns, sample, idle if sensors else [])
            raise DataError(Place(sample.path, 1, 1, message))
        reasons["sensor"] = f"rows of {in_line(shown_names(idle))} have nothing that is measured"
    return sensors


def _check_one_kind(
    path: str, columns: ColumnByQuantity, is_number: dict[str, Mask], rows: Mask
) -> None:
    """Raise DataError if rows have a position as well as a range and an azimuth.

    One of them may be the truth of the other. ``is_number`` has the rows (R,) in which each quantity is
    a number, and the mask ``rows`` (R,) selects those of one sensor.
    """
    radar = ("range", "azimuth")
    for names in (PLACE, radar):
        if not all(name in is_number and (is_number[name] & rows).any() for name in names):
            return
    positions = ("x", "y") if columns.keys() >= {*PLACE} else GEODETIC[:2]
    options_of_kinds = []
    for names in (radar, positions):
        options = (f"--set 'columns.{n}={in_option(columns[n])}'" for n in names)
        options_of_kinds.append(" ".join(options))
    message = f"the rows have {columns['range']} and {columns['azimuth']}, and also"
    message += f" {columns[positions[0]]} and {columns[positions[1]]}: which ones were measured?"
    raise DataError(
        Place(path, 1, 1, f"{message} Say {options_of_kinds[0]}"),
        Place(
            path,
            1,
            1,
            f"or say {options_of_kinds[1]}; the others may be a truth in a file of their own",
        ),
    )


def _explain_missing_quantities(
    columns: ColumnByQuantity, sample: TableSample, idle: Sequence[str]
) -> str:
    """Return the message and the advice for a table, or sensors of it, without measured quantities.

    ``idle`` are the names of such sensors beside others that measure.
    """
    pairs = "x and y, latitude and longitude, range and azimuth, or range"
    names = sample.names
    known = shown_names(names)
    # Case 1: a column has the name of a measured quantity, and no numbers.
    for name in filter(columns.get, MEASURED):
        mistake = _explain_column_of_text(columns[name], sample)
        if mistake:
            return mistake
    # Case 2: such columns are empty. The sample begins where something is measured, if anything is.
    empty = [columns[name] for name in ("x", "y", *GEODETIC[:2], *MEASURED) if columns.get(name)]
    empty = [name for name in dict.fromkeys(empty) if not any(sample.cells(name))]
    if empty and not columns.get("sensor"):
        return f"{', '.join(empty)}: there is no number in any row; take the table with the measurements"
    # Case 3: coordinates of another kind.
    if any("ecef" in "".join(words_of(name)) for name in names):
        message = "coordinates from the center of the Earth (ECEF) are not read; there are"
        remedy = "convert them to latitude and longitude (EPSG:4978 to EPSG:4326)"
        return f"{message} {known}: {remedy}"
    # Case 4: a cell has latitude and longitude, such as "54.32, 10.13".
    for name in names:
        if any(re.fullmatch(r"-?\d+\.\d+, *-?\d+\.\d+", cell) for cell in sample.cells(name)[:1]):
            return f"column {name} has two numbers in a cell: give each a column, latitude and longitude"
    # Case 5: some of several sensors measure no known quantity.
    if idle:
        column = columns["sensor"]
        message = f"column {column} names {shown_names(idle)} beside others, with no {pairs}"
        option = f"`--set 'columns.sensor={in_option(column)}'`"
        ways = f"leave their rows out, {option}, or name what they measure, such as `--set"
        return f"{message}; there are {known}: {ways} 'columns.range=NAME'`"
    # Case 6: the odometry of a robot has no measurements.
    odometry = odometry_of(names)
    if odometry.keys() >= {*ODOMETRY}:
        shown = " and ".join(named.column for named in odometry.values())
        message = f"this table has inputs, {shown}, and no measurements"
        remedy = "name the table of what the robot measured, --from MEASUREMENTS"
        return f"{message}: {remedy} --input {sample.path} (docs/your-robot.md)"
    # Case 7: other columns with numbers may be measured.
    candidates = []
    for name in names:
        is_free = name not in columns.values() and role_of(name) != "quality"
        if is_free and np.isfinite(sample.numbers(name)).any():
            candidates.append(in_option(name))
    x, y = candidates[:2] if len(candidates) > 1 else ("NAME", "NAME")
    remedy = f"say which are, `--set 'columns.x={x}' --set 'columns.y={y}'`"
    # Of lat1, lon1, lat2 and lon2 the first two are a latitude and a longitude.
    geodetic = [
        next((name for name in candidates if any(map(word.match, words_of(name)))), "")
        for word in (_LATITUDE, _LONGITUDE)
    ]
    if all(geodetic):
        latitude, longitude = geodetic
        remedy = f"say which are, `--set 'columns.latitude={latitude}'"
        remedy += f" --set 'columns.longitude={longitude}'`"
    remedy += "; ranges to several places have names such as range_1 and range_2"
    return f"no columns look like {pairs}; there are {known}: {remedy}"


def _explain_column_of_text(column: str, sample: TableSample) -> str:
    """Return the message and the advice for a column of text; empty if it has numbers or no cells."""
    cell = next((cell for cell in sample.cells(column) if cell), "")
    if not cell or np.isfinite(sample.numbers(column)).any():
        return ""
    message = f"{column}: {cell[:40]!r} is not a number, nor is any other of its cells"
    return f"{message}: write decimal numbers, such as -8.5042, without letters"


def check_unused(
    sample: TableSample, columns: ColumnByQuantity, sensors: list[SensorGuess], user_naming: Naming
) -> None:
    """Raise DataError if only angles are read and an unused column may be the range, or the reverse.

    The name of such a column has a word or a unit of a range or of an angle. There is no error if
    ``user_naming`` already names the column, or says by an empty name that there is none.
    """
    if len(sensors) > 1:
        return
    # The second quantity that a sensor of each type may measure, too.
    other_part = {"bearing": "range", "range": "azimuth", "landmark-bearing": "range"}
    quantity = other_part.get(sensors[0].kind)
    if quantity is None or quantity in user_naming.columns:
        return
    mistake = _explain_column_of_text(columns.get(quantity, ""), sample)
    if mistake:
        remedy = f"or say --set 'columns.{quantity}=\"\"' to leave them out"
        raise DataError(Place(sample.path, sample.line, 1, f"{mistake}; {remedy}"))
    candidates = []
    for name in sample.names:
        has_numbers = np.isfinite(sample.numbers(name)).any()
        if name in columns.values() or not has_numbers or role_of(name) == "quality":
            continue
        if looks_like(name, quantity):
            candidates.append(in_option(name))
    if candidates:
        candidates = candidates[:_MOST_CANDIDATES]
        measured = columns[sensors[0].quantities[-1]]
        options = " or ".join(f"--set 'columns.{quantity}={name}'" for name in candidates)
        doubt = f"is {' or '.join(candidates)} the {quantity}?"
        message = f"only {measured} is recognized as measured; {doubt}"
        remedy = f"Say {options}, or --set 'columns.{quantity}=\"\"' if none is"
        raise DataError(Place(sample.path, 1, 1, f"{message} {remedy}"))


def unwrapped_values(rows: Rows, kind: str, in_degrees: bool) -> list[Array]:
    """Return the values (R,) of each quantity of a sensor; angles are in radians and without jumps.

    ``kind`` is a key of `SENSORS`. ``in_degrees`` is True if the angles of ``rows`` are in degrees.
    """
    # Rows of the values below those of the sensor's quantities are measured velocities.
    values = [*rows.values[: len(SENSORS[kind])]]
    if SENSORS[kind][-1] in ANGLES:
        azimuth = values[-1]
        if in_degrees:
            azimuth = azimuth * UNITS["deg"]
        values[-1] = np.unwrap(azimuth)
    return values
