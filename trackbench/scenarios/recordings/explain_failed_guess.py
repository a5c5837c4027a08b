"""Explanation of a failed guess: no measured quantity is recognized, or a part of one is missing."""

import re
from collections.abc import Sequence

import numpy as np

from trackbench.field_types import Place
from trackbench.scenarios.recordings.guess_record import ColumnByQuantity
from trackbench.scenarios.recordings.guess_table_sample import TableSample
from trackbench.scenarios.recordings.guess_utm_ecef_slant_ranges import explain_ecef
from trackbench.scenarios.recordings.label_column_names import role_of
from trackbench.scenarios.recordings.odometry_columns import odometry_of
from trackbench.scenarios.recordings.quantity_keys import GEODETIC, MEASURED, ODOMETRY
from trackbench.scenarios.recordings.recognize_column_names import (
    TRUTH_WORDS,
    shown_names,
    words_of,
)
from trackbench.scenarios.recordings.yaml_values import in_option

_ADVICE = {
    r"[-+]?\d{1,3}(\s\d{3})+([.,]\d*)?": "write thousands without white space, such as 500006.95",
    r"[-+]?\d*\.?\d+[dD][-+]?\d+": "write powers of ten with E, such as 6.9E+03",
}
"""Advice on cells that are no numbers, by their pattern."""
_TWO_NUMBERS = re.compile(r"(POINT)?[\s(\[{]*-?\d+\.\d+[\s,;]+-?\d+\.\d+[\s)\]}]*", re.IGNORECASE)
_VALUE_WORDS = {"value", "values", "val", "reading", "data"}
_VARIABLE_WORDS = {
    "variable", "parameter", "quantity", "channel", "signal", "measurement", "field", "topic",
    "name", "key", "metric", "type",
}  # fmt: skip
_LATITUDE = re.compile(r"lat(itude)?\d*$")
_LONGITUDE = re.compile(r"(lon|lng|long|longitude)\d*$")


def explain_missing_quantities(
    columns: ColumnByQuantity, sample: TableSample, idle: Sequence[str]
) -> Place:
    """Return the mistake, with advice, of a table, or sensors of it, without measured quantities.

    ``columns`` are the columns by quantity. ``idle`` are the names of such sensors beside others that
    measure.
    """
    # A column has the name of a measured quantity, and no numbers.
    for name in filter(columns.get, MEASURED):
        mistake = explain_column_of_text(columns[name], sample)
        if mistake is not None:
            return mistake
    return Place(sample.path, 1, 1, _explain_names(columns, sample, idle))


def _explain_names(columns: ColumnByQuantity, sample: TableSample, idle: Sequence[str]) -> str:
    """Return the message and the advice for columns that no single cell shows to be wrong."""
    pairs = "x and y, latitude and longitude, range and azimuth, or range"
    names = sample.names
    known = shown_names(names)
    # Case 1: columns with names of measured quantities are empty. The sample begins where something is
    # measured, if anything is.
    empty = [columns[name] for name in ("x", "y", *GEODETIC[:2], *MEASURED) if columns.get(name)]
    empty = [name for name in dict.fromkeys(empty) if not any(sample.cells(name))]
    if empty and not columns.get("sensor"):
        return f"{', '.join(empty)}: there is no number in any row; take the table with the measurements"
    # Case 2: coordinates of another kind.
    ecef = explain_ecef(names)
    if ecef:
        return ecef
    # Case 3: a cell has two coordinates, such as "54.32, 10.13", "[6.95, 8.96]" or "POINT (10.1 54.3)".
    for name in names:
        if any(map(_TWO_NUMBERS.fullmatch, sample.cells(name)[:1])):
            message = f"column {name} has two numbers in a cell: give each a column"
            return f"{message}, such as latitude and longitude, or x and y"
    # Case 4: each row has the name of a quantity and its value.
    long = _explain_long_table(sample, columns)
    if long:
        return long
    # Case 5: some of several sensors measure no known quantity.
    if idle:
        column = columns["sensor"]
        message = f"column {column} names {shown_names(idle)} beside others, with no {pairs}"
        option = f"`--set 'columns.sensor={in_option(column)}'`"
        ways = f"leave their rows out, {option}, or name what they measure, such as `--set"
        ways += f" 'columns.range=NAME'`; or if {column} names no sensors, say `--set"
        return f"{message}; there are {known}: {ways} 'columns.sensor=\"\"'`"
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
    # A truth is not measured.
    candidates.sort(key=lambda name: not TRUTH_WORDS.isdisjoint(words_of(name)))
    x, y = candidates[:2] if len(candidates) > 1 else ("NAME", "NAME")
    # Of player_1_x and player_1_y beside others these are a position.
    by_last_word = [
        next((name for name in candidates if words_of(name)[-1] == word), "") for word in "xy"
    ]
    if all(by_last_word):
        x, y = by_last_word
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


def _explain_long_table(sample: TableSample, columns: ColumnByQuantity) -> str:
    """Return the message for a table whose rows name a quantity and have its value; empty for others."""
    values = [name for name in sample.names if name.lower() in _VALUE_WORDS]
    for name in sample.names:
        cells = set(sample.cells(name))
        is_repeated = 1 < len(cells) <= len(sample) / 2
        if values and is_repeated and name.lower() in _VARIABLE_WORDS:
            message = (
                f"column {name} names quantities and {values[0]} has their values, one in each row"
            )
            time = columns.get("time") or "TIME"
            example = f"table.pivot(index={time!r}, columns={name!r}, values={values[0]!r})"
            return f"{message}: give each quantity a column, such as with pandas by `{example}`"
    return ""


def explain_column_of_text(column: str, sample: TableSample) -> Place | None:
    """Return the mistake, with advice, of a column of text; None if it has numbers or no cells."""
    cell = next((cell for cell in sample.cells(column) if cell), "")
    if not cell or np.isfinite(sample.numbers(column)).any():
        return None
    message = f"{column}: {cell[:40]!r} is not a number, nor is any other of its cells"
    advice = "write decimal numbers, such as -8.5042, without letters"
    for pattern, special_advice in _ADVICE.items():
        if re.fullmatch(pattern, cell):
            advice = special_advice
    message += f": {advice}"
    return Place(sample.path, sample.line_of(column, [cell]), 1, message)
