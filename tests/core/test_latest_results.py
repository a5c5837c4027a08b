"""A cache of large results drops the oldest before it computes the next."""

import weakref

import numpy as np
import pytest

from trackbench.core.latest_results import LatestResults


def test_the_latest_results_are_kept() -> None:
    calls: list[int] = []
    double = LatestResults(lambda n: calls.append(n) or 2 * n, size=2)
    assert [double(n) for n in (1, 2, 1, 3, 1, 2)] == [2, 4, 2, 6, 2, 4]
    assert calls == [1, 2, 3, 2]
    double.cache_clear()
    assert double(2) == 4
    assert calls == [1, 2, 3, 2, 2]


def test_the_oldest_is_dropped_before_the_next_is_computed() -> None:
    alive: list[int] = []
    results: list[weakref.ref[np.ndarray]] = []

    def compute(n: int) -> np.ndarray:
        alive.append(sum(ref() is not None for ref in results))
        result = np.full(3, n)
        results.append(weakref.ref(result))
        return result

    latest = LatestResults(compute, size=1)
    for n in range(3):
        latest(n)
    assert alive == [0, 0, 0]


def test_an_error_is_not_cached() -> None:
    latest = LatestResults(lambda n: 1 / n, size=1)
    for _ in range(2):
        with pytest.raises(ZeroDivisionError):
            latest(0)
    assert latest(1) == 1
