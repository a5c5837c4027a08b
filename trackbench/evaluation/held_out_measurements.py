"""Held-out measurements: every n-th one of a run, which the filter is not given (key `hold_out`)."""

import numpy as np

from trackbench.core.arrays import Array, Mask
from trackbench.core.read_only import freeze


def held_out(measurements: Array, every: int) -> Mask:
    """Return which measurements (T, M) are held out: every n-th existing one of each run."""
    measured = ~np.isnan(measurements).all(axis=0)
    return np.asarray(measured & (np.cumsum(measured, axis=0) % every == 0))


def visible_to_filter(measurements: Array, hold_out: int | None) -> Array:
    """Replace the measurements (n_z, T, M) that are held out by NaN.

    If ``hold_out`` is n, every n-th existing measurement of a run is held out; none if it is None.
    """
    if not hold_out:
        return measurements
    return freeze(np.where(held_out(measurements, hold_out), np.nan, measurements))
