"""What verify finds in a folder, and what that makes of it."""

from collections.abc import Sequence
from typing import NamedTuple

SAME, ROUNDING, CHANGED = "the same bytes", "the same but for rounding", "changed"


class Finding(NamedTuple):
    """What differs, in a line, and whether another processor or library may have done it."""

    text: str
    is_rounding: bool


def changed(text: str) -> Finding:
    """What rounding cannot explain."""
    return Finding(text, False)


def rounding(text: str) -> Finding:
    """What it can."""
    return Finding(text, True)


def verdict(findings: Sequence[Finding]) -> str:
    """One of three: only the last of them is a failure."""
    if not findings:
        return SAME
    return ROUNDING if all(finding.is_rounding for finding in findings) else CHANGED
