"""A measured number of one recording, from the contributions of its steps."""

import numpy as np

from trackbench.core.arrays import Array, Mask
from trackbench.statistics.correlated_series import series_mean
from trackbench.statistics.estimates import RunEstimate


class OfSteps(RunEstimate):
    """A number of one recording: its influences are those of the steps (T,), which are correlated."""

    __slots__ = ()

    @classmethod
    def from_contributions(cls, value: float, steps: Array) -> "OfSteps":
        """Return the number ``value`` from what each step (T,) contributes to it; NaN where none.

        A step's influence is its contribution less the number. The number of runs is 1.
        """
        return cls(value, series_mean(steps).stderr, steps - value, 1)

    @property
    def series(self) -> Array:
        """Contribution of each step (T,) to the number."""
        assert self.influences is not None
        return self.influences + self.value

    @property
    def has_value(self) -> Mask:
        """True for each step (T,) that contributes to the number."""
        assert self.influences is not None
        return ~np.isnan(self.influences)

    def over_steps(self, steps: Mask) -> "OfSteps":
        """Return the number over some of the steps.

        It is the mean of their contributions. A step's contribution is the whole number plus the step's
        influence on it. For a rms, which is no mean of steps, this is exact to first order only.

        Parameters
        ----------
        steps
            mask (T,) of the steps

        Returns
        -------
        OfSteps
            number over these steps; itself if no other step contributes to it. It is NaN if none of the
            steps does
        """
        if not (self.has_value & ~steps).any():
            return self
        series = np.where(steps, self.series, np.nan)
        value = np.nan
        if (self.has_value & steps).any():
            value = series_mean(series).value
        return OfSteps.from_contributions(value, series)

    def minus(self, other: "OfSteps", factor: float = 1.0) -> "OfSteps":
        """Return the difference ``self - factor other``, step by step.

        Parameters
        ----------
        other
            number of the same T steps
        factor
            multiple of the other number

        Returns
        -------
        OfSteps
            difference over the steps that both have
        """
        a = self.over_steps(other.has_value)
        b = other.over_steps(self.has_value)
        assert a.influences is not None
        assert b.influences is not None
        value = a.value - factor * b.value
        influences = a.influences - factor * b.influences
        # A step's contribution is the number plus the step's influence.
        return OfSteps.from_contributions(value, influences + value)

    @property
    def why(self) -> str:
        """Reason why the steps have no standard error; empty if they have one."""
        assert self.influences is not None
        # The reason depends on the differences from the mean alone, so influences do as well.
        return series_mean(self.influences).why

    def over(self, value: float, divisor: float) -> "OfSteps":
        """Return an estimate of ``value`` with the influences of this one divided by ``divisor``."""
        assert self.influences is not None
        return OfSteps.from_contributions(value, self.influences / divisor + value)

    @property
    def is_exact(self) -> bool:
        """True: there is no other seed."""
        return True

    def z(self, target: float = 0.0, other: float = 0.0) -> float:
        """Return z of the hypothesis that the mean of the steps is the target.

        ``other``, the standard error of the target, is not used.
        """
        assert self.influences is not None
        return series_mean(self.influences + (self.value - target)).z

    def interval(self, level: float = 0.95, other: float = 0.0) -> tuple[float, float]:
        """Return the confidence interval of the steps' mean.

        ``other``, the standard error of what it is compared with, is not used.
        """
        assert self.influences is not None
        width = series_mean(self.influences).half_width(level)
        return self.value - width, self.value + width
