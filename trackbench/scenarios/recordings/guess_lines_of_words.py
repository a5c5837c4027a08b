"""Guess of the lines of words, such as units, between the names of columns and the first values."""

from trackbench.scenarios.recordings.header_line import is_value

_MOST_LINES_OF_WORDS = 5


def lines_of_words(rows: list[list[str]]) -> int:
    """Return the number of rows, such as one of units, that have words alone and stand above all values.

    It is 0 if there are more than `_MOST_LINES_OF_WORDS`, or if one of them is empty.
    """
    for count, row in enumerate(rows[: _MOST_LINES_OF_WORDS + 1]):
        if any(map(is_value, row)):
            return count
        if not any(map(str.strip, row)):
            return 0
    return 0
