"""Counts of the operations that a filter spends: likelihoods, and updates of covariances."""

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
    """Count the operations that `count_operations` is called for inside this context.

    Such contexts may be nested. Each counts the operations of the contexts inside it, too.
    """
    counts: Counter[Operation] = Counter()
    _counts.append(counts)
    try:
        yield counts
    finally:
        # Remove this counter, and no other one with equal counts, as `remove` would.
        _counts[:] = [other for other in _counts if other is not counts]


def count_operations(operation: Operation, a: Array, component_axes: int) -> None:
    """Add an operation for each batch element of an array to the counts of `counting`, if any is on.

    Parameters
    ----------
    operation : str
        "likelihoods" or "covariances".
    a : array
        Array of which only the shape counts: component axes, then batch axes. Without batch axes it
        adds one operation.
    component_axes : int
        Number of component axes: 0 for numbers (*batch), 1 for vectors, 2 for matrices.
    """
    for counts in _counts:
        counts[operation] += prod(a.shape[component_axes:])
