"""Note on a logger that repeats the last position until the next one, as if it were measured again."""

from collections.abc import Sequence

import numpy as np

from trackbench.core.arrays import Array
from trackbench.models.sensors.stacked import sensor_name
from trackbench.scenarios.recordings.quantity_keys import PLACE, plain_name
from trackbench.scenarios.recordings.rows_and_reading_context import Rows
from trackbench.scenarios.recordings.velocity_check import MOST_ROWS

_FEWEST_POSITIONS = 10
"""different positions that show how often each is repeated"""
_NEAR = 0.2
"""share by which numbers of repetitions differ that are nearly equal; one more or less always is"""
_MOST = 0.9
"""share of the positions that must be repeated nearly equally often"""
_MOST_UNITS = 4.0
"""largest step, in units of the last digit, of values that have few digits"""
_ROUNDING = 0.05
"""deviation of a step from whole units of the last digit, in units"""


def note_on_repetitions(
    components: Sequence[Sequence[str]], rows: Sequence[Rows], names: Sequence[str]
) -> list[str]:
    """Return a text on each sensor whose positions are repeated, nearly all of them equally often.

    A logger that is faster than its receiver does so. A target at rest repeats its position, too, but
    irregularly. A slow one whose positions have few digits changes them by a unit of the last digit.
    ``components`` are those of each sensor, ``rows`` its rows in order of run and time, and ``names``
    the sensors' names if they have any. Only the first rows of the first run count.
    """
    texts = []
    for number, (each, of_sensor) in enumerate(zip(components, rows, strict=True)):
        if tuple(map(plain_name, each)) not in (PLACE, ("range", "azimuth")):
            continue
        of_run = np.flatnonzero(of_sensor.run == of_sensor.run.min(initial=0))
        values = of_sensor.values[:, of_run[:MOST_ROWS]]
        values = values[:, np.isfinite(values).all(axis=0)]
        usual = usual_repetitions(values)
        if usual is None:
            continue
        whose = f" of {sensor_name(number, names)}" if len(components) > 1 else ""
        message = f"most positions{whose} are there {usual:g} times, in rows one after the other"
        doubt = "does the logger repeat the last one? Filters take each row for a new measurement"
        texts.append(f"{message}: {doubt}: empty the cells of the repetitions")
    return texts


def usual_repetitions(values: Array) -> float | None:
    """Return how often values (n, R) are there one after the other; None if they are not repeated.

    Only the first rows count, `MOST_ROWS`.
    """
    values = values[:, :MOST_ROWS]
    # The rows with another position than the row before, and the number of rows of each position between
    # the first and the last one, which may be cut.
    changes = np.flatnonzero((values[:, 1:] != values[:, :-1]).any(axis=0)) + 1
    lengths = np.diff(changes)
    if len(lengths) < _FEWEST_POSITIONS:
        return None
    usual = float(np.median(lengths))
    is_near = np.abs(lengths - usual) <= max(1.0, _NEAR * usual)
    if usual < 2.0 or is_near.mean() < _MOST or _has_few_digits(values):
        return None
    return usual


@np.errstate(over="ignore", invalid="ignore")  # of numbers near 1e308
def _has_few_digits(values: Array) -> bool:
    """Test whether values (n, R) change by few units of their last digit, as those of a slow target."""
    for axis in np.abs(np.diff(values, axis=1)):
        steps = axis[axis > 0.0]
        if not len(steps):
            continue
        units = steps / steps.min()
        is_whole = np.abs(units - np.rint(units)) < _ROUNDING
        if is_whole.mean() < _MOST or units.max() > _MOST_UNITS:
            return False
    return True
