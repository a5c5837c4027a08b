"""Note on a sensor whose positions jump to and fro, as those of several targets."""

from collections.abc import Sequence

import numpy as np

from trackbench.models.sensors.stacked import sensor_name
from trackbench.scenarios.recordings.guess_jumps import first_return
from trackbench.scenarios.recordings.quantity_keys import PLACE, plain_name
from trackbench.scenarios.recordings.rows_and_reading_context import Rows
from trackbench.scenarios.recordings.velocity_check import MOST_ROWS


def note_on_returns(
    components: Sequence[Sequence[str]], rows: Sequence[Rows], names: Sequence[str]
) -> list[str]:
    """Return a text on each sensor whose positions jump to and fro, as those of several targets do.

    ``components`` are those of each sensor, ``rows`` its rows in order of run and time, and ``names``
    the sensors' names if they have any. Only the first rows of the first run count.
    """
    texts = []
    for number, (each, of_sensor) in enumerate(zip(components, rows, strict=True)):
        if tuple(map(plain_name, each)) != PLACE or not len(of_sensor.run):
            continue
        of_run = np.flatnonzero(of_sensor.run == of_sensor.run.min())[:MOST_ROWS]
        positions = of_sensor.values[:, of_run]
        positions = positions[:, np.isfinite(positions).all(axis=0)]
        if first_return(positions) is None:
            continue
        whose = f" of {sensor_name(number, names)}" if len(components) > 1 else ""
        text = f"positions{whose} lie far from those of the row before and near earlier ones, again and"
        text += (
            " again: are they several targets? A column that names them is `columns: {run: NAME}`"
        )
        texts.append(text)
    return texts
