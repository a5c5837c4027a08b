"""Sign test: whether one of two filters more often has the larger value of a run."""

import numpy as np

from trackbench.core.arrays import Array, Mask
from trackbench.statistics.share_of_runs import share_z


def sign_test(a: Array | Mask, b: Array | Mask) -> float:
    """Return z of the hypothesis that two numbers are equally often the larger one of a run.

    Parameters
    ----------
    a, b
        values or masks (M,) of the runs. Runs in which they are equal, or one is NaN, do not count

    Returns
    -------
    float
        z, positive if a is more often larger; 0 if a and b are equal in all runs
    """
    larger = int(np.sum(a > b))
    smaller = int(np.sum(a < b))
    if larger + smaller == 0:
        return 0.0
    return share_z(larger, larger + smaller, 0.5)
