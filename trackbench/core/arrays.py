"""The two array types of the package, and what a batch axis is.

A state is ``(n_x, *batch)``, a covariance ``(n_x, n_x, *batch)``; ``batch`` is ``(M,)`` for M runs
and ``(M, N)`` for N particles in each of M runs. ``px, vx, py, vy = x`` then is a line of code.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Index = NDArray[np.intp]


def with_trailing(a: Array, batch_ndim: int, leading: int = 1) -> Array:
    """``a`` with axes of length one appended until it has ``batch_ndim`` batch axes.

    ``leading`` is the number of component axes (1 for a vector, 2 for a matrix).
    """
    return a.reshape(a.shape + (1,) * (batch_ndim + leading - a.ndim))


def fixed(a: Array) -> Array:
    """``a`` itself, made read-only, for arrays that are kept and handed out again."""
    a.flags.writeable = False
    return a
