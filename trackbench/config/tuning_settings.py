"""Settings of tuning beside the keys: the metric, the runs, the budget."""

import re
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from annotated_types import Interval

from trackbench.core import elementary
from trackbench.field_types import Count, Finite, is_number

SUFFIX = " (tuned)"
"""What the label of a tuned filter ends with."""


def tuned_label(label: str) -> str:
    """Label of the tuned filter beside this one."""
    return label + SUFFIX


@dataclass(frozen=True, kw_only=True)
class Tuning:
    """By what filters are tuned, on how many runs, and how often each may try."""

    metric: str | dict[str, Finite] | None = None
    """what is made small over the training runs: `rms(rmse_position)`; `anees`, its distance to 1;
    `log_score`, made large; or a sum by weights, {rms(rmse_position): 1, anees: 20}; default: the rms
    of the first error, `log_score` of data without a truth"""
    runs: Count = 100
    """training runs, the same for every filter, none of which is a run of the results"""
    evaluations: Annotated[int, Interval(ge=2, le=10_000)] = 40
    """how many values of its keys each filter may try"""
    scenario: dict[str, Any] | None = None
    """what training simulates in place of the scenario: keys laid over it, {target: {kind: random-legs,
    ...}}, a path, or {use: path, key: value}; default: the scenario itself"""


_NUMBER = r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?"
RANGE = rf"(log:)?({_NUMBER})\.\.({_NUMBER})"
"""Pattern of the ends of an axis, linear or logarithmic."""
_DIGITS = 4
_FARTHEST = 1e100
"""Largest end of a range, and inverse of the smallest of a logarithmic one, for the figures' sake."""


@dataclass(frozen=True)
class Axis:
    """A key and its values, laid out over the shares from 0 to 1.

    Numbers are rounded to four digits: so many are seen in an error at most, and a last bit of the
    search makes no other filter.
    """

    key: str
    low: float = 0.0
    high: float = 0.0
    log: bool = False
    whole: bool = False
    choices: tuple[Any, ...] = ()

    def at(self, share: float) -> Any:
        """Return the value at a share; beyond 0 and 1 that at the end."""
        share = min(max(share, 0.0), 1.0)
        if self.choices:
            return self.choices[min(int(share * len(self.choices)), len(self.choices) - 1)]
        if share in (0.0, 1.0):
            value = self.high if share else self.low
            return round(value) if self.whole else value
        if self.log:
            logs = elementary.log(np.array([self.low, self.high]))
            value = float(elementary.exp(logs[:1] + share * (logs[1:] - logs[:1]))[0])
        else:
            value = self.low + share * (self.high - self.low)
        value = min(max(float(f"{value:.{_DIGITS}g}"), self.low), self.high)
        return round(value) if self.whole else value

    def share(self, value: Any) -> float | None:
        """Return the place of a value on the axis; None if it is outside."""
        if self.choices:
            places = [i for i, choice in enumerate(self.choices) if choice == value]
            return (places[0] + 0.5) / len(self.choices) if places else None
        if not is_number(value) or not self.low <= value <= self.high:
            return None
        if not self.log:
            return (value - self.low) / (self.high - self.low)
        low, x, high = elementary.log(np.array([self.low, value, self.high])).tolist()
        return (x - low) / (high - low)

    @property
    def grain(self) -> float:
        """Return shares that are nearer than this to each other may be the same value."""
        if self.choices:
            return 1.0 / len(self.choices)
        return 1.0 / (self.high - self.low) if self.whole and not self.log else 0.0


def read_axis(key: str, written: Any) -> Axis:
    """Return the axis of a key; raises ValueError in words."""
    if isinstance(written, list):
        if len(written) < 2:
            raise ValueError("a list of choices has at least two")
        if any(value in written[:i] for i, value in enumerate(written)):
            raise ValueError("a choice is given twice")
        return Axis(key, choices=tuple(written))
    match = re.fullmatch(RANGE, written) if isinstance(written, str) else None
    if match is None:
        raise ValueError(f"{written!r}: write a..b, log:a..b or a list of choices")
    log, low, high = bool(match.group(1)), float(match.group(2)), float(match.group(3))
    if not low < high or not np.isfinite([low, high]).all():
        raise ValueError(f"{written!r} does not rise from a number to a larger one")
    if log and low <= 0.0:
        raise ValueError(f"{written!r}: a logarithmic range has ends above zero")
    if max(-low, high) > _FARTHEST or (log and low < 1.0 / _FARTHEST):
        raise ValueError(f"{written!r} is too wide; ends of up to 1e100, or log:1e-100..1e100")
    return Axis(key, low, high, log)
