"""Errors of values from the line between their neighbors: their size, to two digits, and per row."""

import numpy as np

from trackbench.core.arrays import Array

_SHARE_WITHIN_SIGMA = 0.683
"""share of the values of a normal law that are within one standard deviation of its mean"""


def error_of_line(time: Array, value: Array) -> float:
    """Estimate the standard deviation of the errors of values (R,) at times (R,), in order.

    Each value is compared with the line through those before and after it in time. The result is 0 for
    fewer than three rows, or if all rows have one time.
    """
    # A distance has errors of three values in it: it is scaled to the size of a single value's error.
    sizes = scaled_distances_from_neighbors(time, value)
    if not np.isfinite(sizes).any():
        return 0.0
    # 68.3 % of normal errors are smaller than their standard deviation.
    return float(np.nanquantile(sizes, _SHARE_WITHIN_SIGMA))


def scatter(time: Array, value: Array) -> float:
    """Estimate the standard deviation, to two digits, of the errors of values (R,) in order of time.

    It is 1, as a guess, if the values have no errors beyond those of rounding.
    """
    sigma = error_of_line(time, value)
    # Values on a straight line have only rounding errors.
    if sigma > 1e-12 * np.nanmax(np.abs(value), initial=0.0):
        # One digit would change a 15 to 10 or 20, and with it a squared innovation by half. Two digits
        # change it by at most 5 %, which is less than the estimate's own error below some 400 rows.
        return round_to_two_digits(sigma)
    return 1.0


def scaled_distances_from_neighbors(time: Array, value: Array) -> Array:
    """Return the distances (R - 2,) of values (R,) from the lines between their neighbors in time.

    A distance has the errors of three values in it. It is divided so that its standard deviation is that
    of the error of one value. It is NaN if both neighbors have one time.
    """
    interval = time[2:] - time[:-2]
    if len(value) < 3 or not (interval > 0.0).any():
        return np.full(max(len(value) - 2, 0), np.nan)
    # s is the share of the time between both neighbors that has passed at a row.
    share = (time[1:-1] - time[:-2]) / np.where(interval > 0.0, interval, np.nan)
    # e = z_1 - (1 - s) z_0 - s z_2 has the variance sigma^2 (1 + s^2 + (1 - s)^2).
    difference = value[1:-1] - (1.0 - share) * value[:-2] - share * value[2:]
    scaled: Array = np.abs(difference) / np.sqrt(1.0 + np.square(share) + np.square(1.0 - share))
    return scaled


def round_to_two_digits(number: float) -> float:
    """Round a guessed number to two significant digits, as a new config has it."""
    return float(f"{number:.2g}")
