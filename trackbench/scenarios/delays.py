"""Steps at which measurements arrive: from the sensors' delays or from a recording."""

import zlib
from typing import cast

import numpy as np

from trackbench.core.arrays import Array, Index
from trackbench.core.random_streams import RunStreams, Streams
from trackbench.models.delays import drawn_steps, longest_delay
from trackbench.models.sensors.stacked import Sensors, sensors_of


def arrivals(sensor: Sensors, recorded: Array | None, z: Array, rng: Streams) -> Index | None:
    """Return the step at which each measurement arrives.

    The steps are drawn, or taken from recorded arrivals.

    Parameters
    ----------
    sensor : Sensors
        True sensor, or all sensors as one.
    recorded : array (S, T, M) or None
        Recorded arrivals of each of S sensors, as steps from 0, in which NaN is an arrival on time. None
        if they are drawn.
    z : array (n_z, T, M)
        Measurements, of which only the shape is used.
    rng : Streams
        Random numbers, a stream per run.

    Returns
    -------
    array of int (S, T, M) or None
        Steps from 0. T stands for an arrival after the end. None if no sensor has a delay.
    """
    T, runs = z.shape[1:]
    due = np.arange(T)[:, None]
    if recorded is not None:
        return np.where(np.isnan(recorded), due, np.minimum(recorded, T)).astype(np.int32)
    # The delay of each sensor: a number of steps, or the law from which it is drawn.
    delays = [each.delay for each in sensors_of(sensor)]
    if not any(delays):
        return None
    arrival: Index = np.empty((len(delays), T, runs), dtype=np.int32)
    for n, delay in enumerate(delays):
        u = np.empty((T, runs))  # a fixed delay needs no draw
        if not isinstance(delay, int):
            # Streams of its own leave all other draws as they are without the delay.
            u = cast(RunStreams, rng).beside(stream_number(n)).random((T, runs))
        arrival[n] = np.minimum(due + drawn_steps(delay, u), T)
    return arrival


def stream_number(sensor: int) -> int:
    """Return the number of the random streams of a sensor's delays; sensors are counted from 0."""
    # Faults have streams by the CRC-32 of their names, and no name of a fault has a line break.
    return zlib.crc32(f"\ndelay of sensor {sensor + 1}".encode())


def longest_delay_of(sensor: Sensors) -> int:
    """Return the delay, in steps, that at most one in a thousand measurements of any sensor exceeds."""
    return max(longest_delay(each.delay) for each in sensors_of(sensor))
