"""Sample of a sensor's measurements and of the truth, and the distances between both."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array, Index
from trackbench.models.base import Sensor
from trackbench.models.sensors.steps_at_once import is_equal_at_every_step

MOST_REMAINING = 0.2
"""of the median distance that remains if a mirror image or a turn explains it"""
MOST_REMAINING_AT_PLACE = 0.4
"""of the median distance that remains at most if another place or origin explains it

That of a right radar is some 1.05, and changes are tried from 3 on.
"""
AZIMUTHS = ("azimuth", "bearing")
"""Components of measurements that are azimuths."""
HEADINGS = ("heading", "theta", "yaw", "psi", "course")
"""Components of the truth that are headings."""
MOST_STEPS = 200
"""steps of a sample"""
FITS = 2.0
"""median distance of measurements that fit a place; that of a right sensor is about 1"""
_NO_STEPS: Index = np.empty(0, dtype=np.intp)


class Sample(NamedTuple):
    """Measurements of one sensor at some steps, and the truth there."""

    sensor: Sensor
    truth: Array
    """true states (n_x, K, M)"""
    z: Array
    """measurements (n_z, K, M)"""
    steps: Index
    """numbers of the K steps"""
    name: str = ""
    """name of the sensor in a note"""
    indices: Index = _NO_STEPS
    """indices of the K steps among all steps of the recording"""
    is_clockwise: bool = False
    """whether the angles are read as clockwise ones"""
    reference: str = "the truth"
    """words for the truth in a note; it may be the positions of another sensor"""
    scales: Mapping[str, float] = MappingProxyType({})
    """units in which quantities are read, in SI; 1 of others"""
    is_geodetic: bool = False
    """whether the truth has latitudes and longitudes"""
    position_rows: tuple[int, ...] = ()
    """rows of the truth's position"""
    position_error: float = 0.0
    """standard deviation of the truth's position on each axis, m"""


def normalized_errors(sample: Sample) -> Array:
    """Compute ``(z - h(x)) / sigma`` (n_z, N) of all N steps and runs of a sample; NaN where unknown.

    The error of the truth's position, if it has one, is added to that of the measurement.
    """
    truth = sample.truth
    z = sample.z
    if is_equal_at_every_step(sample.sensor):
        # All steps and runs are one batch of one step, for which the first one stands below.
        truth = truth.reshape(len(truth), 1, -1)
        z = z.reshape(len(z), 1, -1)
    errors = []
    with np.errstate(all="ignore"):
        for i, step in enumerate(sample.steps[: truth.shape[1]].tolist()):
            predicted = sample.sensor.measurement(truth[:, i], step)
            error = sample.sensor.innovation(z[:, i], predicted.mean)
            variance = np.einsum("ii...->i...", predicted.cov)
            if variance.ndim == 1:  # one for all runs
                variance = variance[:, None]
            if sample.position_error > 0.0:
                # var = R_ii + sum_j (h_i(x + sigma e_j) - h_i(x))^2
                for row in sample.position_rows:
                    moved = truth[:, i].copy()
                    moved[row] += sample.position_error
                    moved_mean = sample.sensor.measurement(moved, step).mean
                    variance = variance + sample.sensor.innovation(moved_mean, predicted.mean) ** 2
            errors.append(error / np.sqrt(variance))
    return np.concatenate(errors, axis=-1)


def normalized_distances(sample: Sample) -> Array:
    """Compute ``|z - h(x)| / sigma`` (n_z, N) of all N steps and runs of a sample; NaN where unknown."""
    return np.abs(normalized_errors(sample))


def largest_distances(distances: Array) -> Array:
    """Return the largest distance of each measurement, of the distances (n, N) of its n components.

    Measurements without a known distance are left out.
    """
    largest = np.nanmax(np.where(np.isfinite(distances), distances, -1.0), axis=0)
    return np.asarray(largest[largest >= 0.0])


def median_distance(distances: Array) -> float:
    """Return the median of the largest distance of each measurement; infinite if none is known.

    ``distances`` (n, N) are those of the components.
    """
    sizes = largest_distances(distances)
    if not len(sizes):
        return np.inf
    return float(np.median(sizes))
