"""Share of a recording's time that training gets, the key `train` of `score`."""

import numpy as np

from trackbench.core.arrays import Array, Index, Mask


def last_step_of_share(share: float, steps: Index, times: Array) -> int:
    """Return the number of the last training step, if training gets this share of the time.

    ``times`` (K,), s, are those of the ``steps`` (K,).
    """
    within = times - times[0] <= share * (times[-1] - times[0])
    return int(steps[np.count_nonzero(within) - 1])


def longest_training(times: Array, has_truth: Mask) -> float:
    """Return the percentage of the time below which the key `train` leaves a scored step with a truth.

    The percentage is rounded down to a whole number. ``times`` (K,), s, are those of all steps, and
    ``has_truth`` (K,) marks the steps with a truth.
    """
    # From the first step to the last one with a truth.
    last = times[has_truth][-1] - times[0]
    return float(np.floor(100.0 * last / (times[-1] - times[0])))
