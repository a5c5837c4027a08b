"""Normal and gamma variates from raw words, with the same last bit on every machine.

numpy's variates use the C library, whose last bit depends on the machine. Noise of a block comes from
tables of 2^16 quantiles, looked up by 16 bits at a time. Sums and differences of four such draws (a
Hadamard matrix over two) are four uncorrelated normals. Their variance and kurtosis are exact;
probabilities beyond four standard deviations are right to 1e-3, beyond five to 1e-2, and none is beyond
8.8. A gamma variate of a small whole shape is a sum of exponentials, right to 1 % where a probability is
above 1e-4. The error of a Monte Carlo filter is larger, of order 1/sqrt(N). Truth and measurements are
drawn in full float64 (`box_muller`, `erlang`).
"""

from functools import cache
from math import prod
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from trackbench.core import compiled, elementary
from trackbench.core.arrays import Array
from trackbench.core.read_only import fixed

Words = NDArray[np.uint64]
Singles = NDArray[np.float32]
ERLANG = 8
"""Largest whole shape of a gamma variate that is drawn as a sum of exponentials."""
_CELLS = 1 << 16
_QUADS = 4096  # words at a time: their variates stay in the cache
_OUTERMOST = 4.412675502108261  # quantile that gives the table the normal's kurtosis
_GRAIN = 2.0**22  # grains per 1: entries are whole grains, which float32 represents exactly


class NoiseGenerator(Generator):
    """numpy's generator with portable normals and Erlang variates, made from its raw words.

    Results depend on the bit generator's state and the size only.
    """

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.bit_generator,)

    def standard_normal(self, size: Any = None, *args: Any, **kwargs: Any) -> Any:
        """Draw N(0, 1) variates; by numpy for another dtype or output array.

        Parameters
        ----------
        size : int or tuple of int, optional
            Shape of the result. None draws a single number.
        *args, **kwargs
            Further arguments of numpy's method, ``dtype`` and ``out``.

        Returns
        -------
        array (*size) or float
            Variates.
        """
        if args or kwargs:
            return super().standard_normal(size, *args, **kwargs)
        shape = shape_of_size(size)
        # Variates come in fours, sums and differences of four table entries (Hadamard transform). The
        # entries are halved quantiles, so that a variate has the variance 4 / 4.
        quads = -(-prod(shape) // 4)  # rounded up
        out = np.empty(4 * quads)
        # The kernel and numpy give the same bits. `[()]` makes a number of the array for size None.
        if compiled.kernels:
            words = self.bit_generator.random_raw(quads)
            compiled.kernels.normals(halved_normals(), words, out)
            return out[: prod(shape)].reshape(shape)[()]
        for start in range(0, quads, _QUADS):
            end = min(start + _QUADS, quads)
            _hadamard(self._look_up(halved_normals(), end - start), out[4 * start : 4 * end])
        return out[: prod(shape)].reshape(shape)[()]

    def standard_gamma(self, shape: Any, size: Any = None, *args: Any, **kwargs: Any) -> Any:
        """Draw Gamma(shape, rate 1) variates; by numpy unless the shape is a small whole number.

        Parameters
        ----------
        shape : float or array
            Shape parameter of the gamma distribution. See `is_erlang` for small whole numbers.
        size : int or tuple of int, optional
            Shape of the result. None draws a number for each ``shape``.
        *args, **kwargs
            Further arguments of numpy's method, ``dtype`` and ``out``. With one of them numpy draws the
            variates, too.

        Returns
        -------
        array (*size) or float
            Variates.
        """
        if args or kwargs or not is_erlang(shape):
            return super().standard_gamma(shape, size, *args, **kwargs)
        whole = int(shape)
        count = prod(shape_of_size(size))
        out = np.empty(count)
        step = 4 * _QUADS
        if compiled.kernels:
            # A word gives four exponentials, and a variate is the sum of ``whole`` of them. The kernel
            # takes the words in pieces of the same length as the code below, and gives the same bits.
            words = self.bit_generator.random_raw(-(-whole * count // 4))
            compiled.kernels.erlang(exponentials(), words, out, whole)
            return out.reshape(shape_of_size(size))[()]
        for start in range(0, count, step):
            # Sum ``whole`` exponentials for each of the next ``length`` variates.
            length = min(step, count - start)
            drawn = self._look_up(exponentials(), -(-whole * length // 4))
            piece = drawn[:length]
            for i in range(1, whole):
                piece += drawn[i * length : (i + 1) * length]
            out[start : start + length] = piece
        return out.reshape(shape_of_size(size))[()]

    def _look_up(self, table: Singles, words: int) -> Singles:
        """Draw so many words of 64 bits; look up an entry of the table for each 16 bits, four a word."""
        index = self.bit_generator.random_raw(words).view(np.uint16)
        drawn: Singles = table.take(index, mode="clip")
        return drawn


def is_erlang(shape: Any) -> bool:
    """Test whether a gamma variate of this shape is drawn as a sum of exponentials."""
    return isinstance(shape, int | float) and shape in range(1, ERLANG + 1)


def box_muller(words: Words) -> Array:
    """Transform 64-bit words to N(0, 1) variates (Box & Muller 1958).

    Parameters
    ----------
    words : array (n, M) of uint64
        Words of uniform bits, n even.

    Returns
    -------
    array (n, M)
        Variates. Rows i and n / 2 + i are made of the same two words.
    """
    # r = sqrt(-2 log u1); r cos(2 pi u2) and r sin(2 pi u2) are independent normals.
    half = len(words) // 2
    r = np.sqrt(-2.0 * elementary.log(_open_unit(words[:half])))
    c, s = elementary.cos_sin(2.0 * np.pi * _open_unit(words[half:]))
    return np.concatenate([r * c, r * s])


def erlang(u: Array) -> Array:
    """Transform uniform variates (n, ...) in [0, 1) to Gamma(n, rate 1) variates (...)."""
    product = 1.0 - u[0]  # in (0, 1]: its logarithm is finite
    for more in u[1:]:
        product *= 1.0 - more
    return -elementary.log(product)


@cache
def halved_normals() -> Singles:
    """Tabulate half of the normal's quantiles at the middles of 2^16 cells of equal probability.

    They are halved, since a variate is a sum of four entries: its variance is 4 / 4.
    """
    # Step 1: the positive quantiles. The outermost is moved to give the table the normal's kurtosis,
    # which cells of one probability cut off. One number is enough for that.
    quantile = NormalDist().inv_cdf
    z = np.array([quantile((i + 0.5) / _CELLS) for i in range(_CELLS // 2, _CELLS)])
    z[-1] = _OUTERMOST
    # Step 2: scale to variance one and halve; round away the last bits of the C library.
    z = np.round(z / np.sqrt(np.square(z).mean()) * (0.5 * _GRAIN)) / _GRAIN
    return _table(np.concatenate([-z[::-1], z]))


@cache
def exponentials() -> Singles:
    """Tabulate means of a standard exponential over 2^16 cells of equal probability."""
    u = np.arange(1, _CELLS + 1) / _CELLS
    primitive = np.concatenate([[0.0], u - u * elementary.log(u)])  # of -log u
    return _table(np.diff(primitive) * _CELLS)


def _table(entries: Array) -> Singles:
    """Return a table in float32, which takes half the cache of float64."""
    return fixed(entries.astype(np.float32))


def _hadamard(t: Singles, result: Array) -> None:
    """Write H t of quarters of t to the result, H the Hadamard matrix (4, 4); t is overwritten.

    t (4 n,) are entries of `halved_normals`. The factor 1/2, by which H keeps variances, is in them.
    """
    a, b, c, d = t.reshape(4, -1)
    first, second, third, fourth = result.reshape(4, -1)
    # Step 1: a + b, a - b, and in the memory of a and b: c + d, c - d.
    a_plus_b = a + b
    a_minus_b = a - b
    c_plus_d = np.add(c, d, out=a)
    c_minus_d = np.subtract(c, d, out=b)
    # Step 2: add and subtract in float32, then copy to float64: faster than in one operation.
    first[:] = np.add(a_plus_b, c_plus_d, out=c)
    second[:] = np.subtract(a_plus_b, c_plus_d, out=c)
    third[:] = np.add(a_minus_b, c_minus_d, out=c)
    fourth[:] = np.subtract(a_minus_b, c_minus_d, out=c)


def _open_unit(words: Words) -> Array:
    """Map words to numbers strictly between zero and one, on a lattice of 2^52."""
    return ((words >> np.uint64(12)).astype(float) + 0.5) * 2.0**-52


def shape_of_size(size: Any) -> tuple[int, ...]:
    """Return the shape that numpy's argument ``size`` stands for."""
    if size is None:
        return ()
    return tuple(size) if isinstance(size, tuple | list) else (size,)
