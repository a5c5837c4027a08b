"""Resampling, for all runs at once, from counts of offspring.

Every scheme turns weights (M, N) into offspring counts (M, N) with rows that sum to ``size``, the number
of particles wanted (N, unless the cloud is to shrink or grow); the ancestors follow by ``repeat``.
Nothing searches per run. A run with NaN weights gets the same offspring everywhere, so that it stays NaN
and disturbs nobody.
Douc, Cappe & Moulines (2005) compare the schemes.
"""

from collections.abc import Callable
from typing import Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from trackbench.core.arrays import Array, Index
from trackbench.core.random_streams import Streams
from trackbench.core.sums import total

D = TypeVar("D", np.float64, np.intp)

_BITS = 40  # of the fraction in fixed-point weights, for fewer than 2^23 offspring in a block

Scheme = Literal["systematic", "stratified", "residual", "multinomial"]


def ancestors(
    w: Array, rng: Streams, scheme: Scheme = "systematic", size: int | None = None
) -> Index:
    """Return flat indices (M, size) of ancestors: row m refers to m N ... m N + N - 1.

    ``size`` is the number of offspring, N unless given.
    """
    runs, N = w.shape
    size = size or N
    if scheme == "systematic":
        edges = _systematic_edges(w, rng, size).ravel()
        # The ancestor of offspring i is the number of edges up to i: faster than to repeat each.
        passed = np.bincount(edges[:-1], minlength=runs * size)[: runs * size]
        return np.cumsum(passed, out=passed).reshape(runs, size)
    counts = SCHEMES[scheme](w, rng, size)
    return np.repeat(np.arange(runs * N), counts.ravel()).reshape(runs, size)


def select(values: NDArray[D], index: Index) -> NDArray[D]:
    """Return ``values`` (..., M, N) at flat indices (M, size) from `ancestors`."""
    flat = values.reshape(*values.shape[:-2], -1)
    return flat.take(index, axis=-1)


def systematic(w: Array, rng: Streams, size: int) -> Index:
    """Return one uniform per run: offspring i is the number of j with C_{i-1} < (j + u) / size <= C_i.

    That is ``floor(size C_i + 1 - u)`` less the same for i - 1, in fixed-point integers:
    their cumulative sum over all runs laid end to end is one pass, four times as fast as float sums row
    by row.
    """
    edges = _systematic_edges(w, rng, size).ravel()
    return np.diff(edges, prepend=0).reshape(w.shape)


def _systematic_edges(w: Array, rng: Streams, size: int) -> Index:
    """Return the offspring (M, N) up to each particle, of all runs laid end to end."""
    runs, N = w.shape
    bits = min(_BITS, 63 - (runs * size).bit_length())  # the sum over all runs fits 63
    one = float(1 << bits)
    u = rng.random((runs, 1))
    lost = ~np.isfinite(w[:, -1])
    if lost.any():
        w = np.where(lost[:, None], 1.0 / N, w)
    edges = np.cumsum((w * (size * one)).astype(np.int64)).reshape(runs, N)
    start = ((1.0 - u) * one).astype(np.int64)
    start[1:] -= edges[:-1, -1:]  # what the rows before have summed to, rounding included
    start += np.arange(0, runs * size, size)[:, None] << bits
    edges += start
    edges >>= bits
    edges[:, -1] = np.arange(size, runs * size + 1, size)
    return edges


def stratified(w: Array, rng: Streams, size: int) -> Index:
    """Return one uniform per stratum ((j + u_j) / size)."""
    u = rng.random((len(w), size))
    position = size * _cumulative(w)
    stratum = np.minimum(position.astype(np.intp), size - 1)
    inside = np.take_along_axis(u, stratum, axis=-1) <= position - stratum
    return _counts(stratum + inside, size)


def multinomial(w: Array, rng: Streams, size: int) -> Index:
    """Return ``size`` independent draws per run."""
    shape = (len(w), size)
    return _tally(_cumulative(w), rng.random(shape), np.ones(shape, dtype=np.bool_))


def residual(w: Array, rng: Streams, size: int) -> Index:
    """Return ``floor(size w)`` copies for certain, the rest multinomial (Liu & Chen 1998)."""
    runs, N = w.shape
    expected = size * np.where(np.isfinite(w), w, 1.0 / N)
    certain = np.floor(expected + 1e-12).astype(np.intp)  # 1/N summed N times is not quite 1
    missing = size - certain.sum(axis=-1, keepdims=True)
    rest = np.maximum(expected - certain, 0.0) + 1e-300
    cdf = _cumulative(rest / total(rest)[:, None])
    return certain + _tally(cdf, rng.random((runs, size)), np.arange(size) < missing)


SCHEMES: dict[Scheme, Callable[[Array, Streams, int], Index]] = {
    "systematic": systematic,
    "stratified": stratified,
    "residual": residual,
    "multinomial": multinomial,
}


def _cumulative(w: Array) -> Array:
    """Return cumulative weights that end at one; uniform where a run's weights are not finite."""
    cdf = np.cumsum(w, axis=-1)
    lost = ~np.isfinite(cdf[:, -1])
    if lost.any():
        N = w.shape[-1]
        cdf[lost] = np.arange(1, N + 1) / N
    return cdf


def _counts(edges: Array, size: int) -> Index:
    """Return counts from the number of draws at or below each cumulative weight (M, N)."""
    below = np.minimum(edges, size).astype(np.intp)
    below[:, -1] = size
    return np.diff(below, axis=-1, prepend=0)


def _tally(cdf: Array, u: Array, drawn: np.typing.NDArray[np.bool_]) -> Index:
    """Count how many of the ``drawn`` draws u (M, size) select each particle."""
    runs, N = cdf.shape
    row = np.arange(runs)[:, None]
    # The runs' cumulative weights laid end to end are one sorted array: one search serves all.
    edges = (np.minimum(cdf, 1.0) + row).ravel()
    found = np.searchsorted(edges, (u + row)[drawn], side="left")
    last = np.broadcast_to(row * N + N - 1, u.shape)[drawn]
    found = np.minimum(found, last)
    return np.bincount(found, minlength=runs * N).reshape(runs, N)
