"""Cells of a table as numbers, times and whole numbers."""

import math
from collections.abc import Callable, Sequence
from datetime import UTC, datetime, timedelta

import numpy as np

from trackbench.core.arrays import Array

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_MICROSECOND = timedelta(microseconds=1)
_DIGITS = 9
"""Of a whole number, at most."""
Parse = Callable[[str], float]


def number(cell: str) -> float:
    """A finite number, NaN for a cell that is empty or says so. ValueError says what it is not."""
    if cell.lower() in ("", "nan"):
        return math.nan
    try:
        # float takes an underscore, and the digits of every script.
        value = float(cell if cell.isascii() and "_" not in cell else "")
    except ValueError:
        raise ValueError("a number") from None
    if not math.isfinite(value):
        raise ValueError("a finite number")
    return value


def seconds(cell: str) -> float:
    """A time in numbers, which is there."""
    value = number(cell)
    if math.isnan(value):
        raise ValueError("a time")
    return value


def instant(cell: str, zoned: bool | None = None) -> float:
    """Microseconds since 1970 of a time in ISO 8601, exactly; without a zone it is UTC.

    ``zoned`` says whether it must have a zone, None that it may. ValueError says what it is not.
    """
    try:
        at = datetime.fromisoformat(cell)
    except ValueError:
        raise ValueError("a time in ISO 8601") from None
    if zoned is not None and zoned != (at.tzinfo is not None):
        raise ValueError(
            f"a time {'with' if zoned else 'without'} a zone, as that of the first row is"
        )
    at = at if at.tzinfo else at.replace(tzinfo=UTC)
    return float((at - _EPOCH) // _MICROSECOND)


def has_zone(cell: str) -> bool:
    """Return whether a date names its time zone."""
    return datetime.fromisoformat(cell.strip()).tzinfo is not None


def whole(cell: str) -> float:
    """A whole number from zero on."""
    if not (cell.isascii() and cell.isdigit()):
        raise ValueError("a whole number")
    if len(cell) > _DIGITS:
        raise ValueError(f"less than {10**_DIGITS}")
    return float(cell)


def is_instant(cell: str) -> bool:
    """Whether a time is written as a date."""
    try:
        instant(cell.strip())
    except ValueError:
        return False
    return not cell.strip().replace(".", "").isdigit()  # 20160112 may be a number of seconds


def parsed(parse: Parse, cells: Sequence[str]) -> tuple[Array, list[tuple[int, str]]]:
    """The values (R,) of a column's cells, and which are none and why."""
    if parse in (number, seconds):
        values = _quickly(cells)
        if values is not None:
            return values, []
    out, mistakes = np.full(len(cells), np.nan), []
    for i, cell in enumerate(cells):
        try:
            out[i] = parse(cell.strip())
        except ValueError as error:
            mistakes.append((i, f"{cell.strip()[:40]!r} is not {error}"))
    return out, mistakes


def _quickly(cells: Sequence[str]) -> Array | None:
    """The numbers, if every cell is a plain finite one."""
    text = "".join(cells)
    if not text.isascii() or "_" in text:
        return None
    try:
        values = np.fromiter(map(float, cells), dtype=np.float64, count=len(cells))
    except ValueError:
        return None
    return values if np.isfinite(values).all() else None
