"""Passes backwards in time, from all later measurements or from those of a fixed lag."""

from collections.abc import Callable, Sequence
from typing import TypeVar

S = TypeVar("S")


def backwards(
    filtered: Sequence[S], one_back: Callable[[int, S], S], lag: int | None = None
) -> list[S]:
    """Smooth the ``filtered`` state of every step, from all measurements or from ``lag`` later ones.

    ``one_back(k, later)`` returns state k given the measurements that ``later``, of step k + 1, uses.
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
