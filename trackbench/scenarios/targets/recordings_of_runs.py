"""Recording of each run: run m has recording m, and training runs begin with the last one."""

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.random_streams import RunStreams, Streams


def recorded_columns(values: Array, rng: Streams) -> Array:
    """Return the columns of recorded values that belong to the runs of ``rng``.

    Run m is recording m. Training runs have the numbers -1, -2, ...: run -1 is the last recording.

    Parameters
    ----------
    values : array (..., R)
        Values with a column for each of R recorded runs.
    rng : Streams
        Streams, which have the numbers of M runs.

    Returns
    -------
    array (..., M)
        Values of these runs, NaN for runs without a recording.
    """
    assert isinstance(rng, RunStreams)
    columns = np.full((*values.shape[:-1], len(rng.runs)), np.nan)
    # A negative index counts from the last recording.
    recordings = values.shape[-1]
    existing = [m for m in rng.runs if -recordings <= m < recordings]
    # The numbers in ``rng`` count away from zero, so runs without a recording come last.
    columns[..., : len(existing)] = values[..., existing]
    return columns
