"""Note on a turn by more than half a turn between two steps."""

import numpy as np

from trackbench.core.arrays import Array

_HALF_TURN = 180.0  # deg


def turn_caution(subject: str, rate_deg_s: float, times: Array) -> str:
    """Write the note on a turn by more than half a turn between two steps.

    Parameters
    ----------
    subject : str
        The thing that turns, such as ``leg 1``.
    rate_deg_s : float
        Turn rate, deg/s.
    times : array (K,)
        Times of the steps, s.

    Returns
    -------
    str
        Note. Empty if no turn is that large.
    """
    longest = float(np.diff(times).max(initial=0.0))
    angle = abs(rate_deg_s) * longest
    if angle <= _HALF_TURN:
        return ""
    return (
        f"{subject} turns by {angle:g} deg between two steps, {longest:g} s apart: "
        "a turn rate is in degrees per second"
    )
