"""Resampling, for all runs at once, from counts of offspring.

Every scheme turns weights (M, N) into offspring counts (M, N) whose rows sum to ``size``, the number of
new particles; the ancestors follow by ``repeat``. A run with NaN weights is resampled with equal
weights, so it stays NaN and leaves other runs unchanged. Douc, Cappe & Moulines (2005) compare schemes.
"""

from collections.abc import Callable
from typing import Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from trackbench.core import compiled
from trackbench.core.arrays import Array, Index
from trackbench.core.random_streams import Streams
from trackbench.core.sums import total

D = TypeVar("D", np.float64, np.intp)

_BITS = 40  # of the fraction in fixed-point weights, for fewer than 2^23 offspring in a block

Scheme = Literal["systematic", "stratified", "residual", "multinomial"]


def ancestors(
    w: Array, rng: Streams, scheme: Scheme = "systematic", size: int | None = None
) -> Index:
    """Draw the ancestors of resampled particles.

    Parameters
    ----------
    w : array (M, N)
        Normalized weights.
    rng : Streams
        Random numbers.
    scheme : {"systematic", "stratified", "residual", "multinomial"}
        Resampling scheme.
    size : int, optional
        Number of new particles per run, by default N.

    Returns
    -------
    array (M, size)
        Flat indices for `select`: row m refers to m N ... m N + N - 1.
    """
    runs, N = w.shape
    size = size or N
    if scheme == "systematic" and compiled.kernels and w.dtype == np.float64:
        u = rng.random((runs, 1))
        index = np.empty((runs, size), dtype=np.intp)
        compiled.kernels.ancestors(
            np.ascontiguousarray(w), u, index, size, _fraction_bits(runs, size)
        )
        return index
    if scheme == "systematic":
        # An edge is the number of offspring up to and with a particle, counted on from run to run.
        edges = _systematic_edges(w, rng, size).ravel()
        # The ancestor of offspring i is the number of edges up to i, which is faster than `repeat`. The
        # last edge, and any other edge that is equal to runs * size, comes after all offspring: these
        # are left out of the counts.
        steps = np.bincount(edges[:-1], minlength=runs * size)[: runs * size]
        return np.cumsum(steps, out=steps).reshape(runs, size)
    counts = SCHEMES[scheme](w, rng, size)
    return np.repeat(np.arange(runs * N), counts.ravel()).reshape(runs, size)


def select(values: NDArray[D], index: Index) -> NDArray[D]:
    """Select values of the ancestors.

    Parameters
    ----------
    values : array (..., M, N)
        Values of the particles, such as states (n, M, N) or covariances (n, n, M, N).
    index : array (M, size)
        Flat indices from `ancestors`.

    Returns
    -------
    array (..., M, size)
        Values of the new particles, a new array.
    """
    if compiled.kernels and values.dtype == np.float64 and values.size and index.size:
        out = np.empty((*values.shape[:-2], *index.shape))
        compiled.kernels.select(np.ascontiguousarray(values), np.ascontiguousarray(index), out)
        return out
    flat = values.reshape(*values.shape[:-2], -1)
    return flat.take(index, axis=-1)


def systematic(w: Array, rng: Streams, size: int) -> Index:
    """Count offspring by one uniform u per run: the j with C_{i-1} < (j + u) / size <= C_i.

    Parameters
    ----------
    w : array (M, N)
        Normalized weights, whose sums C_i are cumulative. Weights of NaN count as equal.
    rng : Streams
        Random numbers.
    size : int
        Number of new particles per run.

    Returns
    -------
    array (M, N)
        Number of offspring of each particle. Each row has the sum ``size``.
    """
    edges = _systematic_edges(w, rng, size).ravel()
    return np.diff(edges, prepend=0).reshape(w.shape)


def _systematic_edges(w: Array, rng: Streams, size: int) -> Index:
    """Count the offspring up to each particle (M, N), on from run to run.

    Within a run it is ``floor(size C_i + 1 - u)``, C_i the sum of the first i weights. One cumulative
    sum of fixed-point integers over all runs is four times as fast as float sums row by row.
    """
    # Step 1: choose a fixed point such that the sum over all runs fits 63 bits.
    runs, N = w.shape
    bits = _fraction_bits(runs, size)
    unit = float(1 << bits)
    u = rng.random((runs, 1))
    # A run that has diverged has NaN for all its weights (`normalize`): the last one shows it.
    diverged = ~np.isfinite(w[:, -1])
    if diverged.any():
        w = np.where(diverged[:, None], 1.0 / N, w)
    # Step 2: sum size w over all runs; each run starts at m size + 1 - u.
    edges = np.cumsum((w * (size * unit)).astype(np.int64)).reshape(runs, N)
    start = ((1.0 - u) * unit).astype(np.int64)
    start[1:] -= edges[:-1, -1:]  # the sum of the rows before, rounding included
    start += np.arange(0, runs * size, size)[:, None] << bits
    # Step 3: floor; the last edge of a run is exact.
    edges += start
    edges >>= bits
    edges[:, -1] = np.arange(size, runs * size + 1, size)
    return edges


def _fraction_bits(runs: int, size: int) -> int:
    """Return the bits of the fraction of fixed-point weights, such that all runs' sum fits 63 bits."""
    return min(_BITS, 63 - (runs * size).bit_length())


def stratified(w: Array, rng: Streams, size: int) -> Index:
    """Count offspring by one uniform u_j per stratum, at (j + u_j) / size.

    Parameters
    ----------
    w : array (M, N)
        Normalized weights. Weights of NaN count as equal.
    rng : Streams
        Random numbers.
    size : int
        Number of new particles per run, and of strata.

    Returns
    -------
    array (M, N)
        Number of offspring of each particle. Each row has the sum ``size``.
    """
    u = rng.random((len(w), size))
    # Step 1: count the draws up to each cumulative weight; only that of its own stratum is uncertain.
    position = size * _cumulative(w)
    stratum = np.minimum(position.astype(np.intp), size - 1)
    inside = np.take_along_axis(u, stratum, axis=-1) <= position - stratum
    below = np.minimum(stratum + inside, size).astype(np.intp)
    below[:, -1] = size
    # Step 2: the differences are the offspring.
    return np.diff(below, axis=-1, prepend=0)


def multinomial(w: Array, rng: Streams, size: int) -> Index:
    """Count offspring by ``size`` independent draws per run.

    Parameters
    ----------
    w : array (M, N)
        Normalized weights. Weights of NaN count as equal.
    rng : Streams
        Random numbers.
    size : int
        Number of new particles per run.

    Returns
    -------
    array (M, N)
        Number of offspring of each particle. Each row has the sum ``size``.
    """
    shape = (len(w), size)
    return _tally(_cumulative(w), rng.random(shape), np.ones(shape, dtype=np.bool_))


def residual(w: Array, rng: Streams, size: int) -> Index:
    """Count ``floor(size w)`` certain offspring, and the rest multinomial (Liu & Chen 1998).

    Parameters
    ----------
    w : array (M, N)
        Normalized weights. Weights of NaN count as equal.
    rng : Streams
        Random numbers.
    size : int
        Number of new particles per run.

    Returns
    -------
    array (M, N)
        Number of offspring of each particle. Each row has the sum ``size``.
    """
    # Step 1: the certain copies. A weight that is not finite counts as 1 / N.
    runs, N = w.shape
    expected = size * np.where(np.isfinite(w), w, 1.0 / N)
    certain = np.floor(expected + 1e-12).astype(np.intp)  # 1/N summed N times is not quite 1
    # Step 2: draw the missing ones from the remaining weights.
    missing = size - certain.sum(axis=-1, keepdims=True)
    # 1e-300 keeps their sum positive where none is missing.
    rest = np.maximum(expected - certain, 0.0) + 1e-300
    cdf = _cumulative(rest / total(rest)[:, None])
    # Of the draws only the first `missing` ones of a run count.
    return certain + _tally(cdf, rng.random((runs, size)), np.arange(size) < missing)


SCHEMES: dict[Scheme, Callable[[Array, Streams, int], Index]] = {
    "systematic": systematic,
    "stratified": stratified,
    "residual": residual,
    "multinomial": multinomial,
}


def _cumulative(w: Array) -> Array:
    """Return cumulative weights (M, N); those of equal weights in a run whose w are not finite."""
    cdf = np.cumsum(w, axis=-1)
    diverged = ~np.isfinite(cdf[:, -1])
    if diverged.any():
        N = w.shape[-1]
        cdf[diverged] = np.arange(1, N + 1) / N
    return cdf


def _tally(cdf: Array, u: Array, drawn: np.typing.NDArray[np.bool_]) -> Index:
    """Count how many of the draws u (M, size) select each particle.

    ``cdf`` (M, N) are cumulative weights, and ``drawn`` (M, size) marks the draws that count. A draw
    selects the first particle whose cumulative weight is not below it. u is uniform in [0, 1). A draw
    u = 0 selects the first particle that has a weight.
    """
    runs, N = cdf.shape
    row = np.arange(runs)[:, None]
    # The cumulative weights of all runs, end to end, are one sorted array: search it once.
    edges = (np.minimum(cdf, 1.0) + row).ravel()
    selected = np.searchsorted(edges, (u + row)[drawn], side="left")
    # A draw beyond the last sum, which rounding leaves below one, selects the last particle.
    last = np.broadcast_to(row * N + N - 1, u.shape)[drawn]
    selected = np.minimum(selected, last)
    # A draw u = 0, or one that rounds to it in ``u + row``, may be found in the run before, or at a
    # particle of zero weight.
    with_weight = row * N + (cdf > 0.0).argmax(axis=-1)[:, None]
    selected = np.maximum(selected, np.broadcast_to(with_weight, u.shape)[drawn])
    return np.bincount(selected, minlength=runs * N).reshape(runs, N)
