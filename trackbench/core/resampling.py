"""Resampling, for all runs at once, from counts of offspring.

Every scheme turns weights (M, N) into offspring counts (M, N) with rows that sum to N; the ancestors
follow by ``repeat``. Nothing searches per run. A run with NaN weights is given one offspring each, so
that it stays NaN and disturbs nobody.
Douc, Cappe & Moulines (2005) compare the schemes.
"""

from collections.abc import Callable
from typing import Literal

import numpy as np

from trackbench.core.arrays import Array, Index
from trackbench.core.streams import Streams

_BITS = 40  # of the fraction in fixed-point weights: 2^23 particles in a block fit 63 bits
_ONE = float(1 << _BITS)

Scheme = Literal["systematic", "stratified", "residual", "multinomial"]


def ancestors(w: Array, rng: Streams, scheme: Scheme = "systematic") -> Index:
    """Flat indices (M, N) into the runs' particles laid end to end (row m: m N ... m N + N - 1)."""
    runs, N = w.shape
    counts = SCHEMES[scheme](w, rng)
    return np.repeat(np.arange(runs * N), counts.ravel()).reshape(runs, N)


def select(values: Array, index: Index) -> Array:
    """``values`` (..., M, N) at flat indices (M, N) from `ancestors`."""
    flat = values.reshape(*values.shape[:-2], -1)
    return flat.take(index, axis=-1)


def systematic(w: Array, rng: Streams) -> Index:
    """One uniform per run: offspring i is the number of j with C_{i-1} < (j + u) / N <= C_i.

    That is ``floor(N C_i + 1 - u)`` less the same for i - 1, in fixed-point integers: their cumulative
    sum over all runs laid end to end is one pass, four times as fast as float sums row by row.
    """
    runs, N = w.shape
    u = rng.random((runs, 1))
    lost = ~np.isfinite(w[:, -1])
    if lost.any():
        w = np.where(lost[:, None], 1.0 / N, w)
    edges = np.cumsum((w * (N * _ONE)).astype(np.int64)).reshape(runs, N)
    start = ((1.0 - u) * _ONE).astype(np.int64)
    start[1:] -= edges[:-1, -1:]  # what the rows before have summed to, rounding included
    start += np.arange(0, runs * N, N)[:, None] << _BITS
    edges += start
    edges >>= _BITS
    edges[:, -1] = np.arange(N, runs * N + 1, N)
    counts, flat = np.empty(runs * N, dtype=np.intp), edges.ravel()
    counts[0] = flat[0]
    np.subtract(flat[1:], flat[:-1], out=counts[1:])
    return counts.reshape(runs, N)


def stratified(w: Array, rng: Streams) -> Index:
    """One uniform per stratum ((j + u_j) / N)."""
    runs, N = w.shape
    u = rng.random((runs, N))
    position = N * _cumulative(w)
    stratum = np.minimum(position.astype(np.intp), N - 1)
    inside = np.take_along_axis(u, stratum, axis=-1) <= position - stratum
    return _counts(stratum + inside, N)


def multinomial(w: Array, rng: Streams) -> Index:
    """N independent draws per run."""
    runs, N = w.shape
    return _tally(_cumulative(w), rng.random((runs, N)), np.ones((runs, N), dtype=np.bool_))


def residual(w: Array, rng: Streams) -> Index:
    """``floor(N w)`` copies for certain, the rest multinomial (Liu & Chen 1998)."""
    runs, N = w.shape
    expected = N * np.where(np.isfinite(w), w, 1.0 / N)
    certain = np.floor(expected + 1e-12).astype(np.intp)  # 1/N summed N times is not quite 1
    missing = N - certain.sum(axis=-1, keepdims=True)
    rest = np.maximum(expected - certain, 0.0) + 1e-300
    cdf = _cumulative(rest / rest.sum(axis=-1, keepdims=True))
    return certain + _tally(cdf, rng.random((runs, N)), np.arange(N) < missing)


SCHEMES: dict[Scheme, Callable[[Array, Streams], Index]] = {
    "systematic": systematic,
    "stratified": stratified,
    "residual": residual,
    "multinomial": multinomial,
}


def _cumulative(w: Array) -> Array:
    """Cumulative weights that end at one; uniform where a run's weights are not finite."""
    cdf = np.cumsum(w, axis=-1)
    lost = ~np.isfinite(cdf[:, -1])
    if lost.any():
        N = w.shape[-1]
        cdf[lost] = np.arange(1, N + 1) / N
    return cdf


def _counts(edges: Array, N: int) -> Index:
    """Counts from the number of draws at or below each cumulative weight (M, N)."""
    below = np.minimum(edges, N).astype(np.intp)
    below[:, -1] = N
    return np.diff(below, axis=-1, prepend=0)


def _tally(cdf: Array, u: Array, drawn: np.typing.NDArray[np.bool_]) -> Index:
    """How many of the draws u (M, N) that are ``drawn`` fall to each particle."""
    runs, N = cdf.shape
    row = np.arange(runs)[:, None]
    # The runs' cumulative weights laid end to end are one sorted array: one search serves all.
    edges = (np.minimum(cdf, 1.0) + row).ravel()
    found = np.searchsorted(edges, (u + row)[drawn], side="left")
    last = np.broadcast_to(row * N + N - 1, (runs, N))[drawn]
    found = np.minimum(found, last)
    return np.bincount(found, minlength=runs * N).reshape(runs, N)
