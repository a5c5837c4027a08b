"""Guess of the columns of hemispheres, and the questions on degrees to the south and west."""

from collections.abc import Collection, Mapping

import numpy as np

from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.guess_record import ColumnByQuantity
from trackbench.scenarios.recordings.guess_table_sample import TableSample
from trackbench.scenarios.recordings.hemispheres import HEMISPHERES
from trackbench.scenarios.recordings.quantity_keys import GEODETIC
from trackbench.scenarios.recordings.recognize_column_names import (
    columns_of,
    negative_side_of,
    words_of,
)
from trackbench.scenarios.recordings.yaml_values import in_option

_HEMISPHERE_WORDS = frozenset(("hemisphere", "hemi", "hem", "ns", "nz", "ew", "eo", "ow"))
_DIRECTION_WORDS = frozenset(("dir", "direction", "ref", "sign"))
"""Words of the column of a hemisphere beside the name of a coordinate, such as lat_dir"""


def hemispheres_of(sample: TableSample, columns: ColumnByQuantity) -> dict[str, str]:
    """Find the columns of the letters N and S, and E and W, beside latitude and longitude.

    Return them by their key of `columns`, ``north_south`` or ``east_west``.
    """
    hemispheres: dict[str, str] = {}
    for quantity, (key, positive, negative) in HEMISPHERES.items():
        if quantity not in columns or key in columns:
            continue
        for name in sample.names:
            words = {cell.lower() for cell in sample.cells(name)} - {""}
            if name != columns[quantity] and words and words <= {*positive, *negative}:
                hemispheres.setdefault(key, name)
    return hemispheres


def check_hemispheres(
    sample: TableSample, columns: Mapping[str, str], user_columns: Collection[str]
) -> None:
    """Raise DataError if a coordinate may count to the south or west, and is read as north or east.

    The name of its column says so, or a column of hemispheres has unknown words. ``columns`` are the
    columns by quantity. There is no error if the user named the column of the coordinate or of the
    hemispheres, which ``user_columns`` then has.
    """
    if not columns.keys() >= {*GEODETIC[:2]}:
        return
    keys = [HEMISPHERES[quantity][0] for quantity in GEODETIC[:2]]
    for quantity, key in zip(GEODETIC[:2], keys, strict=True):
        column = columns[quantity]
        side = negative_side_of(column, quantity)
        if side and quantity not in user_columns and key not in columns:
            message = f"do the numbers of {column} count to the {side}, as its name says?"
            remedy = f"Then write degrees to the {side} as negative numbers"
            option = f"--set 'columns.{quantity}={in_option(column)}'"
            remedy += f"; if they are negative there, say {option}"
            raise DataError(Place(sample.path, sample.first_line, 1, f"{message} {remedy}"))
    if not {*keys}.isdisjoint(user_columns):
        return
    for name in sample.names:
        # A column of hemispheres has words for north, south, east and west at most.
        words = sample.words(name)
        if name in columns.values() or not 0 < len(words) <= 4 or not _names_hemisphere(name):
            continue
        # Numbers other than 1 and -1 name no hemisphere: they count satellites (ns), or are angles.
        numbers = sample.numbers(name)
        numbers = numbers[np.isfinite(numbers)]
        if len(numbers) and not {*numbers} <= {-1.0, 1.0}:
            continue
        message = f"{name} has {', '.join(words)}: does it name the hemisphere of a coordinate?"
        remedy = "Then write N and S, E and W into it, or degrees to the south and west as negative"
        remedy += " numbers without it"
        options = " ".join(f"--set 'columns.{key}=\"\"'" for key in keys if key not in columns)
        line = sample.line_of(name, words)
        raise DataError(Place(sample.path, line, 1, f"{message} {remedy}; if not, say {options}"))


def _names_hemisphere(name: str) -> bool:
    """Test whether a column's name is that of hemispheres, such as NS, hem2 and lat_dir."""
    words = {word.rstrip("0123456789") for word in words_of(name)}
    if words & _HEMISPHERE_WORDS:
        return True
    coordinates = columns_of(words).keys() & {*GEODETIC[:2]}
    return bool(coordinates and words & _DIRECTION_WORDS)
