"""Peak errors of a run, and the time until they settle."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array, Mask
from trackbench.metrics import in_window
from trackbench.scenarios.settling_time import settled_row

STRAY = 10.0
"""Error beyond which a track has strayed, in standard deviations of a measured position."""


class Scored(NamedTuple):
    """Times and windows over which errors are measured."""

    times: Array
    """times (K,), s"""
    windows: Mapping[str, Mask]
    """steps (K,) of each window, by name; ``""`` is all that is scored"""
    sigma: float
    """standard deviation of a position by one measurement, m"""

    def peak_metrics(self, peaks: Mapping[str, Array]) -> dict[str, Array]:
        """Return ``peak_position``, m, (M,) in each window, and ``beyond_10_sigma`` (M,).

        ``peaks`` (M,) are each run's largest errors of position, m, by window. The second metric is 1 if
        the largest error exceeds 10 times ``sigma``, m, the largest standard deviation in any direction
        of a position that is estimated from one scan.
        """
        metrics = {in_window("peak_position", name): peak for name, peak in peaks.items()}
        # 1 beyond `STRAY`, 10 sigma, and 0 within; NaN if the peak is NaN. The window "" is all scored
        # steps. If sigma is NaN, no error is beyond it.
        whole_peak = peaks[""]
        is_beyond = (whole_peak > STRAY * self.sigma).astype(float)
        metrics["beyond_10_sigma"] = np.where(np.isnan(whole_peak), np.nan, is_beyond)
        return metrics

    def known_peaks(self, squared: Array) -> dict[str, Array]:
        """Return each run's largest error (M,), by window, of squared errors (K, M).

        Steps at which the error is missing, as without a truth, are left out.
        """
        peaks = {}
        for name, mask in self.windows.items():
            peaks[name] = np.sqrt(np.fmax.reduce(squared[mask], axis=0))
        return peaks

    def settling(
        self, error: Array, limit: float, stretches: Mapping[str, tuple[float, float]]
    ) -> dict[str, Array]:
        """Measure ``settling_s`` and ``not_settled`` (M,) by errors (K, M), in each stretch of time.

        A run has settled at the first scored step from which on the error is at most ``limit`` up to the
        stretch's end. Its time, s, counts from the stretch's beginning; NaN if it has not settled, or
        without an error. ``stretches`` have their begin and end, s, by name.
        """
        metrics: dict[str, Array] = {}
        for name, (begin, end) in stretches.items():
            # The window "" has all scored steps.
            after = self.windows[""] & (self.times >= begin) & (self.times <= end)
            if not after.any():
                continue  # shorter than the sampling time
            # First row from which on the error is within the limit; one after the last row if none is.
            row = settled_row(error[after] > limit)
            seconds = np.append(self.times[after] - begin, np.nan)[row]
            not_settled = (row == after.sum()).astype(float)
            unknown = np.isnan(error[after]).any(axis=0)
            metrics[in_window("settling_s", name)] = np.where(unknown, np.nan, seconds)
            metrics[in_window("not_settled", name)] = np.where(unknown, np.nan, not_settled)
        return metrics
