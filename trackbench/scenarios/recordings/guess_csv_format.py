"""Guess of the key `format` of a text table: separator, header, decimal sign, thousands."""

import re
from dataclasses import fields, replace
from itertools import chain, islice
from typing import Any

from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.csv_layout_and_rows import TextFormat, layout_of, table_rows
from trackbench.scenarios.recordings.guess_record import ColumnByQuantity, ReasonByKey
from trackbench.scenarios.recordings.guess_table_sample import TableSample
from trackbench.scenarios.recordings.header_line import TUM, fits_names, is_value
from trackbench.scenarios.recordings.parquet_files import is_parquet
from trackbench.scenarios.recordings.parse_numbers import without_thousands
from trackbench.scenarios.recordings.quantity_keys import MEASURED, VELOCITY

_FIRST = 200  # rows that show the format

_MOST_LINES_OF_WORDS = 5


def guess_format(path: str, user_format: TextFormat, reasons: ReasonByKey) -> TextFormat:
    """Guess the format of a text file by its first lines: separator, decimal sign, header, units.

    Keys that are set in ``user_format`` are not guessed. Reasons are added to ``reasons`` in place. A
    Parquet file has no such format. Raises DataError if no line names the columns, unless they are those
    of a trajectory in the TUM format, or seem to be a time, x and y.
    """
    if is_parquet(path):
        return user_format
    layout = layout_of(path, user_format)
    rows = [cells for _, cells in islice(table_rows(path, layout), _FIRST)]
    keys: dict[str, Any] = {}
    if layout.separator != ",":
        keys["separator"] = {"\t": "tab", " ": "space"}.get(layout.separator, layout.separator)
    if layout.encoding != "utf-8-sig":
        keys["encoding"] = layout.encoding
    # A header in the first line, or in a comment, is found again without the key.
    if layout.header > 1 and not layout.is_comment:
        keys["header"] = layout.header
    # If commas separate cells, a comma in a quoted cell is a decimal sign unless three digits follow.
    cells = [cell.strip() for cell in chain.from_iterable(rows)]
    digits = r"[-+]?\d+,\d+"
    if layout.separator == ",":
        digits = r"[-+]?\d+,(\d\d?|\d{4,})"
    thousands = _thousands(cells)
    if thousands:
        keys["thousands"] = thousands
        cells = [without_thousands(cell, thousands) for cell in cells]
    if thousands != "," and any(re.fullmatch(digits, cell) for cell in cells):
        keys["decimal"] = ","
    if keys:
        reasons["format"] = "guess: as its first lines are"
    # A first line of values has no names of columns.
    if layout.header and not user_format.header and all(map(is_value, layout.names)):
        width = len(layout.names)
        # Eight columns are a trajectory in the TUM format, three a time and a position.
        names: tuple[str, ...] = ()
        if width == len(TUM):
            names = TUM
        elif width == 3:
            names = ("time", "x", "y")
        if not names or not fits_names([layout.names, *rows], names):
            message = f"no line names the columns: name all {width},"
            remedy = "`--set 'format.names=[time, x, y, ...]'` (or latitude, longitude, range, ...)"
            raise DataError(Place(path, layout.header, 1, f"{message} {remedy}"))
        keys |= {"names": names, "header": 0}
        reasons["format"] = "guess: no line names the columns"
    elif not user_format.skip:
        skip = lines_of_words(rows)
        if skip:
            message = "is a line of units" if skip == 1 else f"are {skip} lines of words"
            keys["skip"] = skip
            reasons["format"] = f"guess: below the names {message}"
    user_keys = {field.name for field in fields(user_format) if getattr(user_format, field.name)}
    guessed = {key: value for key, value in keys.items() if key not in user_keys}
    return replace(user_format, **guessed)


def _thousands(cells: list[str]) -> str:
    """Return the mark between groups of three digits: point, comma or apostrophe; empty without one.

    A single cell shows it, if the mark is twice in a number, or once and before a decimal sign.
    """
    for mark, decimal in ((".", ","), (",", "."), ("'", ".")):
        # 1.234.567 and 1.234,5
        twice = rf"[-+]?\d{{1,3}}({re.escape(mark)}\d{{3}}){{2,}}({re.escape(decimal)}\d*)?"
        once = rf"[-+]?\d{{1,3}}{re.escape(mark)}\d{{3}}{re.escape(decimal)}\d+"
        if any(re.fullmatch(twice, cell) or re.fullmatch(once, cell) for cell in cells):
            return mark
    return ""


def check_thousands(sample: TableSample, columns: ColumnByQuantity, mark: str) -> None:
    """Raise DataError for each column in which the ``mark`` may separate thousands or decimals.

    All its cells then have the mark once, before three digits. ``columns`` are the columns by quantity,
    and other columns have shown that the mark separates thousands.
    """
    numeric = {"time", *MEASURED, "speed", "course", *VELOCITY}
    mistakes = []
    for name, column in columns.items():
        if name not in numeric:
            continue
        cells = [cell for cell in sample.cells(column) if cell]
        once = rf"[-+]?[1-9]\d{{0,2}}{re.escape(mark)}\d{{3}}"
        if cells and all(re.fullmatch(once, cell) for cell in cells):
            message = f"{column}: {cells[0]} may be a thousand times as large, as other columns"
            remedy = "have marks between thousands: write the numbers of the file without them"
            line = sample.line_of(column, cells)
            mistakes.append(Place(sample.path, line, 1, f"{message} {remedy}"))
    if mistakes:
        raise DataError(*mistakes)


def lines_of_words(rows: list[list[str]]) -> int:
    """Return the number of rows, such as one of units, that have words alone and stand above all values.

    It is 0 if there are more than `_MOST_LINES_OF_WORDS`, or if one of them is empty.
    """
    for count, row in enumerate(rows[: _MOST_LINES_OF_WORDS + 1]):
        if any(map(is_value, row)):
            return count
        if not any(map(str.strip, row)):
            return 0
    return 0
