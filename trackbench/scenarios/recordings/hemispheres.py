"""Hemispheres of latitudes and longitudes: the words for north, south, east and west."""

from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.parse_tables import Table

HEMISPHERES = {
    "latitude": (
        "north_south",
        ("n", "north", "northern", "nord", "norte", "noord"),
        ("s", "south", "southern", "sud", "sur", "sul", "süd", "sued", "zuid"),
    ),
    "longitude": (
        "east_west",
        ("e", "east", "eastern", "est", "ost", "este", "leste", "oost"),
        ("w", "west", "western", "ouest", "ovest", "oeste"),
    ),
}
"""Key of the column of a coordinate's hemisphere, and its words for positive and negative ones."""


class HemisphereColumn(NamedTuple):
    """A column of hemispheres, and whether the config names it."""

    column: str
    is_named: bool
    """False for a column that was recognized by its first cells, and is only compared with the signs"""


def hemisphere_columns(
    first_cells: Mapping[str, Sequence[str]], answered: Collection[str]
) -> dict[str, str]:
    """Return the columns of hemispheres, by latitude and longitude, as their first cells show.

    All words of such a column are those of its hemispheres. ``first_cells`` are those of each column
    that may be one. Coordinates that are ``answered`` are left out.
    """
    words_by_column = {
        name: {cell.lower() for cell in cells} - {""} for name, cells in first_cells.items()
    }
    columns: dict[str, str] = {}
    for quantity, (_, positive, negative) in HEMISPHERES.items():
        if quantity in answered:
            continue
        for name, words in words_by_column.items():
            if name not in columns.values() and words and words <= {*positive, *negative}:
                columns[quantity] = name
                break
    return columns


def apply_hemisphere(
    path: str, table: Table, quantity: str, coordinate: str, hemispheres: HemisphereColumn
) -> None:
    """Give a coordinate in the table, in place, the sign of its hemisphere.

    ``quantity`` is latitude or longitude, and ``coordinate`` its column. ``path`` is the file. Raises
    DataError if the sign and the hemisphere of a row contradict each other.
    """
    # The key of the column, and its words for north or east and for south or west.
    key, positive, negative = HEMISPHERES[quantity]
    column, is_named = hemispheres
    values = table.columns[coordinate]
    codes = table.columns[column]  # indices into the words
    words = [word.lower() for word in table.words[column]]
    unknown = [i for i, word in enumerate(words) if word and word not in positive + negative]
    is_negative = np.isin(codes, [i for i, word in enumerate(words) if word in negative])
    is_positive = np.isin(codes, [i for i, word in enumerate(words) if word in positive])
    # Step 1: a column that the config does not name must agree with the signs. South or west beside
    # a positive number may be its sign, north or east beside a negative one is a mistake. If the
    # column also has other words, it is none of hemispheres.
    ignore = f'`columns: {{{key}: ""}}` to ignore it'
    if not is_named:
        contrary = np.flatnonzero((is_negative & (values > 0.0)) | (is_positive & (values < 0.0)))
        if len(contrary) and not unknown:
            row = int(contrary[0])
            message = f"{table.words[column][codes[row]]} beside a {quantity} of {values[row]:.9g}"
            remedy = f"say `columns: {{{key}: {column}}}`, or {ignore}"
            if values[row] < 0.0:
                remedy = f"correct one of them, or say {ignore}"
            place = Place(path, int(table.lines[row]), 1, f"{column}: {message}: {remedy}")
            raise DataError(place)
        return
    # Step 2: check the words, and the signs of numbers that have one.
    if unknown:
        row = int(np.flatnonzero(codes == unknown[0])[0])
        allowed = f"{positive[0].upper()} and {negative[0].upper()}"
        message = f"{table.words[column][unknown[0]]!r} is no hemisphere; allowed: {allowed}"
        raise DataError(Place(path, int(table.lines[row]), 1, f"{column}: {message}"))
    wrong = np.flatnonzero((values < 0.0) & is_positive)
    if len(wrong):
        row = int(wrong[0])
        message = f"{values[row]:.9g} beside {table.words[column][codes[row]]} in column {column}"
        remedy = f"correct one of them, or say {ignore}"
        place = Place(path, int(table.lines[row]), 1, f"{coordinate}: {message}: {remedy}")
        raise DataError(place)
    # Step 3: south and west are negative. In rows without a word the coordinate is unknown.
    values[is_negative] = -np.abs(values[is_negative])
    values[~(is_negative | is_positive)] = np.nan
