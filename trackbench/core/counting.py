"""Counts of a filter's operations, taken only within `counting`."""

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from math import prod
from typing import Literal

from trackbench.core.arrays import Array

Operation = Literal["likelihoods", "covariances"]
"""Evaluations of a likelihood at a state; measurement updates of a covariance."""
_counts: list[Counter[Operation]] = []


@contextmanager
def counting() -> Iterator[Counter[Operation]]:
    """Count the operations that the kernels note inside this context."""
    counts: Counter[Operation] = Counter()
    _counts.append(counts)
    try:
        yield counts
    finally:
        _counts.remove(counts)


def note(operation: Operation, of: Array, components: int) -> None:
    """Note one operation per batch element of ``of``, which has so many component axes."""
    for counts in _counts:
        counts[operation] += prod(of.shape[components:])
