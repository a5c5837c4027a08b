"""Counts of operations, also of contexts inside each other."""

import numpy as np

from trackbench.core.counted_operations import count_operations, counting


def test_a_context_inside_another_stops_counting_when_it_ends() -> None:
    """Both have equal counts at the end of the inner one."""
    x = np.zeros((2, 3, 5))
    with counting() as outer:
        with counting() as inner:
            count_operations("likelihoods", x, component_axes=1)
        count_operations("likelihoods", x, component_axes=2)
    count_operations("likelihoods", x, component_axes=1)
    assert inner == {"likelihoods": 15}
    assert outer == {"likelihoods": 20}
