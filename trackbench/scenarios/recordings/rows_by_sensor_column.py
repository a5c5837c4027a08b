"""Rows of a table by sensor, as the words in the column `sensor` divide them."""

import json
from collections.abc import Collection, Sequence

import numpy as np

from trackbench.core.arrays import Mask
from trackbench.errors import counted, form_for
from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.label_spelling import word_of_label
from trackbench.scenarios.recordings.parse_tables import Table
from trackbench.scenarios.recordings.quantities_from_columns import Columns
from trackbench.scenarios.recordings.rows_and_reading_context import ReadingContext


def find_sensor_rows(
    context: ReadingContext,
    columns: Columns,
    table: Table,
    column: str,
    m: int,
    sensor_count: int,
    sensor_names: Sequence[str],
) -> Mask:
    """Return a mask (R,) of the rows of sensor m, counted from 0, of ``sensor_count`` sensors.

    The ``column`` has the sensors' ``sensor_names``, or their numbers from 1 on if ``sensor_names`` is
    empty. Raises DataError if it lacks one of the names, or has numbers of other sensors than those of
    the config.
    """
    words = [word for word in table.words[column] if word]
    labels = sensor_names or [str(i + 1) for i in range(sensor_count)]
    # The name 7 stands for the word 7.0, too, if the file lacks the word 7.
    free_words = [word for word in words if word not in labels]
    word_of_sensor = [
        label if label in words else word_of_label(label, free_words) for label in labels
    ]
    other_words = [word for word in words if word not in word_of_sensor]
    if other_words and not sensor_names:
        message = f"column {column} names {len(words)} sensors ({', '.join(words[:8])[:80]})"
        remedy = "name them in the order of `sensor`, such as `sensors: "
        remedy += f'[{", ".join(map(json.dumps, words[:8]))}]`; `columns: {{sensor: ""}}` mixes all'
        raise columns.mistake(f"{message}, and the config has {sensor_count}: {remedy}")
    # Without names a number that the file lacks is no mistake: its sensor has no rows here.
    absent = [
        name for name, word in zip(sensor_names, word_of_sensor, strict=False) if word not in words
    ]
    if absent:
        message = f"column {column} has no {absent[0]!r}; there are {', '.join(words[:20])[:200]}"
        raise columns.mistake(message)
    # Rows of other sensors than those of the config are left out.
    if other_words and m == 0:  # noted once for all sensors
        codes = [table.words[column].index(word) for word in other_words]
        left_out = int(np.isin(table.columns[column], codes).sum())
        whose = ", ".join(other_words)[:80]
        verb = form_for(left_out, "was", "were")
        context.notices.append(f"{counted(left_out, 'row')} of {whose} {verb} left out (`sensors`)")
    code = -1  # no row has this code
    if word_of_sensor[m] in words:
        code = table.words[column].index(word_of_sensor[m])
    return np.asarray(table.columns[column] == code)


def check_rows_without_sensor(
    columns: Columns, table: Table, column: str, quantities: Collection[str]
) -> None:
    """Raise DataError for a row that has one of the ``quantities`` and an empty cell in the ``column``.

    The column names the sensor of each row.
    """
    if "" not in table.words[column]:
        return
    is_blank = table.columns[column] == table.words[column].index("")
    for name in quantities:
        source = columns.column(name)
        if source is None:
            continue
        rows = np.flatnonzero(is_blank & np.isfinite(table.columns[source]))
        if len(rows):
            message = f"{column}: is missing beside a value of {source}"
            raise DataError(Place(columns.path, int(table.lines[rows[0]]), 1, message))
