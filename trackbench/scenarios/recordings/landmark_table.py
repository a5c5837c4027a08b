"""Table of the places of landmarks, which are written into a config."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from trackbench.errors import Mark, Problem, UserError, first_names
from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.csv_layout_and_rows import TextFormat, layout_of
from trackbench.scenarios.recordings.guess_record import Guess
from trackbench.scenarios.recordings.guess_table_sample import TableSample
from trackbench.scenarios.recordings.header_line import is_value
from trackbench.scenarios.recordings.label_column_names import (
    LANDMARK_WORDS,
    joined_and_single_words,
    role_of,
)
from trackbench.scenarios.recordings.label_spelling import plain_label
from trackbench.scenarios.recordings.naming_of_columns import Naming
from trackbench.scenarios.recordings.parquet_files import is_parquet
from trackbench.scenarios.recordings.parse_tables import header, numbered_rows
from trackbench.scenarios.recordings.recognize_column_names import columns_of
from trackbench.scenarios.recordings.unit_names_and_sizes import UNITS

_NAMELESS = ("landmark", "x", "y")
"""Columns of a table whose lines have a number and a place, and no line names them."""
_MOST_NAMES = 8  # that a message shows
_LARGEST = 100.0
"""m that a place of a landmark is below, if no unit is named"""
_KEYS = ("sensor", "x", "y")


def read_landmarks(path: str, user_naming: Naming | None = None) -> dict[str, tuple[float, float]]:
    """Read the places of landmarks, x and y in m, by the plain labels of their names.

    Keys that are set in ``user_naming`` are not guessed. Raises DataError if a column is
    missing, and for each row without a place.
    """
    user_naming = user_naming or Naming()
    for key in user_naming.columns:
        if key not in _KEYS:
            message = f"there is no landmarks.columns.{key}; known: {', '.join(_KEYS)}"
            raise DataError(Place(path, 1, 1, message))
    # Step 1: find the columns.
    text_format = _text_format(path, user_naming.format or TextFormat())
    names = header(path, text_format)
    # All rows are read, as any of them may be the only one of its landmark.
    sample = TableSample(path, names, text_format, list(numbered_rows(path, text_format)))
    sample.require_rows()
    columns = _columns(sample, user_naming)
    # Step 2: read the places, in m.
    scales = [_scale(sample, columns[name], name, user_naming) for name in ("x", "y")]
    x = sample.numbers(columns["x"]) * scales[0]
    y = sample.numbers(columns["y"]) * scales[1]
    places: dict[str, tuple[float, float]] = {}
    mistakes = []
    for row, cell in enumerate(sample.cells(columns["sensor"])):
        name = plain_label(cell)
        # Rounded, as two rows of one landmark may differ in the last digits.
        place = (float(f"{x[row]:.9g}"), float(f"{y[row]:.9g}"))
        message = ""
        if not np.isfinite(place).all():
            message = (
                f"landmark {name} has no place: write x and y as numbers, or leave the row out"
            )
        elif places.get(name, place) != place:
            message = f"landmark {name} has two places: leave one of them out"
        if message:
            mistakes.append(Place(path, sample.lines[row], 1, message))
        places[name] = place
    if mistakes:
        raise DataError(*mistakes)
    return places


def _text_format(path: str, text_format: TextFormat) -> TextFormat:
    """Return ``text_format``, completed by the names landmark, x and y for three columns without names.

    That of any other table is returned as it is.
    """
    if is_parquet(path) or text_format.names or text_format.header:
        return text_format
    layout = layout_of(path, text_format)
    # ``header`` is the number of the line of names; it is 0 only if the config names the columns. In a
    # table without names the first row is taken for this line, so that all names are values.
    has_names = not layout.header or not all(map(is_value, layout.names))
    if has_names or len(layout.names) != len(_NAMELESS):
        return text_format
    return replace(text_format, names=_NAMELESS, header=0)


def _columns(sample: TableSample, user_naming: Naming) -> dict[str, str]:
    """Return the columns of the landmarks' names (``sensor``), of x and of y, by these keys.

    The column of names has a word such as beacon or id in its own name, or is the only other column.
    Raises DataError if one of them is missing.
    """
    columns = {
        name: named.column for name, named in columns_of(sample.names).items() if name in ("x", "y")
    }
    columns |= user_naming.columns
    if "sensor" not in columns:
        free = [name for name in sample.names if name not in columns.values()]
        fitting = []
        for name in free:
            words = joined_and_single_words(name)
            if role_of(name) == "place" or words & {*LANDMARK_WORDS, "name", "label"}:
                fitting.append(name)
        candidates = fitting or free
        if len(candidates) == 1:
            columns["sensor"] = candidates[0]
    missing = [name for name in _KEYS if columns.get(name, "") not in sample.names]
    if missing:
        meaning = {"sensor": "the name of a landmark", "x": "its x", "y": "its y"}
        words_of_missing = " and ".join(meaning[name] for name in missing)
        options = " ".join(f"--set 'landmarks.columns.{name}=ITS NAME'" for name in missing)
        message = (
            f"no column looks like {words_of_missing}; there are {', '.join(sample.names)[:200]}"
        )
        raise DataError(Place(sample.path, 1, 1, f"{message}: say {options}"))
    return columns


def _scale(sample: TableSample, column: str, name: str, user_naming: Naming) -> float:
    """Return the factor from the unit of the coordinate ``name``, x or y, to m.

    Without a named unit it is 1. Raises DataError if a number is then too large for a landmark.
    """
    named = columns_of([column]).get(name)
    unit = user_naming.units.get(name) or sample.unit(column, name)
    if unit is None and named is not None:
        unit = named.unit
    if unit is not None:
        return UNITS[unit]
    largest = float(np.nanmax(np.abs(sample.numbers(column)), initial=0.0))
    if largest > _LARGEST:
        message = f"{column}: no unit is named, and {largest:.4g} m is far for a landmark"
        options = " or ".join(f"--set landmarks.units.{name}={unit}" for unit in ("cm", "mm", "m"))
        raise DataError(Place(sample.path, 1, 1, f"{message}: say {options}"))
    return 1.0


def check_measured_landmarks(
    data: Path, landmarks: Path, guess: Guess, places: Mapping[str, tuple[float, float]]
) -> None:
    """Raise UserError if a table of landmarks has the place of none that was measured.

    ``data`` is the table of measurements. ``places`` are the landmarks' places, m, by plain label.
    """
    # A landmark is a sensor here. Its name is empty if no column names the landmarks.
    names = [sensor.name for sensor in guess.sensors]
    has_only_landmark = names == [""] and len(places) == 1
    if has_only_landmark or any(plain_label(name) in places for name in names):
        return
    known = first_names([*places], _MOST_NAMES)
    message = f"no column of {data} names the landmarks, which are {known}"
    way = "say which does, --set 'columns.sensor=ITS NAME'"
    if names != [""]:
        measured = first_names(names, _MOST_NAMES)
        message = f"has none of {measured}, which {data} names; there are {known}"
        way = "write the names alike in both files"
    # The mistake is one of the whole file, and stands at its beginning.
    raise UserError(Problem(Mark(str(landmarks), 1, 1), "", f"{message}: {way}"))
