"""Array types, the convention for batch axes, read-only memory, cached results, counted operations.

A state is ``(n_x, *batch)``, a covariance ``(n_x, n_x, *batch)``; ``batch`` is ``(M,)`` for M runs
and ``(M, N)`` for N particles in each of M runs. ``px, vx, py, vy = x`` then is a line of code.
"""

import ctypes
from collections import Counter
from collections.abc import Callable, Hashable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import wraps
from itertools import chain
from math import prod
from types import ModuleType
from typing import Any, Generic, Literal, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from trackbench.core import compiled

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Index = NDArray[np.intp]
T = TypeVar("T")
A = TypeVar("A", bound=np.ndarray[Any, Any])


def with_trailing(a: Array, batch_ndim: int, leading: int = 1) -> Array:
    """Append axes of length one to ``a`` until it has ``batch_ndim`` batch axes.

    ``leading`` is the number of component axes (1 for a vector, 2 for a matrix).
    """
    missing = batch_ndim + leading - a.ndim
    if missing <= 0:
        return a
    return a.reshape(a.shape + (1,) * missing)


def with_axes_of(model: Array, a: Array) -> Array:
    """Append axes of length one to ``a`` until it has as many as ``model``."""
    return with_trailing(a, model.ndim, leading=0)


def as_slice(rows: Sequence[int]) -> slice | Sequence[int]:
    """Turn evenly spaced row numbers into a slice, which needs no copy, and others into a list."""
    if len(rows) == 0:
        return []
    step = rows[1] - rows[0] if len(rows) > 1 else 1
    is_even = step > 0 and list(rows) == list(range(rows[0], rows[-1] + 1, step))
    if is_even:
        return slice(rows[0], rows[-1] + 1, step)
    return list(rows)


def settled_row(above: Mask) -> Index:
    """Return the row (M,) after the last True of each column of ``above`` (K, M), 0 if none is True."""
    rows = np.arange(1, len(above) + 1)[:, None]
    return np.asarray(np.where(above, rows, 0).max(axis=0), dtype=np.intp)


def any_nan(a: Array) -> bool:
    """Test whether any entry is NaN."""
    if compiled.kernels:
        has_nan = compiled.kernels.any_nan(a)
        if has_nan is not None:  # an array that the kernel can read
            return bool(has_nan)
    return bool(np.isnan(a).any())


def all_finite(a: Array) -> bool:
    """Test whether all entries are finite numbers."""
    if compiled.kernels:
        has_not_finite = compiled.kernels.any_not_finite(a)
        if has_not_finite is not None:  # an array that the kernel can read
            return not has_not_finite
    return bool(np.isfinite(a).all())


def choose(mask: Mask, a: Array, b: Array) -> Array:
    """Take a where the mask (*batch) is set, else b, for arrays (n, *batch) or (*batch)."""
    alike = a.shape == b.shape and a.shape[a.ndim - mask.ndim :] == mask.shape
    if compiled.kernels and alike and a.dtype == b.dtype == np.float64 and mask.dtype == np.bool_:
        out = np.empty(a.shape)
        mask = np.ascontiguousarray(mask)
        compiled.kernels.choose(mask, np.ascontiguousarray(a), np.ascontiguousarray(b), out)
        return out
    return np.where(mask, a, b)


def fixed(a: A) -> A:
    """Return the array in memory that cannot be made writable, for results that are shared.

    numpy refuses ``setflags(write=True)`` for an array over `bytes`, for its base and for its views.
    """
    if isinstance(_owner(a), bytes):
        return a
    a.flags.writeable = False  # the caller may keep the old array
    if type(a) is not np.ndarray or a.dtype.hasobject:
        return a
    # Copy the values into a `bytes` object, in the order of the array's memory.
    order: Literal["C", "F"] = "F" if a.flags.fnc else "C"
    return cast(A, np.ndarray(a.shape, a.dtype, a.tobytes(order), order=order))


def _owner(a: Any) -> Any:
    """Return the object whose memory the array shows: itself, unless it is a view."""
    owner = a
    while isinstance(owner, np.ndarray) and owner.base is not None:
        owner = owner.base
    return owner


def freeze(whole: T) -> T:
    """Replace every array in the collections and attributes of ``whole`` by a `fixed` one.

    Tuples are rebuilt; lists, dictionaries and objects keep their identity.
    """
    return _freeze(whole, {})


def _freeze(whole: Any, done: dict[int, Any]) -> Any:
    """Return ``whole`` with `fixed` arrays; ``done`` maps the id of each object to (object, result)."""
    if id(whole) in done:
        return done[id(whole)][1]
    # Enter the object before its parts, which may refer to it. The reference keeps its identity valid.
    done[id(whole)] = whole, whole
    if isinstance(whole, np.ndarray):
        done[id(whole)] = whole, fixed(whole)
    elif isinstance(whole, tuple):
        parts = [_freeze(part, done) for part in whole]
        if any(part is not old for part, old in zip(parts, whole, strict=True)):
            done[id(whole)] = whole, getattr(whole, "_make", type(whole))(parts)
    else:
        for name, part in _parts_of(whole):
            replacement = _freeze(part, done)
            if replacement is part:
                continue
            if isinstance(whole, list | dict):
                whole[name] = replacement
            else:
                # Frozen dataclasses accept this. An object that refuses keeps its read-only old array.
                with suppress(AttributeError):
                    object.__setattr__(whole, name, replacement)
    return done[id(whole)][1]


def _parts_of(whole: Any) -> list[tuple[Any, Any]]:
    """List the name (or key, or index) and value of each item or attribute of ``whole``."""
    if isinstance(whole, tuple | list):
        return list(enumerate(whole))
    if isinstance(whole, dict):
        return list(whole.items())
    if isinstance(whole, type | ModuleType):
        return []
    # Attributes of an instance, and dataclass fields that live in slots.
    names = {*getattr(whole, "__dict__", ()), *getattr(whole, "__dataclass_fields__", ())}
    return [(name, getattr(whole, name, None)) for name in names]


class Seal:
    """Copies of the memory of all `fixed` arrays in some objects, to find and undo changes.

    numpy never writes there, but a library that takes the memory's address can. The attributes of the
    package's own objects are copied too: ``object.__setattr__`` can replace those of a frozen dataclass.
    """

    def __init__(self, *wholes: Any) -> None:
        self._memory: dict[int, tuple[bytes, bytearray]] = {}
        self._attributes: list[tuple[dict[str, Any], dict[str, Any]]] = []
        waiting = [*wholes]
        visited = set[int]()
        # Walk through all parts, each of them once.
        while waiting:
            part = waiting.pop()
            owner = _owner(part)
            if isinstance(owner, bytes):
                self._memory[id(owner)] = owner, bytearray(owner)
            elif id(part) not in visited:
                visited.add(id(part))
                if type(part).__module__.startswith("trackbench.") and hasattr(part, "__dict__"):
                    self._attributes.append((vars(part), dict(vars(part))))
                waiting += [inner for _, inner in _parts_of(part)]

    def mend(self) -> bool:
        """Undo all changes of the memory and attributes; return whether there was any."""
        changed = [(memory, copy) for memory, copy in self._memory.values() if memory != copy]
        if changed:
            for cache in _results_by_identity:  # a result may come from the changed memory
                cache.clear()
        # Write the copy back to the address: numpy would refuse to write there.
        for memory, copy in changed:
            ctypes.memmove(np.frombuffer(memory, np.uint8).ctypes.data, bytes(copy), len(copy))
        replaced = False
        # Restore the attributes as they were.
        for attributes, old in self._attributes:
            replaced |= any(attributes.get(name) is not value for name, value in old.items())
            attributes.clear()  # drops values cached since then, whose origin is unknown
            attributes.update(old)
        return bool(changed) or replaced


F = TypeVar("F", bound=Callable[..., Any])

_LIMIT = 4096  # results per function, a few hundred bytes each: two tracks of 1700 steps
_caches: list[dict[Any, Any]] = []
_results_by_identity: list[dict[tuple[int, ...], tuple[tuple[Array, ...], Any]]] = []


def cached_if_constant(function: F) -> F:
    """Cache the results of a function of constant matrices; call it if a matrix has a batch axis.

    The blocks of a batch, the points of a grid and the steps of a filter in its steady state then share
    one covariance recursion. Results are read-only. They depend on the arguments' values only: the
    function always receives matrices in C order, since the order of a sum can depend on the layout.
    Arrays of `fixed`, which nothing can change, are first looked up by identity, in a quarter of the
    time that a look-up by value takes.
    """
    cache: dict[Any, Any] = {}
    by_identity: dict[tuple[int, ...], tuple[tuple[Array, ...], Any]] = {}
    _caches.append(cache)
    _results_by_identity.append(by_identity)

    @wraps(function)
    def call(*matrices: Array) -> Any:
        """Return the stored result of equal matrices, or call the function and store its result."""
        if matrices[0].ndim > 2:  # has a batch axis, so it is not constant
            return function(*matrices)
        # Look up by identity first, then by value.
        identities = tuple([id(A) for A in matrices])
        entry = by_identity.get(identities)
        if entry is not None:
            return entry[1]
        if any(A.ndim > 2 for A in matrices):
            return function(*matrices)
        # The key is the content of all matrices.
        key = tuple([(A.dtype.char, A.shape, A.tobytes()) for A in matrices])
        result = cache.get(key)
        if result is None:
            computed = function(*map(np.ascontiguousarray, matrices))
            result = tuple(map(fixed, computed)) if isinstance(computed, tuple) else fixed(computed)
            _store(cache, key, result)
        # The entry keeps the matrices alive, so that no other array gets their identities.
        if all(isinstance(_owner(A), bytes) for A in matrices):
            _store(by_identity, identities, (matrices, result))
        return result

    return cast(F, call)


def _store(cache: dict[Any, Any], key: Any, value: Any) -> None:
    """Store a value in a cache that keeps the latest results."""
    if len(cache) >= _LIMIT:
        del cache[next(iter(cache))]  # the oldest
    cache[key] = value


def cached_results() -> list[Any]:
    """List all cached results."""
    return [*chain.from_iterable(cache.values() for cache in _caches)]


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


def clear_caches() -> None:
    """Empty all caches, to measure what a new process does."""
    for cache in (*_caches, *_results_by_identity):
        cache.clear()


Operation = Literal["likelihoods", "covariances"]
"""Evaluations of a likelihood at a state; measurement updates of a covariance."""
_counts: list[Counter[Operation]] = []


@contextmanager
def counting() -> Iterator[Counter[Operation]]:
    """Count the operations that `count_operations` is called for inside this context."""
    counts: Counter[Operation] = Counter()
    _counts.append(counts)
    try:
        yield counts
    finally:
        _counts.remove(counts)


def count_operations(operation: Operation, a: Array, component_axes: int) -> None:
    """Add an operation for each batch element of ``a`` to the counts of `counting`, if any is on.

    The batch axes of ``a`` follow its ``component_axes`` first axes.
    """
    for counts in _counts:
        counts[operation] += prod(a.shape[component_axes:])
