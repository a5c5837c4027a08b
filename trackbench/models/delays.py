"""Delays of a sensor's measurements, and a filter's treatments of late measurements."""

from abc import abstractmethod
from dataclasses import dataclass
from math import ceil, log
from typing import Annotated, Literal, TypeAlias

import numpy as np
from annotated_types import Interval

from trackbench.core import elementary
from trackbench.core.arrays import Array, Index
from trackbench.field_types import MOST_STEPS, ByKind, Count, InvalidKeyError, Natural, Share, Steps

_ONE = 1e-9  # by which shares may differ from one in sum
_RARE = 1e-3  # share of the measurements that may be later than `longest`


@dataclass(frozen=True, kw_only=True)
class Delay:
    """Base of the laws of a delay: the number of steps, drawn for each measurement."""

    @abstractmethod
    def steps(self, u: Array) -> Array:
        """Transform uniform variates to whole numbers of steps.

        Parameters
        ----------
        u : array (...)
            Variates in [0, 1), one for each measurement.

        Returns
        -------
        array (...)
            Number of steps by which each measurement is late, as whole floating-point numbers.
        """

    @property
    @abstractmethod
    def shortest(self) -> int:
        """Number of steps that every measurement is late by at least."""

    @property
    @abstractmethod
    def longest(self) -> int:
        """Number of steps that at most one measurement in a thousand is later than."""


@dataclass(frozen=True, kw_only=True)
class UniformDelay(Delay):
    """All numbers of steps in a range, equally often."""

    kind: Literal["uniform"] = "uniform"
    """every number of steps in a range"""
    least: Natural = 0
    """smallest number of steps"""
    most: Steps
    """largest number of steps"""

    def __post_init__(self) -> None:
        if self.least > self.most:
            raise InvalidKeyError(f"{self.least} is more than `most`, {self.most}", "least")

    def steps(self, u: Array) -> Array:
        """Compute ``least + floor(u n)``, n numbers."""
        return self.least + np.floor(u * (self.most - self.least + 1))

    @property
    def shortest(self) -> int:
        """The smallest number."""
        return self.least

    @property
    def longest(self) -> int:
        """The largest number."""
        return self.most


@dataclass(frozen=True, kw_only=True)
class GeometricDelay(Delay):
    """A number of steps with a geometric law: P(n or more) = (mean / (1 + mean))^n."""

    kind: Literal["geometric"] = "geometric"
    """numbers of steps with an exponential tail"""
    mean: Annotated[float, Interval(gt=0.0, le=1e5)]
    """mean number of steps"""

    def steps(self, u: Array) -> Array:
        """Compute ``floor(log(1 - u) / log q)``, q = mean / (1 + mean)."""
        q = np.array(self.mean / (1.0 + self.mean))
        return np.asarray(np.floor(elementary.log(1.0 - u) / elementary.log(q)))

    @property
    def shortest(self) -> int:
        """Zero, which has the largest probability."""
        return 0

    @property
    def longest(self) -> int:
        """The least n with P(n or more) <= 0.001."""
        return ceil(log(_RARE) / log(self.mean / (1.0 + self.mean)))


@dataclass(frozen=True, kw_only=True)
class SharesDelay(Delay):
    """Numbers of steps with a share each."""

    kind: Literal["shares"] = "shares"
    """numbers of steps by a list"""
    shares: tuple[Share, ...]
    """share of the measurements that are 0, 1, 2, ... steps late"""

    def __post_init__(self) -> None:
        if abs(sum(self.shares) - 1.0) > _ONE:
            message = f"sum to {sum(self.shares):g}; the shares of 0, 1, 2, ... steps sum to 1"
            raise InvalidKeyError(message, "shares")

    def steps(self, u: Array) -> Array:
        """Return the number of cumulative shares that are at most u."""
        ends = np.cumsum(self.shares)[:-1]
        return np.asarray(np.searchsorted(ends, u, side="right"), dtype=np.float64)

    @property
    def shortest(self) -> int:
        """The smallest number of steps whose share is not zero."""
        return next(steps for steps, share in enumerate(self.shares) if share > 0.0)

    @property
    def longest(self) -> int:
        """The largest number of steps that has a share."""
        return len(self.shares) - 1


AnyDelay: TypeAlias = (
    Annotated[int, Interval(ge=0, le=MOST_STEPS)]
    | Annotated[UniformDelay | GeometricDelay | SharesDelay, ByKind()]
)
"""A number of steps, or the law of each measurement's."""


def shortest_delay(delay: AnyDelay) -> int:
    """Return the number of steps that every measurement is late by at least."""
    return delay if isinstance(delay, int) else delay.shortest


def longest_delay(delay: AnyDelay) -> int:
    """Return the number of steps that at most one measurement in a thousand is later than."""
    return delay if isinstance(delay, int) else delay.longest


def drawn_steps(delay: AnyDelay, u: Array) -> Index:
    """Draw delays in whole steps, one for each of the uniform variates u."""
    if isinstance(delay, int):
        return np.full(u.shape, delay, dtype=np.intp)
    return delay.steps(u).astype(np.intp)


Treatment: TypeAlias = Literal["drop", "apply", "refilter"]


@dataclass(frozen=True, kw_only=True)
class Late:
    """Treatment of a measurement that arrives after its step."""

    kind: Treatment
    """drop; apply: use it as if it were new; refilter: go back to its step and filter again"""
    memory: Count | None = None
    """of refilter: steps that it can go back; later measurements are dropped. Default: to the start"""

    def __post_init__(self) -> None:
        if self.memory is not None and self.kind != "refilter":
            raise InvalidKeyError(f"`{self.kind}` goes back no step; leave it out", "memory")


LATE_COUNTS = frozenset({"arrived_late", "late_dropped"})
"""Series that count a run's measurements: those that arrive late, and those of them that are dropped."""
