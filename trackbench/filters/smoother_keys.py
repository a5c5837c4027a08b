"""Key `smooth`: all measurements or a fixed lag; base of the filters that have this key."""

from dataclasses import dataclass
from typing import Protocol

from trackbench.field_types import Count
from trackbench.filters.base import Filter, State


@dataclass(frozen=True, kw_only=True)
class FixedLag:
    """A smoother that estimates a step once a fixed number of later measurements is there."""

    lag: Count
    """number of later measurements that an estimate uses"""


class HasLag(Protocol):
    """A smoother with a key ``lag``."""

    @property
    def lag(self) -> int | None:
        """Number of later measurements that an estimate uses, or None for all."""


class SmoothingFilter(Filter[State]):
    """Base of the filters with the key ``smooth``."""

    smooth: bool | HasLag

    @property
    def smooths(self) -> bool:
        """True if the key ``smooth`` is set."""
        return self.smooth is not False

    @property
    def lag(self) -> int | None:
        """Number of later measurements that an estimate uses, or None for all."""
        if isinstance(self.smooth, bool):
            return None
        return self.smooth.lag
