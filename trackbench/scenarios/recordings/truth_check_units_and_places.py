"""Other units, heights and places of landmarks with which measurements agree with the truth."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.durations import two_digits
from trackbench.models.sensors.landmark import Landmark
from trackbench.scenarios.recordings.quantity_keys import plain_name
from trackbench.scenarios.recordings.truth_check_distances import (
    AZIMUTHS,
    FITS,
    HEADINGS,
    MOST_REMAINING,
    MOST_REMAINING_AT_PLACE,
    Sample,
    median_distance,
    normalized_distances,
    normalized_errors,
)
from trackbench.scenarios.recordings.unit_names_and_sizes import DIMENSION_OF, DIMENSIONS, UNITS

_FACTORS = {
    "mm and m, or m and km,": 1e-3,
    "cm and m": 1e-2,
    "feet and m": 0.3048,
    "nautical miles and m": 1852.0,
    "nautical miles and km": 1.852,
    "miles and m": 1609.344,
    "miles and km": 1.609344,
    "nautical miles and miles": 1852.0 / 1609.344,
    "nautical miles and feet": 1852.0 / 0.3048,
}
"""Usual mistakes of units of lengths, with the factor between the units."""
_DEGREES = ("deg and rad", np.pi / 180.0)
_SMALL_SHARE = 0.005
"""share of a length by which the median of measurements may differ from it, half of what fits

Between two units is a factor of 1.15 or more.
"""
_ITERATIONS = 30
_HUBER = 2.0
"""standard deviations from which on a measurement counts less in the fit of a place"""
_STEEPEST = 1e5
"""largest change of a normalized error, in standard deviations per meter, that is no jump"""


def other_height(sample: Sample, components: Sequence[str], size: float) -> str:
    """Return the end of a note, with the change of measured heights by which both agree.

    Heights may be higher by a constant, as those above the ellipsoid are than those above the sea, or in
    another unit. They then differ by a constant, too, as z counts from the height of the origin. The
    text is empty if no change explains the median distance ``size`` of measurements from what the truth
    predicts, in standard deviations. ``components`` are those of the truth.
    """
    rows = [row for row, name in enumerate(sample.sensor.components) if plain_name(name) == "z"]
    heights = [row for row, name in enumerate(components) if plain_name(name) == "z"]
    if len(rows) != 1 or len(heights) != 1 or len(sample.sensor.components) < 2:
        return ""
    texts: dict[float, str] = {1.0: ""}
    for units, factor in _FACTORS.items():
        for ratio in (factor, 1.0 / factor):
            texts[ratio] = f"if its z is multiplied by {two_digits(ratio)}: are {units} mixed up?"
    for ratio, text in texts.items():
        z = sample.z.copy()
        z[rows] *= ratio
        # The same sensor's median height above the truth.
        offset = float(np.nanmedian(z[rows] - sample.truth[heights]))
        z[rows] -= offset
        # The distance that remains must be one of noise, and a small share of that before the change.
        remaining = median_distance(normalized_distances(sample._replace(z=z)))
        if remaining > min(FITS, MOST_REMAINING * size):
            continue
        if ratio == 1.0:
            direction = "lower" if offset > 0.0 else "higher"
            reason = "do both count from the ellipsoid, or from the sea?"
            return f"; they agree if its z is {direction} by {abs(offset):.3g} m: {reason}"
        return f"; they agree {text} See `units`"
    return ""


def other_unit(
    sample: Sample, axes: tuple[tuple[int, int], ...], components: Sequence[str], size: float
) -> str:
    """Return the end of a note that names the factor of a wrong unit, if measurements then fit.

    It is empty if no usual factor explains the distances. ``axes`` are pairs of rows of the truth: those
    of x and y, and those of vx and vy if it has them. ``components`` are its components, and ``size`` is
    the median distance of measurements from what the truth predicts, without any change, in standard
    deviations. The unit of a geodetic truth is right, so that measurements have the wrong one.
    """
    # Step 1: multiply the measured lengths or angles, or those of the truth, by each usual factor.
    measured = sample.sensor.components
    angles = [row for row, name in enumerate(measured) if name in (*AZIMUTHS, "elevation")]
    lengths = [row for row in range(len(measured)) if row not in angles]
    # Rates of ranges may have a unit of their own.
    without_rates = [row for row in lengths if measured[row] != "range_rate"]
    headings = [row for row, name in enumerate(components) if name in HEADINGS]
    in_space = [row for row, name in enumerate(components) if plain_name(name) in ("z", "vz")]
    planar = [row for pair in axes for row in pair]
    # Components without values, as the velocities of a truth that has none, are not named.
    has_values = [bool(np.isfinite(row).any()) for row in sample.truth]
    changes: list[_ChangeOfUnit] = []
    for units, factor in (*_FACTORS.items(), _DEGREES):
        is_angle = units == _DEGREES[0]
        for ratio in (factor, 1.0 / factor):
            groups = [angles] if is_angle else [lengths, without_rates]
            for rows in filter(None, groups):
                z = sample.z.copy()
                z[rows] *= ratio
                quantities = [measured[row] for row in rows]
                verb = "is" if len(rows) == 1 else "are"
                words = f"its {' and '.join(quantities)} {verb}"
                text = (
                    f"{words} multiplied by {two_digits(ratio)}: are {units} mixed up? See `units`"
                )
                unit = _unit_of(sample, quantities, ratio)
                if sample.is_geodetic and unit:
                    in_units = ", ".join(f"{name}: {unit}" for name in map(plain_name, quantities))
                    text = f"{words} in {unit}: say `units: {{{in_units}}}`"
                distances = normalized_distances(sample._replace(z=z))
                changes.append(_ChangeOfUnit(text, ratio, median_distance(distances)))
                # A sigma that is guessed from the measurements has their wrong unit, too: lengths also
                # fit if they differ by a small share of what the truth predicts, h.
                if sample.is_geodetic and not is_angle:
                    # Without a measurement the distance is |h| / sigma.
                    z[rows] = 0.0
                    predicted = normalized_distances(sample._replace(z=z))[rows]
                    distances[rows] /= np.maximum(_SMALL_SHARE * predicted, 1e-12)
                    text += ", and check its sigma"
                    remaining = median_distance(distances)
                    changes.append(_ChangeOfUnit(text, ratio, remaining, is_relative=True))
            groups = [headings] if is_angle else [[*planar, *in_space]]
            if sample.is_geodetic and not is_angle:
                groups = []
            for rows in filter(None, groups):
                truth = sample.truth.copy()
                truth[rows] *= ratio
                quantities = [components[row] for row in rows if has_values[row]]
                verb = "is" if len(quantities) == 1 else "are"
                words = f"{' and '.join(quantities)} of {sample.reference} {verb}"
                text = (
                    f"{words} multiplied by {two_digits(ratio)}: are {units} mixed up? See `units`"
                )
                distances = normalized_distances(sample._replace(truth=truth))
                changes.append(_ChangeOfUnit(text, ratio, median_distance(distances)))
    # Step 2: take the factor after which measurements are nearest to the truth. The distance that
    # remains must be one of noise, and a small share of that before the change. Whatever is multiplied
    # by a small factor fits, as its errors become small: such a factor comes second.
    most = min(FITS, MOST_REMAINING * size)
    fitting = [change for change in changes if change.remaining <= most]
    fitting = [change for change in fitting if change.ratio > 1.0] or fitting
    if not fitting:
        return ""
    best = min(fitting, key=lambda change: (change.is_relative, change.remaining))
    return f"; they agree if {best.text}"


class _ChangeOfUnit(NamedTuple):
    """Change of measurements or of the truth by the factor between two units."""

    text: str
    ratio: float
    remaining: float
    """median distance after it, in standard deviations, or in units of `_SMALL_SHARE`"""
    is_relative: bool = False
    """whether the distance is relative to the length"""


def _unit_of(sample: Sample, quantities: Sequence[str], ratio: float) -> str:
    """Return the unit of the file in which measured ``quantities`` are ``ratio`` times as large as read.

    It is empty if there is none, or if the quantities are not read in one unit.
    """
    scales = {sample.scales.get(name, 1.0) for name in quantities}
    if len(scales) > 1:
        return ""
    (scale,) = scales
    for unit in DIMENSIONS[DIMENSION_OF.get(plain_name(quantities[0]), "length")]:
        if np.isclose(UNITS[unit], scale * ratio, rtol=1e-6, atol=0.0):
            return unit
    return ""


def other_place(sample: Sample, landmark: Landmark, size: float) -> str:
    """Return the end of a note that names the place of a landmark which its measurements fit.

    It is empty if they fit no place. ``size`` is the median distance of measurements from what the truth
    and the landmark's own place predict, in standard deviations.
    """
    # Step 1: a place in another unit. The distance that remains must be one of noise, and a small share
    # of that with the landmark's own place.
    place = np.array(landmark.at)
    most = min(FITS, MOST_REMAINING_AT_PLACE * size)
    for units, factor in _FACTORS.items():
        for ratio in (factor, 1.0 / factor):
            remaining = median_distance(
                normalized_distances(_at_place(sample, landmark, ratio * place))
            )
            if remaining <= most:
                words = f"they agree if its place `at` is multiplied by {two_digits(ratio)}"
                return f"; {words}: are {units} mixed up?"
    best = place
    least = size
    # Step 2: any place, by Gauss-Newton from several places, as ranges alone may fit on either side of a
    # straight path: from the landmark's own, the middle of the path, and the landmark mirrored there.
    positions = sample.truth[[landmark.state.index(name) for name in ("px", "py")]]
    middle = np.nanmedian(positions.reshape(2, -1), axis=1)
    for begin in (place, middle, 2.0 * middle - place):
        fitted = _fitted_place(sample, landmark, begin)
        remaining = median_distance(normalized_distances(_at_place(sample, landmark, fitted)))
        if remaining < least:
            best = fitted
            least = remaining
    if least > most:
        return ""
    x, y = (f"{value:.2f}" for value in best)
    return f"; they agree if it is at [{x}, {y}]: check `at`"


def _at_place(sample: Sample, landmark: Landmark, place: Array) -> Sample:
    """Return the sample with its landmark at another ``place`` (2,), m."""
    x, y = place.tolist()
    return sample._replace(sensor=replace(landmark, at=(x, y)))


def _fitted_place(sample: Sample, landmark: Landmark, place: Array) -> Array:
    """Fit the place (2,) of a landmark, m, to its measurements by Gauss-Newton with Huber's weights.

    The iteration begins at ``place``. If a step is not finite, the place before it is returned.
    """
    h = 1e-4  # m, of the difference quotients
    for _ in range(_ITERATIONS):
        error = normalized_errors(_at_place(sample, landmark, place))  # in standard deviations
        columns = []
        for step in ((h, 0.0), (0.0, h)):
            moved = normalized_errors(_at_place(sample, landmark, place + step))
            columns.append((moved - error) / h)
        known = np.isfinite(error)
        J = np.stack([column[known] for column in columns], axis=-1)
        r = error[known]
        weight = np.minimum(1.0, _HUBER / np.maximum(np.abs(r), 1e-12))
        # Where a bearing jumps by 2 pi, the quotient is no derivative.
        weight = np.where((np.abs(J) < _STEEPEST).all(axis=-1), weight, 0.0)
        # The small diagonal keeps A regular where no measurement shows a direction.
        A = J.T @ (weight[:, None] * J) + 1e-9 * np.eye(2)
        change = np.linalg.solve(A, -J.T @ (weight * r))
        if not np.isfinite(change).all():
            return place
        place = place + change
        if np.abs(change).max() < 1e-4:  # m
            break
    return place
