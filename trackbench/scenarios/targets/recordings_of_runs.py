"""Recording of each run: run m has recording m, and training runs begin with the last one."""

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.random_streams import RunStreams, Streams


def recorded_columns(values: Array, rng: Streams) -> Array:
    """Return the columns (..., M) of the M runs of ``rng``, NaN for runs without a recording.

    ``values`` (..., R) have a column for each of R recorded runs. Run m is recording m. Training runs
    have the numbers -1, -2, ...: run -1 is the last recording.
    """
    assert isinstance(rng, RunStreams)
    columns = np.full((*values.shape[:-1], len(rng.runs)), np.nan)
    # A negative index counts from the last recording.
    recordings = values.shape[-1]
    existing = [m for m in rng.runs if -recordings <= m < recordings]
    # The numbers in ``rng`` count away from zero, so runs without a recording come last.
    columns[..., : len(existing)] = values[..., existing]
    return columns
