"""Guess of the share of outliers: rows that are far from the line between their neighbors."""

import numpy as np

from trackbench.scenarios.recordings.errors_from_neighbors import (
    error_of_line,
    scaled_distances_from_neighbors,
)
from trackbench.scenarios.recordings.guess_errors import unwrapped_values
from trackbench.scenarios.recordings.rows_and_reading_context import Rows

FAR_SIGMAS = 8.0
"""standard deviations from the line between its neighbors, beyond which a row is an outlier"""


def share_of_outliers(rows: Rows, kind: str, in_degrees: bool) -> float:
    """Return the share of complete rows, in order, that lie far from the line between their neighbors.

    Far is more than `FAR_SIGMAS` standard deviations of the other rows. ``kind`` is a key of `SENSORS`,
    and ``in_degrees`` is True if the angles of ``rows`` are in degrees.
    """
    shares = [0.0]
    for values in unwrapped_values(rows, kind, in_degrees):
        distances = scaled_distances_from_neighbors(rows.time, values)
        sigma = error_of_line(rows.time, values)
        if sigma <= 1e-12 * np.nanmax(np.abs(values), initial=0.0):
            continue  # values on a straight line have only rounding errors
        is_far = distances > FAR_SIGMAS * sigma
        # An outlier also moves the lines of both of its neighbors: of successive far rows only those
        # count that are farther than the row before and the row after.
        is_peak = is_far.copy()
        is_peak[1:] &= ~(is_far[:-1] & (distances[:-1] > distances[1:]))
        is_peak[:-1] &= ~(is_far[1:] & (distances[1:] > distances[:-1]))
        shares.append(float(is_peak.mean()))
    return max(shares)
