"""Numbers from cells: times in seconds, whole numbers, missing cells and marks of thousands."""

import math
import re
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from trackbench.core.arrays import Array
from trackbench.scenarios.recordings.missing_cells import DASHES, MISSING_WORDS
from trackbench.scenarios.recordings.parse_dates import dates_quickly, is_instant

_DIGITS = 9
"""Of a whole number, at most."""
Parse = Callable[[str], float]
"""Parser of one cell. Its ValueError says what the cell should be, in words that follow "is not"."""

_WITH_THOUSANDS = re.compile(r"[-+]?\d{1,3}(?P<mark>[,'.])\d{3}((?P=mark)\d{3})*([.,]\d*)?")


def without_thousands(cell: str, mark: str) -> str:
    """Return a number's text without the mark between its groups of three digits: 1234,5 of 1.234,5.

    Any other text is returned as it is.
    """
    groups = rf"([-+]?\d{{1,3}})((?:{re.escape(mark)}\d{{3}})+)(?!\d)(.*)"
    match = re.fullmatch(groups, cell.strip())
    if match is None:
        return cell
    first, others, rest = match.groups()
    return first + others.replace(mark, "") + rest


def number(cell: str, comma: bool = False) -> float:
    """Parse a cell as a finite number; NaN for a missing cell.

    If ``comma`` is True, decimals follow a comma in place of a point. Raises ValueError with words for
    what the cell should be.
    """
    if cell.lower() in MISSING_WORDS or DASHES.fullmatch(cell):
        return math.nan
    if comma and "." in cell:
        raise ValueError("a number with a decimal comma, as others of this file are")
    # float would also accept 1_000, and digits that are not ASCII.
    if "_" in cell or not cell.isascii():
        raise ValueError("a number")
    try:
        value = float(cell.replace(",", ".") if comma else cell)
    except ValueError:
        raise ValueError("a number") from None
    if not math.isfinite(value):
        raise ValueError("a finite number")
    return value


def seconds(cell: str, comma: bool = False) -> float:
    """Parse a cell as a time, which is a number and must not be missing.

    The number stays in the unit of the file, which is converted to seconds later. If ``comma`` is True,
    decimals follow a comma in place of a point. Raises ValueError with words for what the cell should
    be.
    """
    value = number(cell, comma)
    if math.isnan(value):
        raise ValueError("a time")
    return value


def whole(cell: str) -> float:
    """Parse a cell as a whole number that is not negative, such as that of a step.

    Raises ValueError with words for what the cell should be.
    """
    if not (cell.isascii() and cell.isdigit()):
        raise ValueError("a whole number")
    if len(cell) > _DIGITS:
        raise ValueError(f"less than {10**_DIGITS}")
    return float(cell)


def parse_cells(parse: Parse, cells: Sequence[str]) -> tuple[Array, list[tuple[int, str]]]:
    """Parse a column's cells by the parser ``parse``.

    Return values (R,), which are NaN in wrong cells, and the index and reason of each wrong cell.
    """
    # A parser with options is a partial: of `number` or `seconds` with ``comma``, which is True if
    # decimals follow a comma, or of `instant`, which parses dates, with a ``date_format``.
    options = {}
    if isinstance(parse, partial):
        options = parse.keywords
    values = None
    # Usually all cells are plain numbers, or dates of one format, which are parsed in one pass.
    if options.get("date_format"):
        values = dates_quickly(cells, options["date_format"])
    # With a decimal comma a point is a mistake, which the parser of single cells names.
    elif options.get("comma") and not any("." in cell for cell in cells):
        values = _plain_numbers([cell.replace(",", ".") for cell in cells])
    elif parse in (number, seconds):
        values = _plain_numbers(cells)
    if values is not None:
        return values, []
    values = np.full(len(cells), np.nan)
    mistakes = []
    # Otherwise cell by cell, to name each mistake.
    for i, cell in enumerate(cells):
        try:
            values[i] = parse(cell.strip())
        except ValueError as error:
            mistakes.append((i, f"{cell.strip()[:40]!r} is not {error}"))
    return values, mistakes


def _plain_numbers(cells: Sequence[str]) -> Array | None:
    """Return all R cells as numbers (R,) if every cell is a plain finite number; None otherwise."""
    text = "".join(cells)
    # float would also accept 1_000, and digits that are not ASCII.
    if not text.isascii() or "_" in text:
        return None
    try:
        values = np.fromiter(map(float, cells), dtype=np.float64, count=len(cells))
    except ValueError:
        return None
    if not np.isfinite(values).all():
        return None
    return values


def remedy_for_text(cell: str, *, is_time: bool) -> str:
    """Return the end of a message on a cell that is no number: what to write or to say."""
    if is_time:
        if is_instant(cell):
            return ", as the other times are: write all times in one form"
        return ": correct it, or leave out the row"
    number_with_marks = _WITH_THOUSANDS.fullmatch(cell)
    if number_with_marks is not None:
        mark = number_with_marks["mark"]
        return f': say `format: {{thousands: "{mark}"}}` if this mark separates thousands'
    return ": correct it, or empty the cell if nothing was measured"
