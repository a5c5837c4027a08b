"""Digests of the machine's arithmetic, on which a block's numbers depend beside its code.

The package's own filters use its own arithmetic, which is identical wherever floating point follows
IEEE 754. Plugins may call any function of numpy; these depend on the processor, on the kernels of BLAS
and LAPACK, on the C library and on numpy's version.
"""

import hashlib
from collections.abc import Iterable
from contextlib import suppress
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trackbench.component_parts import walk_parts
from trackbench.core import elementary, linalg, random_variates, sums
from trackbench.core.arrays import Array
from trackbench.core.random_streams import RunStreams, block_stream
from trackbench.field_types import InvalidKeyError
from trackbench.filters.base import Filter
from trackbench.models.base import GammaMotion, Motion
from trackbench.scenarios.base import Scenario


@cache
def own_arithmetic() -> str:
    """Return the digest of results of the package's own arithmetic on this machine."""
    x, y = _inputs()
    square = x[:64].reshape(8, 8)
    runs = RunStreams(1, range(3))
    stream = block_stream(1, 0)
    # Elementary functions, sums, matrices, then random variates; of long tables every 97th number.
    results: list[NDArray[np.floating[Any]]] = [
        elementary.exp(40.0 * x - 30.0),
        elementary.log(x),
        *elementary.cos_sin(20.0 * x - 10.0),
        elementary.arctan2(x - 0.5, y - 0.5),
        elementary.arctan2(0.01 * x, y + 1.0),
        sums.total(x),
        sums.dot(x.reshape(4, -1), y.reshape(4, -1)),
        linalg.product(square[None], y[:64].reshape(8, 8)),
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
def numpy_arithmetic() -> str:
    """Return the digest of results, on this machine, of numpy functions that a plugin may call."""
    x, y = _inputs()
    square = x[:4096].reshape(64, 64)
    positive = square @ square.T + np.eye(64)
    functions = (np.exp, np.log, np.log1p, np.expm1, np.sin, np.cos, np.tan, np.arctan, np.sqrt)
    results = []
    for function in functions:
        results += [function(x), function(x.astype(np.float32))]
    results += [np.arctan2(x, y), np.hypot(x, y), np.power(x, y), np.add.reduce(x), x.var()]
    results += [np.vecdot(x, y), square @ square, np.einsum("ij,ij->i", square, square.T)]
    results += [np.linalg.cholesky(positive), np.linalg.inv(positive)]
    results += [np.random.default_rng(1).standard_normal(1000)]
    return _digest(results)


def uses_numpy_arithmetic(*parts: Any) -> bool:
    """Test whether scenarios or filters compute with numpy's functions, which differ between machines.

    Plugins may do so, and programs count as if they did. So do motions with gamma noise, unless its
    shape is a small whole number: then the package draws it as a sum of exponentials.
    """
    for part in parts:
        for inner in walk_parts(part):
            if not _uses_own_arithmetic_only(inner):
                return True
    return False


def _uses_own_arithmetic_only(component: Any) -> bool:
    """Test whether a filter, scenario or part of it calls no numpy function that differs by machine."""
    # A program computes with other libraries of this machine, and plugins may call any function.
    is_program = isinstance(component, Filter) and component.runs_program
    if is_program or not type(component).__module__.startswith("trackbench."):
        return False
    # Among the package's own parts, only gamma noise is drawn by numpy, unless it is an Erlang variate.
    motion = None
    with suppress(InvalidKeyError):  # a scenario whose filters all assume a motion has none itself
        if isinstance(component, Scenario):
            motion = component.model.motion
        elif isinstance(component, Motion):
            motion = component.sampled(1.0)  # the interval does not matter
    return not isinstance(motion, GammaMotion) or random_variates.is_erlang(motion.noise.shape)


def _inputs() -> tuple[Array, Array]:
    """Return two fixed arrays (8192,) of numbers inside (0, 1), which are hashes of 0, 1, 2, ...

    They are the arguments at which functions are evaluated, to digest the results. Other numbers would
    change the keys of all stored blocks.
    """
    n = np.arange(8192, dtype=np.uint64)
    x_words = n * np.uint64(2654435761) % np.uint64(2**32)
    y_words = n * np.uint64(2246822519) % np.uint64(2**32)
    x = (x_words.astype(float) + 0.5) / 2.0**32
    y = (y_words.astype(float) + 0.5) / 2.0**32
    return x, y


def _digest(results: Iterable[NDArray[Any]]) -> str:
    """Digest the bytes of arrays by SHA-256."""
    digest = hashlib.sha256()
    for result in results:
        digest.update(np.ascontiguousarray(result).tobytes())
    return digest.hexdigest()
