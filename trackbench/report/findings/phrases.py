"""Numbers, labels and lists of names as they stand in a sentence."""

from collections.abc import Sequence
from typing import Any

from trackbench.errors import joined as joined  # for sentences of a report, as those below
from trackbench.field_types import is_number

MOST_NAMES = 4
"""Names that a list in a sentence has at most; longer lists are cut."""


def percent(share: float) -> str:
    """Write a share in percent with two digits: ``2.3 %``, ``350 %``."""
    return f"{rounded(100 * share, 2)} %"


def rounded(x: float, digits: int) -> str:
    """Write a number with so many digits: ``1.6``, ``13``, ``5800``."""
    return f"{float(f'{x:.{digits}g}'):g}"


def named(label: str) -> str:
    """Return a label as it stands in a sentence: one with a comma in quotes."""
    if "," in label:
        return f"\u201c{label}\u201d"
    return label


def listed(names: Sequence[str]) -> str:
    """Return ``A, B and C``; of many names the first ``MOST_NAMES``: ``A, B, C, D and 3 more``."""
    more = len(names) - MOST_NAMES
    if more > 1:  # one more name is no longer than "1 more"
        return joined([*names[:MOST_NAMES], f"{more} more"])
    return joined(names)


def verb(names: Sequence[str]) -> str:
    """Return "is" for one name and "are" for several."""
    return "is" if len(names) == 1 else "are"


def number(value: Any) -> str:
    """Return a grid's value: six digits of a number, words and truth values as they are.

    A whole number of more digits keeps all of them, as it may name something: the ship of an MMSI, the
    seed of a run.
    """
    if not is_number(value):
        return str(value)
    text = f"{value:g}"
    if isinstance(value, int) and float(text) != value:
        return str(value)
    return text
