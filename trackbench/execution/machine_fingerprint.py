"""Digests of what a machine's arithmetic returns for fixed inputs; equal digests mean equal blocks.

The package's own filters use its own arithmetic, which is identical wherever floating point follows
IEEE 754. Plugins may call any function of numpy; these depend on the processor, on the
kernels of BLAS and LAPACK, on the C library and on numpy's version.
"""

import hashlib
from collections.abc import Iterable
from contextlib import suppress
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trackbench.core import elementary, linalg, random_variates, sums
from trackbench.core.arrays import Array
from trackbench.core.random_streams import RunStreams, block_stream
from trackbench.extension_points import walk_parts
from trackbench.field_types import InvalidKeyError
from trackbench.models.base import GammaMotion, Motion
from trackbench.scenarios.base import Scenario


@cache
def own() -> str:
    """Return the digest of the package's own arithmetic on this machine."""
    x, y = _inputs()
    square, runs = x[:64].reshape(8, 8), RunStreams(1, range(3))
    stream = block_stream(1, 0)
    results: list[NDArray[np.floating[Any]]] = [
        elementary.exp(40.0 * x - 30.0),
        elementary.log(x),
        *elementary.cos_sin(20.0 * x - 10.0),
        elementary.arctan2(x - 0.5, y - 0.5),
        elementary.arctan2(0.01 * x, y + 1.0),
        sums.total(x),
        sums.dot(x.reshape(4, -1), y.reshape(4, -1)),
        sums.product(square[None], y[:64].reshape(8, 8)),
        linalg.inverse(linalg.matmul(square, square.T) + np.eye(8)),
        random_variates.halved_normals()[::97],
        random_variates.exponentials()[::97],
        stream.standard_normal(1000),
        stream.standard_gamma(3, 1000),
        stream.random(10),
        runs.standard_normal((5, 3)),
        runs.standard_gamma(3, (5, 3)),
    ]
    return _digest(results)


@cache
def numpys() -> str:
    """Return the digest of the numpy functions that a plugin may call, on this machine."""
    x, y = _inputs()
    square = x[:4096].reshape(64, 64)
    positive = square @ square.T + np.eye(64)
    functions = (np.exp, np.log, np.log1p, np.expm1, np.sin, np.cos, np.tan, np.arctan, np.sqrt)
    results = [function(a) for function in functions for a in (x, x.astype(np.float32))]
    results += [np.arctan2(x, y), np.hypot(x, y), np.power(x, y), np.add.reduce(x), x.var()]
    results += [np.vecdot(x, y), square @ square, np.einsum("ij,ij->i", square, square.T)]
    results += [np.linalg.cholesky(positive), np.linalg.inv(positive)]
    results += [np.random.default_rng(1).standard_normal(1000)]
    return _digest(results)


def hangs_on_numpys(*parts: Any) -> bool:
    """Return whether scenarios or filters compute with numpy's functions.

    Plugins do, and so does gamma noise of a shape that numpy draws.
    """
    return any(not _is_of_our_arithmetic(inner) for part in parts for inner in walk_parts(part))


def _is_of_our_arithmetic(part: Any) -> bool:
    if not type(part).__module__.startswith("trackbench."):
        return False
    motion = None
    with suppress(InvalidKeyError):  # where every filter assumes a motion of its own
        if isinstance(part, Scenario):
            motion = part.model.motion
        elif isinstance(part, Motion):
            motion = part.sampled(1.0)
    return not isinstance(motion, GammaMotion) or random_variates.is_erlang(motion.noise.shape)


def _inputs() -> tuple[Array, Array]:
    """Return two fixed arrays (8192,) of numbers inside (0, 1)."""
    n = np.arange(8192, dtype=np.uint64)
    words = (n * np.uint64(k) % np.uint64(2**32) for k in (2654435761, 2246822519))
    x, y = ((w.astype(float) + 0.5) / 2.0**32 for w in words)
    return x, y


def _digest(results: Iterable[NDArray[Any]]) -> str:
    digest = hashlib.sha256()
    for result in results:
        digest.update(np.ascontiguousarray(result).tobytes())
    return digest.hexdigest()
