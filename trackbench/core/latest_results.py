"""Cache of the latest results of a function, for results of many megabytes."""

from collections.abc import Callable, Hashable
from typing import Generic

from trackbench.core.arrays import T


class LatestResults(Generic[T]):
    """Cache of the ``size`` results of a function that were used last, for results of many megabytes.

    Before a result is computed the one that was not used for longest is dropped. Threads may share the
    cache; two may then compute the same result.
    """

    def __init__(self, function: Callable[..., T], size: int) -> None:
        self._function = function
        self.size = size
        self._results: dict[tuple[Hashable, ...], T] = {}

    def __call__(self, *key: Hashable) -> T:
        """Look up the cached result of these arguments, or compute it."""
        result = self._results.pop(key, None)
        if result is None:
            surplus = max(0, len(self._results) + 1 - self.size)
            for oldest in [*self._results][:surplus]:
                self._results.pop(oldest, None)
            result = self._function(*key)
        self._results[key] = result  # the latest is the last one
        return result

    def cached(self, *key: Hashable) -> T | None:
        """Look up the result of these arguments without computing it."""
        return self._results.get(key)

    def cache_clear(self) -> None:
        """Drop all results."""
        self._results.clear()
