"""Error of a filter at a given CPU time, interpolated between two of its sizes.

Between two of a filter's sizes the logarithm of its error is linear in the logarithm of its CPU time, as
it is wherever the error falls with a power of the number of particles. Three things make that uncertain:
the errors at both ends, which all filters share with their runs; the times at both ends and the one that
is asked for; and that the error is not linear there. The last is the next term of Newton's interpolation
formula, with the nearest further size on either side, the larger of both (Abramowitz and Stegun 1964,
25.2.4 and 25.1.4).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.elementary import exp, log
from trackbench.statistics.comparison import Comparison, compare_estimates
from trackbench.statistics.estimates import RunEstimate, ignore_float_errors, linear_combination


class Spot(NamedTuple):
    """A filter at one of its sizes, its number of particles."""

    size: float
    """the filter's key that buys accuracy with time; NaN if the filter has no such key"""
    cost: RunEstimate
    """CPU time per step, s"""
    error: RunEstimate
    lost: Array
    """why each run (M,) is lost, 0 where it is not"""


class AtCost(NamedTuple):
    """A filter at a cost, between two of its sizes or at one."""

    size: float
    error: RunEstimate
    """logarithm of the error, with each run's influence and the error of the runs alone"""
    stderr_of_times: float = 0.0
    """standard error of the same by the times at both ends and the one that is asked for"""
    curvature: float = 0.0
    """size of what the interpolation leaves out; NaN if there are no three sizes"""
    lost: Array = np.empty(0)
    """why each run (M,) is lost at either size, 0 where it is not"""

    @property
    def other_stderr(self) -> float:
        """Standard error that the times and the interpolation add to that of the runs."""
        return float(np.hypot(self.stderr_of_times, self.curvature))


@dataclass(frozen=True)
class Curve:
    """A filter over its sizes, the smallest first; a single one if it has none."""

    label: str
    spots: tuple[Spot, ...]
    name: str = ""
    """the label, with what else varies of the filter"""

    @property
    def is_fixed(self) -> bool:
        """True if the filter has a single size, hence a single cost."""
        return len(self.spots) == 1

    def error_at(self, cost: RunEstimate) -> AtCost | None:
        """Return the error at a CPU time per step.

        If several sizes take that time, the largest counts. A filter with a single size is fixed: it has
        the same error at every time above its own.

        Parameters
        ----------
        cost
            CPU time per step in s, with its error

        Returns
        -------
        AtCost or None
            filter at this cost, with the logarithm of its error; None if its own times do not reach it
        """
        # Case 1: the cost is that of one of the sizes, as the very object of its spot.
        for spot in self.spots:
            if spot.cost is cost:
                return AtCost(size=spot.size, error=logarithm(spot.error), lost=spot.lost)
        # Case 2: there is a single size, which a smaller budget does not pay for.
        if self.is_fixed:
            (spot,) = self.spots
            if spot.cost.value > cost.value:
                return None
            return AtCost(size=spot.size, error=logarithm(spot.error), lost=spot.lost)
        # Case 3: the cost lies between those of two neighboring sizes.
        log_costs = [float(log(spot.cost.value)) for spot in self.spots]
        log_cost = float(log(cost.value))
        # Times need not grow with the size: of several intervals the one of the largest sizes counts.
        for left in reversed(range(len(log_costs) - 1)):
            ends = log_costs[left : left + 2]
            if min(ends) <= log_cost <= max(ends) and ends[0] != ends[1]:
                cost_stderr = logarithm(cost).stderr
                return self._interpolate(left, log_costs, log_cost, cost_stderr)
        return None

    @ignore_float_errors
    def _interpolate(
        self, left: int, log_costs: Sequence[float], log_cost: float, cost_stderr: float
    ) -> AtCost:
        """Interpolate the logarithm of the error between the sizes of index ``left`` and ``left + 1``.

        ``log_costs`` are the logarithms of the times of all sizes. ``log_cost`` is the logarithm of the
        time at which the error is wanted, and ``cost_stderr`` its standard error.
        """
        right = left + 1
        a = self.spots[left]
        b = self.spots[right]
        x = log_costs
        y = [logarithm(spot.error) for spot in self.spots]
        # y = (1 - share) y_a + share y_b
        share = (log_cost - x[left]) / (x[right] - x[left])
        value = (1.0 - share) * y[left].value + share * y[right].value
        error = linear_combination(value, y[left], y[right], 1.0 - share, share)
        # An error of the times changes the logarithm of the error by the line's slope.
        slope = (y[right].value - y[left].value) / (x[right] - x[left])
        stderr_a = (1.0 - share) * logarithm(a.cost).stderr
        stderr_b = share * logarithm(b.cost).stderr
        stderr_of_times = abs(slope) * float(np.sqrt(cost_stderr**2 + stderr_a**2 + stderr_b**2))
        # The error of linear interpolation is estimated by the quadratic term of Newton's formula, with
        # the next size to the left and with that to the right; the larger of both counts.
        next_terms = []
        for first in (left - 1, left):
            if 0 <= first < len(x) - 2:
                second_difference = _second_difference(x, y, first)
                next_term = second_difference * (log_cost - x[left]) * (log_cost - x[right])
                next_terms.append(abs(next_term))
        log_size_a = float(log(a.size))
        log_size_b = float(log(b.size))
        return AtCost(
            size=float(exp((1.0 - share) * log_size_a + share * log_size_b)),
            error=error,
            stderr_of_times=stderr_of_times,
            curvature=max(next_terms, default=np.nan),
            # A code above 0 says why a run is lost: a run counts only if it has 0 at both sizes.
            lost=np.maximum(a.lost, b.lost),
        )


@ignore_float_errors
def logarithm(term: RunEstimate) -> RunEstimate:
    """Return the logarithm of a positive number, with its error (delta method)."""
    return term.scaled(float(log(term.value)), divisor=term.value)


def _second_difference(x: Sequence[float], y: Sequence[RunEstimate], i: int) -> float:
    """Return Newton's divided difference ``y[x_i, x_i+1, x_i+2]`` of the values y at the places x.

    It is infinite or NaN if two of the places are equal.
    """
    first = np.divide(y[i + 1].value - y[i].value, x[i + 1] - x[i])
    second = np.divide(y[i + 2].value - y[i + 1].value, x[i + 2] - x[i + 1])
    return float((second - first) / (x[i + 2] - x[i]))


def compare_at(a: AtCost, b: AtCost) -> Comparison:
    """Compare the logarithms of two errors; times and interpolation add to the standard error."""
    return compare_estimates(a.error, b.error, float(np.hypot(a.other_stderr, b.other_stderr)))
