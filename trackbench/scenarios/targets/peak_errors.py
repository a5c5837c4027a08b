"""Peak errors of a run, and the times and windows over which errors are measured."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array, Mask
from trackbench.metrics import in_window

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
        """Return ``peak_position``, m, in each window, and ``beyond_10_sigma``.

        Parameters
        ----------
        peaks : mapping of str to array (M,)
            Each run's largest error of position, m, by window. The name ``""`` is that of all scored
            steps.

        Returns
        -------
        dict of array (M,)
            Numbers by the metric's name. ``beyond_10_sigma`` is 1 if the largest error exceeds 10 times
            ``sigma``, m, the largest standard deviation in any direction of a position that is estimated
            from one scan. It is NaN if the error is.
        """
        metrics = {in_window("peak_position", name): peak for name, peak in peaks.items()}
        # 1 beyond `STRAY`, 10 sigma, and 0 within; NaN if the peak is NaN. The window "" is all scored
        # steps. If sigma is NaN, no error is beyond it.
        whole_peak = peaks[""]
        is_beyond = (whole_peak > STRAY * self.sigma).astype(float)
        metrics["beyond_10_sigma"] = np.where(np.isnan(whole_peak), np.nan, is_beyond)
        return metrics

    def known_peaks(self, squared: Array) -> dict[str, Array]:
        """Return each run's largest error by window, without steps at which the error is missing.

        Parameters
        ----------
        squared : array (K, M)
            Squared errors, m^2, NaN where they are missing, as without a truth.

        Returns
        -------
        dict of array (M,)
            Largest error, m, by window.
        """
        peaks = {}
        for name, mask in self.windows.items():
            peaks[name] = np.sqrt(np.fmax.reduce(squared[mask], axis=0))
        return peaks
