"""Guess of the standard deviations of errors, and of the share of outliers, by all rows."""

from collections.abc import Callable, Sequence

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.latitude_longitude import SEMI_MAJOR_AXIS
from trackbench.scenarios.recordings.errors_from_neighbors import (
    error_of_line,
    round_to_two_digits,
    scaled_distances_from_neighbors,
    scatter,
)
from trackbench.scenarios.recordings.guess_sensors import ANGLES, SENSORS
from trackbench.scenarios.recordings.guess_usual_speed_and_acceleration import usual_speed
from trackbench.scenarios.recordings.naming_of_columns import Naming
from trackbench.scenarios.recordings.rows_and_reading_context import Rows
from trackbench.scenarios.recordings.unit_names_and_sizes import UNITS

FAR_SIGMAS = 8.0
"""standard deviations from the line between its neighbors, beyond which a row is an outlier"""


def raised_to_resolution(
    sigmas: Sequence[float],
    quantities: Sequence[str],
    naming: Naming,
    decimals: Callable[[str], int],
) -> tuple[float, ...]:
    """Return the standard deviations ``sigmas``, raised to at least the last digit of the numbers.

    ``quantities`` are those of the standard deviations, in SI units. ``decimals`` returns the digits
    behind the decimal point of the column that it is given.
    """
    raised = []
    for name, sigma in zip(quantities, sigmas, strict=True):
        source = name
        meters_per_unit = 1.0  # of the quantity in SI
        if name not in naming.columns:
            # Only x and y may lack a column: they are computed from longitude and latitude, rad.
            source = {"x": "longitude", "y": "latitude"}.get(name, name)
            meters_per_unit = SEMI_MAJOR_AXIS
        digits = decimals(naming.columns[source])
        resolution = 10.0**-digits * naming.scale(source) * meters_per_unit
        raised.append(max(sigma, round_to_two_digits(resolution)))
    return tuple(raised)


def errors_and_speed(rows: Rows, kind: str, in_degrees: bool) -> tuple[tuple[float, ...], float]:
    """Estimate the errors of a sensor's quantities and the usual speed, from complete rows in order.

    Return the standard deviations, one for each quantity in m or rad, and the speed, m/s. The speed is 0
    for a sensor that shows none: one of azimuths alone, or a landmark, which is seen from a robot that
    moves and turns itself. ``kind`` is a key of `SENSORS`. ``in_degrees`` is True if the angles of
    ``rows`` are in degrees.
    """
    time = rows.time
    values = unwrapped_values(rows, kind, in_degrees)
    sigmas = tuple(scatter(time, value) for value in values)
    if kind == "bearing" or kind.startswith("landmark"):
        return sigmas, 0.0
    if kind == "range-azimuth":
        r, a = values
        values = [r * np.cos(a), r * np.sin(a)]
    return sigmas, usual_speed(time, *values)


def error_of_azimuth(rows: Rows, kind: str, in_degrees: bool) -> float:
    """Estimate the standard deviation of azimuths, rad, from complete rows in order.

    Return 0 for a sensor of another ``kind`` than those of `SENSORS` with an azimuth. ``in_degrees`` is
    True if the azimuths of ``rows`` are in degrees.
    """
    if SENSORS[kind][-1] != "azimuth":
        return 0.0
    return error_of_line(rows.time, unwrapped_values(rows, kind, in_degrees)[-1])


def unwrapped_values(rows: Rows, kind: str, in_degrees: bool) -> list[Array]:
    """Return the values (R,) of each quantity of a sensor; angles are in radians and without jumps.

    ``kind`` is a key of `SENSORS`. ``in_degrees`` is True if the angles of ``rows`` are in degrees.
    """
    # Rows of the values below those of the sensor's quantities are measured velocities.
    values = [*rows.values[: len(SENSORS[kind])]]
    # Each type has one angle at most, an azimuth or a bearing, which is its last quantity.
    if SENSORS[kind][-1] in ANGLES:
        angle = values[-1]
        if in_degrees:
            angle = angle * UNITS["deg"]
        values[-1] = np.unwrap(angle)
    return values


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
