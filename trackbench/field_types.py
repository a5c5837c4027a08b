"""Types for config keys: a dataclass field's type says what a YAML may put there."""

import errno
import os
import re
import stat
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, NamedTuple, TypeGuard

from annotated_types import Ge, Gt, Interval

Count = Annotated[int, Interval(ge=1, le=10**15)]
"""As many as one likes of something: more than there is time for, and small enough to reckon with."""
MOST_STEPS = 100_000
Steps = Annotated[int, Interval(ge=1, le=MOST_STEPS)]
"""A number of time steps: every series holds one value per step, so it has an end."""
Natural = Annotated[int, Ge(0)]
Positive = Annotated[float, Gt(0), Interval(lt=float("inf"))]
NonNegative = Annotated[float, Ge(0), Interval(lt=float("inf"))]
Finite = Annotated[float, Interval(gt=float("-inf"), lt=float("inf"))]
Share = Annotated[float, Interval(ge=0, le=1)]
"""A number in [0, 1]."""
OpenShare = Annotated[float, Interval(gt=0, lt=1)]
"""A number in (0, 1)."""
Digits = Annotated[int, Interval(ge=1, le=15)]
"""Significant digits of a number that is shown."""

FORMULA = "=+-@"
"""Characters that a spreadsheet takes for the beginning of a formula, whoever wrote the file."""
_UNSEEN = r"\x00-\x1f\x7f-\x9f\u2028\u2029"
ONE_LINE = rf"^[^{_UNSEEN}{re.escape(FORMULA)}][^{_UNSEEN}]*$"
"""Pattern of a label: one line of visible characters that is no formula."""

IS_FILE = "path of a data file"
DataFile = Annotated[str, IS_FILE]
"""A path, counted from the YAML file it stands in; a dataclass gets it absolute."""


def require_regular_file(path: str | Path) -> Path:
    """Return the path of a file that can be read to its end.

    Raises OSError for what is not there, a folder, and a device or a pipe, which may have no end.
    """
    mode = os.stat(path).st_mode
    if stat.S_ISDIR(mode):
        raise OSError(errno.EISDIR, "is a folder")
    if not stat.S_ISREG(mode):
        raise OSError(errno.EINVAL, "is a device or a pipe, not a file")
    return Path(path)


class Place(NamedTuple):
    """A mistake in a data file: line and column count from 1."""

    file: str
    line: int
    column: int
    what: str


class DataError(ValueError):
    """Mistakes in a data file, place by place."""

    def __init__(self, *places: Place) -> None:
        super().__init__("; ".join(f"{p.file}:{p.line}: {p.what}" for p in places))
        self.places = places


class InvalidKeyError(ValueError):
    """A mistake in a key, or in an item of a list, of the dataclass that is being made."""

    def __init__(self, what: str, *path: str | int) -> None:
        super().__init__(what)
        self.path = path


@dataclass(frozen=True)
class Registered:
    """Marks a key that holds a registered part, or a list: ``Annotated[Motion, Registered("motions")]``.

    A config gives a mapping with a ``kind``, or the kind alone. What reads the config makes the parts
    first and puts numbers in their place; this takes the part of that number in their stead.
    """

    group: str
    """registry group of the part"""

    def __get_pydantic_core_schema__(self, source: object, handler: object) -> Any:
        """Return any value in a schema: the registry knows what may stand here."""
        from pydantic_core import core_schema

        return core_schema.with_info_plain_validator_function(
            _prebuilt, json_schema_input_schema=core_schema.any_schema()
        )


def _prebuilt(number: object, info: Any) -> Any:
    return None if number is None else info.context[number]


def is_number(value: object) -> TypeGuard[float]:
    """Return whether a value of a config is a number, which a truth value is not."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def part_group(hint: object) -> str | None:
    """Return the registry group of the parts that a key of this type holds, if it holds any."""
    marks = (
        mark.group for mark in getattr(hint, "__metadata__", ()) if isinstance(mark, Registered)
    )
    return next(marks, None)
