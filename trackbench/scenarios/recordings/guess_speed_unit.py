"""Guess of the unit of measured speeds, by the speed of the positions."""

from collections.abc import Iterator, Mapping

import numpy as np

from trackbench.core.arrays import Array
from trackbench.scenarios.recordings.guess_position_unit import WORDS_OF_AIS
from trackbench.scenarios.recordings.guess_usual_speed_and_acceleration import Displacements
from trackbench.scenarios.recordings.unit_names_and_sizes import UNITS
from trackbench.scenarios.recordings.unscaled_rows import UnscaledRows

NEAR = 0.07
"""Largest relative difference between a measured speed and that of the positions which agrees."""
_DISAGREES = 2.0
"""Penalty of a measured speed that does not agree with the positions in any unit."""
SPEED_UNITS = {
    **{"m/s": 0.0, "kn": 0.0, "km/h": 0.25, "mph": 0.25, "ft/s": 0.5, "cm/s": 0.5, "mm/s": 1.0},
    **{"kn/10": 0.5, "km/s": 2.0},
}
"""Penalty of each unit. Lengths that are not m count only beside a speed that agrees."""


def speed_units(
    unscaled: UnscaledRows,
    known_units: Mapping[str, str],
    displacements: Displacements,
    as_geodetic: bool,
) -> Iterator[tuple[str, float, bool]]:
    """Yield each possible unit of the measured speed, its penalty, and whether the speed agrees in it.

    The first units are those in which the speed agrees with that of the ``displacements``. The last one
    is the known unit, or empty, with the penalty of a disagreement, 0 if there is nothing to compare.
    ``known_units`` are units by quantity that need no guess. ``as_geodetic`` is True if positions are
    latitudes and longitudes.
    """
    measured_speed = _measured_speed(unscaled)
    if measured_speed is None:
        yield "", 0.0, False
        return
    # Ratio of the measured speed, as written, to that of the positions, m/s.
    ratio = _speed_ratio(measured_speed, displacements)
    known = known_units.get("speed", known_units.get("vx"))
    agreeing = []
    for unit, penalty in SPEED_UNITS.items():
        if known is not None and unit != known:
            continue
        difference = np.inf  # relative, of the measured speed from that of the positions
        if np.isfinite(ratio):
            difference = abs(ratio * UNITS[unit] - 1.0)
        if difference >= NEAR:
            continue
        # Beside latitudes, and in AIS messages, speeds are usually in knots. Raw messages of AIS count
        # tenths of a knot (kn/10).
        is_ais = not unscaled.plain_column_names.isdisjoint(WORDS_OF_AIS)
        is_at_sea = (as_geodetic and unit == "kn") or (is_ais and unit.startswith("kn"))
        unit_penalty = 0.0 if is_at_sea or unit == known else penalty
        # Of two units in which the speed agrees the nearer one is likelier: its penalty is up to 0.5
        # less, which is within the margin of `likely_units`, 0.6.
        agreeing.append((unit, unit_penalty + 0.5 * difference / NEAR, True))
    yield from agreeing
    disagreement = _DISAGREES if np.isfinite(ratio) else 0.0
    yield known or "", disagreement, False


def _measured_speed(unscaled: UnscaledRows) -> Array | None:
    """Return the measured speed (R,), in the unit of the file; None if there is none."""
    if unscaled.velocity is not None:
        return np.hypot(*unscaled.velocity)
    return unscaled.speed


def _speed_ratio(measured_speed: Array, displacements: Displacements) -> float:
    """Return the median ratio of measured speeds (R,), as written, to the positions' speed in m/s.

    It is the reciprocal of the unit in m/s, if the speeds agree. NaN if there is nothing to compare.
    """
    if not len(displacements.first_row) or not np.isfinite(displacements.usual_speed):
        return np.nan
    speed = np.sqrt(np.square(displacements.vectors).sum(axis=0)) / displacements.duration
    # A displacement's speed is compared with the mean of the measured speeds at both of its ends.
    mean = 0.5 * (measured_speed[displacements.first_row] + measured_speed[displacements.last_row])
    valid = np.isfinite(mean) & (mean > 0.0) & (speed > 0.0)
    if not valid.any():
        return np.nan
    # Only rows count where the target moves, at half of its median speed or more.
    moving = valid & (speed >= 0.5 * np.median(speed[valid]))
    return float(np.median(mean[moving] / speed[moving]))
