"""Spelling of labels: 7, 7.0 and 007 are one label, and so are run 7 and Run-007."""

import re
from collections.abc import Sequence

_WHOLE_NUMBER = re.compile(r"0*(?P<digits>\d+)(\.0*)?")


def plain_label(cell: str) -> str:
    """Return a label that is a whole number without its point and leading zeros: 7 of 7.0 and of 007.

    Any other label is returned as it is.
    """
    number = _WHOLE_NUMBER.fullmatch(cell.strip())
    if number is None:
        return cell
    return number["digits"]


def word_of_label(label: str, words: Sequence[str]) -> str:
    """Return the only one of the words that is the label as a number, 7.0 of 7; else the label."""
    equal = [word for word in words if plain_label(word) == plain_label(label)]
    return equal[0] if len(equal) == 1 else label


def plain_spelling(name: str) -> str:
    """Return a run's name without zeros before numbers, signs and capital letters.

    The name Run-007 becomes ``run 7``.
    """
    words = []
    for word in re.findall(r"[^\W\d_]+|[0-9]+", name.casefold()):
        if word.isdigit():
            word = word.lstrip("0") or "0"
        words.append(word)
    return " ".join(words)
