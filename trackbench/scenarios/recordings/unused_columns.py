"""Columns of recorded data that a new config does not read: their list, and a question on them."""

from collections.abc import Mapping, Sequence

import numpy as np

from trackbench.errors import first_names
from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.explain_failed_guess import explain_column_of_text
from trackbench.scenarios.recordings.guess_record import ColumnByQuantity, Guess, SensorGuess
from trackbench.scenarios.recordings.guess_table_sample import TableSample
from trackbench.scenarios.recordings.label_column_names import role_of
from trackbench.scenarios.recordings.naming_of_columns import Naming
from trackbench.scenarios.recordings.quantity_keys import COURSE, STAMP_PARTS, VELOCITY
from trackbench.scenarios.recordings.recognize_column_names import looks_like
from trackbench.scenarios.recordings.yaml_values import in_option, quoted

MOST_COLUMNS = 9
"""Unused columns that are named."""
_MOST_CANDIDATES = 4
"""columns that a question offers"""


def line_on_unused_columns(columns: Sequence[str], quantities: Sequence[str], prefix: str) -> str:
    """Name the columns of data that a new config does not read, and how one of them may be read.

    ``quantities`` are what a column may have, such as speed; with a speed and a course, these come
    first. The key of the option `--set` begins with the ``prefix``, which names one of several files.
    """
    names = first_names(columns, MOST_COLUMNS)
    option = f"--set '{prefix}columns.{quantities[0]}=ITS NAME'"
    if {"speed", "course"} <= {*quantities}:
        # Neither is read without the other.
        quantities = ["speed and course, which need each other", *quantities[2:]]
        option += f" --set '{prefix}columns.course=ITS NAME'"
    words = quantities[-1]
    if len(quantities) > 1:
        words = f"{', '.join(quantities[:-1])} or {quantities[-1]}"
    pronoun = "one" if len(columns) > 1 else "it"
    purpose = f"to use {pronoun} as {words}"
    return f"columns not used: {names} ({purpose}: {option})"


def usable_quantities(guess: Guess) -> list[str]:
    """Return quantities that an unused column may have, as the config does not read them yet.

    `Naming.columns` has all quantities that were recognized, and `used_columns` only those that the
    config reads. So a speed may have a column and be unused.
    """
    used = used_columns(guess)
    # A speed is read with a course alone: where one of them has a column, the other one is missing. If
    # both have one, or a velocity was left out, no further column makes a velocity that is read.
    names = [name for name in ("speed", "course") if name not in guess.naming.columns]
    if "velocity" in guess.reasons:
        names = []
    # Without a position no velocity is read, and the column may be a measurement of a radar.
    if not used.keys() & {"x", "latitude"}:
        names = ["range", "azimuth"]
    # The config of a robot reads neither a velocity nor an azimuth.
    if guess.inputs:
        names = []
    names += ["run", "sensor", "received"]
    return [name for name in names if name not in used]


def unused_columns(guess: Guess) -> list[str]:
    """Return the columns of one file that the config does not read, as YAML."""
    return [quoted(" ".join(name.split())) for name in _unused_names(guess)]


def _unused_names(guess: Guess) -> list[str]:
    """Return the columns of one file that the config does not read, as they are called in the file."""
    used = used_columns(guess).values()
    return [name for name in guess.names if name not in used]


def unexplained_columns(guess: Guess) -> list[str]:
    """Return the unused columns, as YAML, but those of a velocity whose note names their option."""
    note = guess.reasons.get("velocity", "")
    unexplained = []
    for name in _unused_names(guess):
        options = [f"'columns.{quantity}={in_option(name)}'" for quantity in (*COURSE, *VELOCITY)]
        if not any(option in note for option in options):
            unexplained.append(quoted(" ".join(name.split())))
    return unexplained


def idle_keys(guess: Guess, user_columns: Mapping[str, str]) -> list[str]:
    """Return the quantities for which the user named a column that the config does not read.

    ``user_columns`` are the named columns by quantity.
    """
    used = used_columns(guess)
    return [key for key, column in user_columns.items() if column and key not in used]


def used_columns(guess: Guess) -> dict[str, str]:
    """Return the columns of a file that the config reads, by their quantities."""
    naming = guess.naming
    # Of measured quantities only those of the guessed sensors are read.
    read = {"time", "date", "step", "received", "run", "sensor", "latitude", "longitude"}
    read |= STAMP_PARTS.keys()
    read |= {"north_south", "east_west"}
    read |= guess.inputs.keys()
    if guess.measures_velocity:
        read |= {"vx", "vy", "speed", "course"}
    for sensor in guess.sensors:
        read.update(sensor.quantities)
    # Latitude and longitude are read only for a position without columns of its own.
    if {"x", "y"} <= naming.columns.keys() or not read & {"x", "y"}:
        read -= {"latitude", "longitude", "north_south", "east_west"}
    return {name: column for name, column in naming.columns.items() if name in read}


def check_unused(
    sample: TableSample, columns: ColumnByQuantity, sensors: list[SensorGuess], user_naming: Naming
) -> None:
    """Raise DataError if only angles are read and a column may be the range, or the reverse.

    There are two cases. The column of the other quantity is known by its name, and has text in place of
    numbers. Or the name of an unused column has a word or a unit of the other quantity. There is no
    error if ``user_naming`` already names the column, or says by an empty name that there is none.
    ``columns`` are the columns by quantity.
    """
    if len(sensors) > 1:
        return
    # The second quantity that a sensor of each type may measure, too.
    other_part = {"bearing": "range", "range": "azimuth", "landmark-bearing": "range"}
    quantity = other_part.get(sensors[0].kind)
    if quantity is None or quantity in user_naming.columns:
        return
    # Case 1: the column of the other quantity has text. An empty name leaves its cells out.
    mistake = explain_column_of_text(columns.get(quantity, ""), sample)
    if mistake is not None:
        remedy = f"or say --set 'columns.{quantity}=\"\"' to leave them out"
        raise DataError(mistake._replace(message=f"{mistake.message}; {remedy}"))
    # Case 2: the name of an unused column has a word or a unit of the other quantity.
    candidates = []
    for name in sample.names:
        has_numbers = np.isfinite(sample.numbers(name)).any()
        if name in columns.values() or not has_numbers or role_of(name) == "quality":
            continue
        if looks_like(name, quantity):
            candidates.append(in_option(name))
    if candidates:
        candidates = candidates[:_MOST_CANDIDATES]
        measured = columns[sensors[0].quantities[-1]]
        options = " or ".join(f"--set 'columns.{quantity}={name}'" for name in candidates)
        doubt = f"is {' or '.join(candidates)} the {quantity}?"
        message = f"only {measured} is recognized as measured; {doubt}"
        remedy = f"Say {options}, or --set 'columns.{quantity}=\"\"' if none is"
        raise DataError(Place(sample.path, 1, 1, f"{message} {remedy}"))


def why_idle(guess: Guess, quantity: str) -> str:
    """Explain that no sensor of the config would read a quantity whose column the user names."""
    if quantity in (*COURSE, *VELOCITY) and "velocity" in guess.reasons:
        return guess.reasons["velocity"]
    kinds = dict.fromkeys(f"`{sensor.kind}`" for sensor in guess.sensors)
    message = (
        f"no sensor of the config would read {quantity}: it has {' and '.join(kinds)}; leave it out"
    )
    other = {"speed": "course", "course": "speed"}.get(quantity)
    if other is None or other in guess.naming.columns:
        return message
    return f"{message}, or name a {other}, too: a speed and a course together measure the velocity"
