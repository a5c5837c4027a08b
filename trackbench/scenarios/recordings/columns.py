"""Of what all recorded runs have, the columns of those in a block."""

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.streams import RunStreams, Streams


def recorded_columns(values: Array, rng: Streams) -> Array:
    """The columns (..., M) of the runs that have these streams, NaN for runs that were not recorded.

    Training runs, -1 and so on, are the last ones: run -1 is the last of all.
    """
    assert isinstance(rng, RunStreams)
    out = np.full((*values.shape[:-1], len(rng.runs)), np.nan)
    there = [m for m in rng.runs if -values.shape[-1] <= m < values.shape[-1]]
    out[..., : len(there)] = values[..., there]
    return out
