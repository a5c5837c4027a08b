"""Steps at which measurements arrive: from the sensors' delays or from a recording."""

import zlib
from typing import cast

import numpy as np

from trackbench.core.arrays import Array, Index
from trackbench.core.random_streams import RunStreams, Streams
from trackbench.models.delays import drawn_steps, longest_delay
from trackbench.models.sensors.stacked import Sensors, sensors_of


def arrivals(sensor: Sensors, recorded: Array | None, z: Array, rng: Streams) -> Index | None:
    """Return the step (S, T, M), from 0, at which the measurement of each of S sensors arrives.

    None without delays. T stands for an arrival after the end. The steps are drawn, or taken from
    ``recorded`` arrivals (S, T, M), in which NaN is an arrival on time. Of the measurements z
    (n_z, T, M) only the shape is used.
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
