"""Passes backwards in time, from all later measurements or from those of a fixed lag."""

from collections.abc import Callable, Sequence
from typing import TypeVar

S = TypeVar("S")


def backwards(
    filtered: Sequence[S], one_back: Callable[[int, S], S], lag: int | None = None
) -> list[S]:
    """Smooth the state of every step, from all later measurements or from those of a fixed lag.

    Parameters
    ----------
    filtered : sequence of K states
        State of every step, given the measurements up to this step; at least one.
    one_back : callable
        ``one_back(k, later)`` returns state k given the measurements that ``later``, the smoothed state
        of step k + 1, uses. k is an index of ``filtered``.
    lag : int, optional
        Number of later measurements that a state uses. None means all of them.

    Returns
    -------
    list of K states
        Smoothed state of every step. The last one is the filtered state.
    """
    last = len(filtered) - 1
    if lag is None:
        # All measurements: one pass from the last step back to the first.
        smoothed_states = [filtered[last]]
        for k in reversed(range(last)):
            smoothed_states.append(one_back(k, smoothed_states[-1]))
        return smoothed_states[::-1]
    smoothed_states = []
    # Fixed lag: go back from step k + lag for each step k.
    for k in range(last + 1):
        end = min(k + lag, last)
        smoothed = filtered[end]
        for j in reversed(range(k, end)):
            smoothed = one_back(j, smoothed)
        smoothed_states.append(smoothed)
    return smoothed_states
