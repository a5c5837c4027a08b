"""Numbers, labels and lists of names as they stand in a sentence."""

from collections.abc import Sequence
from math import ceil, inf, log10
from typing import Any

from trackbench.errors import joined as joined  # for sentences of a report, as those below
from trackbench.field_types import is_number

MOST_NAMES = 4
"""Names that a list in a sentence has at most; longer lists are cut."""
_BELOW_TEN = 9.95
"""Ratio up to which a decimal does not round it to ten."""


def percent(share: float) -> str:
    """Write a share in percent with two digits: ``2.3 %``, ``350 %``."""
    return f"{rounded(100 * share, 2)} %"


def rounded(x: float, digits: int) -> str:
    """Write a number with so many digits: ``1.6``, ``13``, ``5800``."""
    return f"{float(f'{x:.{digits}g}'):g}"


def multiple(ratio: float, width: float) -> str:
    """Write a ratio with the digits that its interval allows, three decimals at most: ``3.2``.

    ``width`` is that of the interval; if it is unknown or infinite, the ratio has three digits. Only a
    ratio that these would round to 1 has three decimals, as ``1`` would mean equal errors. With an
    interval a ratio below ten has a decimal in any case, as 2 in place of 1.5 would contradict the
    errors beside it. A ratio of a million or more has two digits and an exponent.
    """
    if abs(ratio) >= 1e6:
        return f"{ratio:.1e}"
    if not 0.0 < width < inf:
        text = rounded(ratio, 3)
        if text == "1" and ratio != 1.0:
            return f"{ratio:.3f}"
        return text
    # The interval is at least three units of the last decimal wide.
    decimals = ceil(log10(3.0 / width))
    fewest = 1 if abs(ratio) < _BELOW_TEN else 0
    return f"{ratio:.{min(3, max(fewest, decimals))}f}"


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
    """Return a grid's value: six digits of a number, words and truth values as they are."""
    if is_number(value):
        return f"{value:g}"
    return str(value)
