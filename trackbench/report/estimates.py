"""A measured number with its error, one influence per run where it can, and how two become one."""

from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array, Mask
from trackbench.evaluation import binomial
from trackbench.evaluation.binomial import Events, stderr_of
from trackbench.evaluation.difference_intervals import (
    Sides,
    correlation,
    interval_of_difference,
    of_variances,
    studentised_difference,
)
from trackbench.evaluation.intervals import (
    interval_of,
    quantile,
    studentised,
)
from trackbench.evaluation.statistics import Estimate, influence_of_ratio, mean, z_score
from trackbench.report.lost_runs import in_words

# A filter that left the numbers has infinite statistics; they are shown, not warned about.
quietly = np.errstate(all="ignore")


class Term(NamedTuple):
    """A number, its standard error, and each run's influence (M,) if it has one; runs and lost runs."""

    value: float
    stderr: float
    influences: Array | None
    runs: int
    lost: int = 0
    pair: "tuple[Term, Term, float] | None" = None
    """a, b and f of a difference a - f b that is tested by the limits of both"""

    @property
    def estimate(self) -> Estimate:
        """Return the value and standard error."""
        return Estimate(self.value, self.stderr)

    def scaled(self, value: float, by: float = 1.0, over: float = 1.0) -> "Term":
        """Return an estimate of another value that changes by a multiple of this one's changes."""
        of_runs = None if self.influences is None else self.influences * by / over
        return self._replace(value=value, stderr=self.stderr * abs(by) / over, influences=of_runs)

    @property
    def splits(self) -> bool:
        """Return whether batches of runs have numbers of their own."""
        return self.influences is not None

    @property
    def losses(self) -> str:
        """Return the number of lost runs in words; empty for none."""
        return in_words(self.lost, self.runs + self.lost) if self.lost else ""

    @property
    def sides(self) -> Sides | None:
        """Return limits of both numbers of a difference that is tested by them."""
        if self.pair is None:
            return None
        a, b, factor = self.pair
        assert a.influences is not None
        assert b.influences is not None
        others = factor * b.influences
        if not isinstance(a, Share) or not isinstance(b, Share):
            return of_variances(a.influences, others)
        first, second = Events(a.events, a.runs), Events(b.events, b.runs, factor)
        return Sides(first, second, correlation(a.influences, others))

    def parts(self, number: int) -> "list[Term]":
        """Return the number without each of so many batches of consecutive runs in turn.

        To first order in the influences; exact for means and shares. Empty if it has none.
        """
        if self.influences is None or number < 2:
            return []
        M = len(self.influences)
        batch = np.arange(M) * number // M
        return [self._over(batch != i) for i in range(number)]

    def stressed(self) -> "list[Term]":
        """Return the number without its farthest run, and with three more twice as far off.

        An event that none of M runs had may have a probability of 3 / M. A share's test counts that.
        """
        x = None if self.influences is None else self.influences[~np.isnan(self.influences)]
        if x is None or len(x) < 3 or self._is_of_shares:
            return []
        far = int(np.argmax(np.abs(x)))
        more = np.append(x, np.full(3, 2.0 * x[far]))
        return [self._made_by(np.delete(x, far)), self._made_by(more)]

    @property
    def _is_of_shares(self) -> bool:
        return isinstance(self if self.pair is None else self.pair[0], Share)

    def _over(self, rows: Mask) -> "Term":
        """Return the number of some of the runs."""
        assert self.influences is not None
        term = self._made_by(self.influences[rows])
        if self.pair is None:
            return term
        a, b, factor = self.pair
        return term._replace(pair=(a._over(rows), b._over(rows), factor))

    @quietly
    def _made_by(self, influences: Array) -> "Term":
        """Return the number of runs with these influences on this one."""
        x = influences[~np.isnan(influences)]
        shift, stderr = mean(x)
        found = self._replace(value=self.value + shift, stderr=stderr, runs=len(x), pair=None)
        return found._replace(influences=influences - shift)

    def z(self, target: float = 0.0, other: float = 0.0) -> float:
        """Return z of the hypothesis that the number is the target with standard error ``other``."""
        with np.errstate(all="ignore"):
            if self.influences is None:
                return z_score(Estimate(self.value - target, np.hypot(self.stderr, other)))
            sides = self.sides
            if sides is not None:
                return studentised_difference(self.value - target, sides, other)
            return studentised(self.value - target, self.influences, other)

    def interval(self, level: float = 0.95, other: float = 0.0) -> tuple[float, float]:
        """Return the confidence interval: all targets that `z` accepts; NaN without an error."""
        with np.errstate(all="ignore"):
            if self.influences is None:
                width = quantile(level, np.inf) * float(np.hypot(self.stderr, other))
                return self.value - width, self.value + width
            sides = self.sides
            if sides is not None:
                return interval_of_difference(self.value, sides, level, other)
            return interval_of(self.value, self.influences, level, other)


class Share(Term):
    """A share of runs: its z and its interval are those of the binomial distribution."""

    __slots__ = ()

    @property
    def events(self) -> int:
        """Return runs that have had the event."""
        return round(self.value * self.runs)

    def z(self, target: float = 0.0, other: float = 0.0) -> float:
        """Return z of the hypothesis that the event has this probability."""
        if other > 0.0 or not self.runs:
            return super().z(target, other)
        return binomial.z(self.events, self.runs, target)

    def interval(self, level: float = 0.95, other: float = 0.0) -> tuple[float, float]:
        """Return the interval of Clopper and Pearson; normal beside another error."""
        if other > 0.0 or not self.runs:
            return super().interval(level, other)
        return binomial.interval(self.events, self.runs, level)


MISSING = Term(np.nan, np.nan, None, 0)


@quietly
def quotient(a: Term, b: Term) -> Term:
    """Return ``a / b``, paired where it can be; else by the delta method."""
    ratio, scale = (float(np.divide(x, b.value)) for x in (a.value, 1.0))
    term, of_a, of_b = together(ratio, a, b, scale, -scale * ratio), a.influences, b.influences
    if of_a is None or of_b is None or not term.splits:
        return term
    influences = influence_of_ratio(a.value, b.value, of_a, of_b)
    stderr = mean(influences[~np.isnan(influences)]).stderr
    return term._replace(influences=influences, stderr=stderr)


@quietly
def gain(ratio: Term) -> Term:
    """Return the percent by which the ratio is below one."""
    return ratio.scaled(100.0 * (1.0 - ratio.value), by=-100.0)


@quietly
def together(value: float, a: Term, b: Term, of_a: float, of_b: float) -> Term:
    """Return the estimate of ``of_a`` times a plus ``of_b`` times b, paired by runs."""
    runs, of_runs = min(a.runs, b.runs), _combined(a, b, a.influences, b.influences, of_a, of_b)
    if of_runs is not None:
        there = of_runs[~np.isnan(of_runs)]
        return Term(value, mean(there).stderr, of_runs, len(there), a.lost)
    stderr = float(np.hypot(of_a * a.stderr, of_b * b.stderr))
    return Term(value, stderr, None, runs, a.lost)


def _combined(
    a: Term, b: Term, x: Array | None, y: Array | None, of_a: float, of_b: float
) -> Array | None:
    """Return ``of_a x + of_b y`` of influences; None if a side has none and is inexact."""
    if x is None and y is not None and a.stderr == 0.0:
        return of_b * y
    if y is None and x is not None and b.stderr == 0.0:
        return of_a * x
    if x is None or y is None or len(x) != len(y):
        return None
    return of_a * x + of_b * y


def apart_by_variances(term: Term, a: Term, b: Term, factor: float) -> Term:
    """Return the difference ``a - factor b`` of variances, tested by the limits of both."""
    if term.influences is None or a.influences is None or b.influences is None:
        return term
    return term._replace(pair=(a, b, factor))


def apart_by_shares(term: Term, a: Share, b: Share, factor: float) -> Term:
    """Return the difference ``a - factor b`` of shares of the same runs, tested by both limits."""
    if a.influences is None or b.influences is None:
        return term
    apart = term._replace(pair=(a, b, factor))
    return apart._replace(stderr=term.stderr or stderr_of(*apart.interval()))
