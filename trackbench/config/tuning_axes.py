"""Values of a tuned key: a range, linear or logarithmic, or choices; rounded to four digits."""

import re
from dataclasses import dataclass

import numpy as np

from trackbench.core import elementary
from trackbench.field_types import is_number

_NUMBER = r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?"
RANGE = rf"(log:)?({_NUMBER})\.\.({_NUMBER})"
"""Pattern of the ends of an axis, linear or logarithmic."""
_DIGITS = 4
_FARTHEST = 1e100
"""Largest end of a range, and inverse of the smallest of a logarithmic one, for the figures' sake."""


@dataclass(frozen=True)
class Axis:
    """A tuned key and its values, each at a share of the axis from 0 to 1.

    Numbers are rounded to four digits. More digits would not show in an error, and rounding differences
    of the search then give equal values.
    """

    key: str
    low: float = 0.0
    high: float = 0.0
    log: bool = False
    """whether equal steps of the share are equal ratios of the values"""
    whole: bool = False
    """whether only whole numbers are valid"""
    choices: tuple[object, ...] = ()
    """values of a key that is chosen from a list; such an axis has no ends"""

    def at(self, share: float) -> object:
        """Return the value at a share of the axis; a share outside 0 to 1 has the value of the end."""
        share = min(max(share, 0.0), 1.0)
        if self.choices:
            # Equal parts of the axis; a share of 1 belongs to the last choice.
            index = int(share * len(self.choices))
            return self.choices[min(index, len(self.choices) - 1)]
        # Step 1: the value; both ends exactly as written, whatever their digits.
        if share == 0.0:
            value = self.low
        elif share == 1.0:
            value = self.high
        else:
            value = self._between_ends(share)
        # Step 2: a whole number where no other is valid.
        if self.whole:
            return round(value)
        return value

    def _between_ends(self, share: float) -> float:
        """Return low^(1 - s) high^s on a logarithmic axis, low + s (high - low) on a linear one."""
        if self.log:
            # These functions have the same last bit on every machine. Here they get arrays of one value.
            logs = elementary.log(np.array([self.low, self.high]))
            log_low = logs[:1]
            log_high = logs[1:]
            value = float(elementary.exp(log_low + share * (log_high - log_low))[0])
        else:
            value = self.low + share * (self.high - self.low)
        # Four digits, which may round beyond an end.
        rounded = float(f"{value:.{_DIGITS}g}")
        return min(max(rounded, self.low), self.high)

    def share(self, value: object) -> float | None:
        """Return the share of the axis at which a value lies; None if the axis does not have it."""
        if self.choices:
            for i, choice in enumerate(self.choices):
                if choice == value:
                    # The middle of the choice's part of the axis.
                    return (i + 0.5) / len(self.choices)
            return None
        if not is_number(value) or not self.low <= value <= self.high:
            return None
        if not self.log:
            return (value - self.low) / (self.high - self.low)
        low, x, high = elementary.log(np.array([self.low, value, self.high])).tolist()
        return (x - low) / (high - low)

    @property
    def grain(self) -> float:
        """Distance of two shares below which both may give one choice or one whole number.

        A share is a place on the axis, from 0 to 1. The grain is 0 for other axes, also for whole
        numbers on a logarithmic axis, whose distances differ. The first steps of the search are at least
        as long as the grain.
        """
        if self.choices:
            return 1.0 / len(self.choices)
        if self.whole and not self.log:
            return 1.0 / (self.high - self.low)
        return 0.0


def read_axis(key: str, written: object) -> Axis:
    """Read the axis of a key from a config: a list of choices, ``a..b`` or ``log:a..b``.

    Raises ValueError, with the mistake in words.
    """
    if " & " in key:
        raise ValueError("keys that vary together are of a grid; tune each key under its own name")
    if isinstance(written, list):
        if len(written) < 2:
            raise ValueError("a list of choices has at least two")
        if any(isinstance(value, dict | list) for value in written):
            message = "a choice is a word or a number; tune keys within it"
            raise ValueError(f"{message}, as {key}.kind: [A, B]")
        if any(value in written[:i] for i, value in enumerate(written)):
            raise ValueError("a choice is given twice")
        return Axis(key, choices=tuple(written))
    match = None
    if isinstance(written, str):
        match = re.fullmatch(RANGE, written)
    if match is None:
        raise ValueError(f"{written!r}: write a..b, log:a..b or a list of choices")
    log = bool(match.group(1))
    low = float(match.group(2))
    high = float(match.group(3))
    if not low < high or not np.isfinite([low, high]).all():
        raise ValueError(f"{written!r} does not rise from a number to a larger one")
    if log and low <= 0.0:
        raise ValueError(f"{written!r}: a logarithmic range has ends above zero")
    if max(-low, high) > _FARTHEST or (log and low < 1.0 / _FARTHEST):
        raise ValueError(f"{written!r} is too wide; ends of up to 1e100, or log:1e-100..1e100")
    return Axis(key, low, high, log)
