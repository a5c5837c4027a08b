"""Columns of recorded data that a new config does not read, as `trackbench new` lists them."""

from collections.abc import Sequence

_MOST_COLUMNS = 9
"""Unused columns that are named."""


def line_on_unused_columns(columns: Sequence[str], quantities: Sequence[str], prefix: str) -> str:
    """Name the columns of data that a new config does not read, and how one of them may be read.

    ``quantities`` are what a column may have, such as speed; with a speed and a course, these come
    first. The key of the option `--set` begins with the ``prefix``, which names one of several files.
    """
    names = columns_in_words(columns)
    option = f"--set '{prefix}columns.{quantities[0]}=ITS NAME'"
    if {"speed", "course"} <= {*quantities}:
        # Neither is read without the other.
        quantities = ["speed and course, which need each other", *quantities[2:]]
        option += f" --set '{prefix}columns.course=ITS NAME'"
    words = quantities[-1]
    if len(quantities) > 1:
        words = f"{', '.join(quantities[:-1])} or {quantities[-1]}"
    purpose = f"to use one as {words}"
    return f"columns not used: {names} ({purpose}: {option})"


def columns_in_words(columns: Sequence[str]) -> str:
    """List the names of columns, the first `_MOST_COLUMNS` of many."""
    names = ", ".join(columns[:_MOST_COLUMNS])
    if len(columns) > _MOST_COLUMNS:
        names += f" and {len(columns) - _MOST_COLUMNS} more"
    return names
