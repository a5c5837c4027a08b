"""Header of a text table: the line with the names of its columns, or the names without such a line."""

import csv
import re
from collections.abc import Mapping, Sequence
from itertools import chain

import numpy as np

from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.parse_numbers import number, parse_cells

BEFORE_NAMES = r"\s+(?=[^\s\[(])"  # white space, but before a unit
_VALUE = re.compile(r"[-+]?[0-9.,]+([eE][-+]?[0-9]+)?|\d{1,4}([-/.:])\d{1,2}\2[0-9TZ:. +-]*")
TUM = ("timestamp", "tx", "ty", "tz", "qx", "qy", "qz", "qw")
"""Columns of the TUM format of trajectories."""


def names_beside_week(comments: Mapping[int, str], rows: Sequence[list[str]]) -> list[str]:
    """Return the names of columns from a comment as RTKLIB writes it; empty if there is none.

    Its first name, such as GPST, stands for two columns: the GPS week and the seconds in it.
    ``comments`` are by line number, ``rows`` are the cells of rows of full width.
    """
    if not comments:
        return []
    names = comments[max(comments)].split()
    is_time = bool(names) and names[0].lower() in ("gpst", "utc", "jst")
    # Beside the time there are two quantities at least, a latitude and a longitude.
    if not is_time or len(names) != len(rows[0]) - 1 or len(names) < 3:
        return []
    # All rows have the same form, so that the first one shows it.
    week, seconds = rows[0][:2]
    is_week = re.fullmatch(r"\d{1,4}", week) and re.fullmatch(r"\d{1,6}(\.\d*)?", seconds)
    if not is_week:
        return []
    return ["week", "tow", *names[1:]]


def find_header(
    cells: dict[int, list[str]], comments: dict[int, str], separator: str, widths: Sequence[int]
) -> int:
    """Return the number of the line with the columns' names.

    If no line has names, it is the first line with the usual number of cells: the caller finds that its
    cells are values. ``cells`` and ``comments`` are the first lines by number, the latter as text.
    ``widths`` are the possible numbers of names, the first of which is the usual number of cells. If a
    comment has the names, its cells are added to ``cells`` in place.
    """
    first, *below = cells
    start = next(number for number, row in cells.items() if len(row) == widths[0])
    # Case 1: the first line has values, and the last comment above it has the names.
    above = max((number for number in comments if number < first), default=0)
    if above and any(map(is_value, cells[first])):
        # The comment may be split as the table is, or by any separator, or by white space before names.
        separators = (separator, r"\s*[,;\t|]\s*|\s+", BEFORE_NAMES)
        names = split_names(comments[above], separators, widths)
        if len(names) not in widths:
            return first
        cells[above] = names
        return above
    # Case 2: a single line stands above values. It has the names, even if it has too few or too many
    # cells, which is reported later.
    second = next(iter(below), 0)
    has_values_below = start == second and any(map(is_value, cells[start]))
    if has_values_below and len(cells[first]) > 1:
        return first
    # Case 3: the first line has names for all cells, as in most tables, or several lines, such as titles
    # and units, stand above values. Of the lines with the usual number of cells the one with most
    # different words has the names. It is the first of them if this has values.
    return _fullest_line(cells, start)


def split_names(line: str, separators: Sequence[str], widths: Sequence[int]) -> list[str]:
    """Split a line of names into as many cells as one of ``widths``.

    ``separators`` are a character and then regular expressions, which are tried in order. If none fits,
    the line is split by the character.
    """
    separator, *patterns = separators
    by_separator = split_cells(line, separator)
    if len(by_separator) in widths:
        return by_separator
    for pattern in patterns:
        names = re.split(pattern, line.strip())
        if len(names) in widths:
            return names
    return by_separator


def _fullest_line(cells: Mapping[int, list[str]], start: int) -> int:
    """Return the number of the line above the first values that has most different words.

    ``cells`` are those of the first lines, by line number. Line ``start`` is the first one with the
    usual number of cells. Only lines with as many cells count, and it is the answer if none has names.
    """
    count_of_words = {}  # different words, by line number
    for line, row in cells.items():
        if len(row) == len(cells[start]):
            if any(map(is_value, row)):
                break
            count_of_words[line] = len({*map(str.strip, row)} - {""})
    if not count_of_words:
        return start
    return max(count_of_words, key=lambda line: count_of_words[line])


def check_header(path: str, line: int, names: Sequence[str]) -> None:
    """Raise DataError if the line of ``names``, which has the number ``line``, has values instead."""
    if all(is_value(name) for name in names if name):
        message = f"holds {', '.join(names)[:60]} and no names of columns: name all"
        remedy = f"{len(names)}, such as `format: {{names: [time, x, y]}}`"
        raise DataError(Place(path, line, 1, f"{message} {remedy}"))


def is_value(cell: str) -> bool:
    """Test whether a cell is a number or a date, and no name."""
    return _VALUE.fullmatch(cell.strip()) is not None


def split_cells(line: str, separator: str) -> list[str]:
    """Split one line into cells; a space as the separator stands for any white space."""
    if separator == " ":
        return line.split()
    return next(csv.reader([line.rstrip("\r\n")], delimiter=separator), [])


def fits_names(rows: list[list[str]], names: tuple[str, ...]) -> bool:
    """Test whether the cells of rows may be a time, x and y, or a trajectory in the TUM format.

    ``names`` are those of these three or eight columns. Three columns do not fit if all numbers of the
    last two have the digits of degrees, or if one of these columns rises at equal intervals as a time
    does, and the first one does not. The last four columns of a trajectory must be a unit quaternion.
    """
    if len(names) == 3:
        coordinates = list(chain.from_iterable(row[1:] for row in rows))
        if all(re.fullmatch(r" *-?\d{1,3}\.\d{4,} *", cell) for cell in coordinates):
            return False
    complete_rows = [row for row in rows if len(row) == len(names)]
    cells = [cell.strip().replace(",", ".") for cell in chain.from_iterable(complete_rows)]
    numbers = parse_cells(number, cells)[0].reshape(len(complete_rows), len(names)).T
    if len(names) == len(TUM):
        # Written quaternions are rounded, and some rows may be wrong.
        size = np.sqrt(np.square(numbers[4:]).sum(axis=0))
        return bool((np.abs(size - 1.0) < 0.05).mean() > 0.9)
    intervals = np.diff(numbers, axis=1)
    usual = np.median(intervals, axis=1)
    # Written times are rounded, and some rows may be missing.
    near_usual = np.abs(intervals - usual[:, None]) <= 0.1 * np.abs(usual[:, None])
    is_clock = (near_usual.mean(axis=1) > 0.8) & (usual > 0.0) & (intervals >= 0.0).all(axis=1)
    return bool(is_clock[0] or not is_clock[1:].any())
