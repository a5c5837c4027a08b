"""Random numbers: one stream per run for the data, one per block of runs for a filter's noise.

The data of run m depend on ``(seed, m)`` only, so truth and measurements are equal for every filter,
batch size and number of workers. Filter noise depends on ``(seed, block)``: one SFC64 stream serves a
block, because a stream costs as much to create (10 us) as half a run of ten particles. Normal and gamma
variates are made from raw words, because numpy's use the C library, whose last bit depends on the
machine.

Noise of a block comes from tables of 2^16 quantiles, looked up by 16 bits at a time. Sums and
differences of four such draws (a Hadamard matrix over two) are four uncorrelated normals. Their variance
and kurtosis are exact; probabilities beyond four standard deviations are right to 1e-3, beyond five to
1e-2, and none is beyond 8.8. A gamma variate of a small whole shape is a sum of exponentials, right to
1 % where a probability is above 1e-4. The error of a Monte Carlo filter is larger, of order 1/sqrt(N).
Truth and measurements are drawn in full float64 (`box_muller`, `erlang`).

Runs and blocks with negative numbers are for training; -1 is the first. Their streams are of another
kind, so a filter is never evaluated on the data that it was tuned on.
"""

from collections.abc import Callable, Iterable, Sequence
from functools import cache
from math import prod
from statistics import NormalDist
from typing import Any, TypeAlias, TypeVar, cast

import numpy as np
from numpy.random import SFC64, Generator, SeedSequence
from numpy.typing import NDArray

from trackbench.core import compiled, elementary
from trackbench.core.arrays import Array
from trackbench.core.read_only import fixed

D = TypeVar("D", bound=np.generic)

_DATA, _FILTER, _TRAINING_DATA, _TRAINING_FILTER, _ASIDE, _TRAINING_ASIDE = range(6)
_BESIDE = 6  # and further kinds: two for each number of `RunStreams.beside`
_CHUNK = 256  # variates drawn per run at a time; part of the definition of a run's data


class RunStreams:
    """M independent streams read side by side, for the data of M runs.

    Each run's stream is consumed in chunks of a fixed length per kind of variate, so column m does not
    depend on the other runs. Every method takes ``size = (*draws, M)`` and draws column m from run m.

    Parameters
    ----------
    seed : int
    runs : sequence of int
        Numbers of the M runs, negative for training.
    kinds : (int, int)
        Kinds of stream, of the runs and of the training runs: first numbers of their seeds' spawn keys.
    """

    def __init__(
        self, seed: int, runs: Sequence[int], kinds: tuple[int, int] = (_DATA, _TRAINING_DATA)
    ) -> None:
        """Open the stream of each run."""
        self.seed = seed
        self.runs = tuple(runs)
        sequences = (_sequence(seed, run, *kinds) for run in runs)
        self._generators = [Generator(SFC64(sequence)) for sequence in sequences]
        # By the law of the variates and its parameter: the rest (n, M) of the last chunk.
        self._waiting: dict[tuple[str, float], Array] = {}

    def standard_normal(self, size: tuple[int, ...]) -> Array:
        """Draw N(0, 1) variates (*draws, M), column m from the stream of run m."""

        def draw_chunk() -> Array:
            return box_muller(self._columns(lambda g: g.bit_generator.random_raw(_CHUNK)))

        return self._take(("normal", 0.0), draw_chunk, size)

    def random(self, size: tuple[int, ...]) -> Array:
        """Draw uniform variates (*draws, M) in [0, 1), column m from the stream of run m."""

        def draw_chunk() -> Array:
            return self._columns(lambda g: g.random(_CHUNK))

        return self._take(("uniform", 0.0), draw_chunk, size)

    def standard_gamma(self, shape: float, size: tuple[int, ...]) -> Array:
        """Draw Gamma(shape, rate 1) variates (*draws, M), column m from the stream of run m.

        They are drawn by numpy unless the shape is a small whole number (`is_erlang`).
        """
        # Gamma(n) of whole n is the sum of n exponentials, -log of a product of uniforms.
        if is_erlang(shape):
            return erlang(self.random((int(shape), *_shape(size))))

        def draw_chunk() -> Array:
            return self._columns(lambda g: g.standard_gamma(shape, _CHUNK))

        return self._take(("gamma", shape), draw_chunk, size)

    def beside(self, number: int) -> "RunStreams":
        """Open further streams of these runs, other ones for each number, beside the data's."""
        first = _BESIDE + 2 * number
        return RunStreams(self.seed, self.runs, (first, first + 1))

    def _columns(self, draw: Callable[[Generator], NDArray[D]]) -> NDArray[D]:
        """Draw a chunk of every run (_CHUNK, M)."""
        return np.stack([draw(g) for g in self._generators], axis=1)

    def _take(
        self, kind: tuple[str, float], draw_chunk: Callable[[], Array], size: tuple[int, ...]
    ) -> Array:
        """Take the next variates of a kind, in the shape ``size`` = (*draws, M).

        ``kind`` is the name of the law with its parameter, or 0.0. ``draw_chunk`` draws (_CHUNK, M).
        """
        runs = len(self._generators)
        size = _shape(size)
        if size[-1:] != (runs,):
            raise ValueError(f"draw in a shape whose last axis is the {runs} runs, not in {size}")
        count = prod(size[:-1])
        # Use the rest of the last chunk first, and keep the rest of this one.
        rows = self._waiting.get(kind, np.empty((0, runs)))
        while len(rows) < count:
            rows = np.concatenate([rows, draw_chunk()])
        self._waiting[kind] = rows[count:]
        return rows[:count].reshape(size)


Draw: TypeAlias = Callable[[Generator, tuple[int, ...]], Array]


class _Joined:
    """Base of several generators that draw together, each a share of the size."""

    def standard_normal(self, size: tuple[int, ...]) -> Array:
        """Draw N(0, 1) variates."""
        return self._join(lambda g, share: g.standard_normal(share), size)

    def random(self, size: tuple[int, ...]) -> Array:
        """Draw uniform variates in [0, 1)."""
        return self._join(lambda g, share: g.random(share), size)

    def standard_gamma(self, shape: float, size: tuple[int, ...]) -> Array:
        """Draw Gamma(shape, rate 1) variates."""
        return self._join(lambda g, share: g.standard_gamma(shape, share), size)

    def _join(self, draw: Draw, size: tuple[int, ...]) -> Array:
        """Return an array of ``size``, of which each generator draws its own part."""
        raise NotImplementedError


class SideBySide(_Joined):
    """Streams of several blocks of runs that are filtered together, each drawing for its own runs.

    ``size`` is ``(*draws, runs, N)``, the runs being those of all blocks one after another. A block's
    numbers are those that it draws alone.
    """

    def __init__(self, blocks: Sequence[Generator], width: int) -> None:
        self.blocks = blocks
        self.width = width

    def _join(self, draw: Draw, size: tuple[int, ...]) -> Array:
        """Draw variates (*draws, M, N), the runs of each block from the block's own stream.

        ``draw(stream, size)`` draws from one block's stream. M are the runs of all blocks.
        """
        size = _shape(size)
        if len(size) < 2 or size[-2] != len(self.blocks) * self.width:
            raise ValueError(f"{size} is not for {len(self.blocks)} blocks of {self.width} runs")
        share = (*size[:-2], self.width, size[-1])
        return np.concatenate([draw(g, share) for g in self.blocks], axis=-2)


def side_by_side(blocks: Sequence[Generator], width: int) -> Generator:
    """Join the streams of blocks of ``width`` runs each, so that each draws for its own runs.

    The stream of a single block is returned as it is. A joined stream has only three methods of numpy's
    generator, and is typed as one.
    """
    if len(blocks) == 1:
        return blocks[0]
    return cast(Generator, SideBySide(blocks, width))


def position_of(stream: Generator) -> list[Any]:
    """Return the position in a block's stream, or in those of several blocks, for `put_back`."""
    return [g.bit_generator.state for g in _generators_of(stream)]


def put_back(stream: Generator, position: list[Any]) -> None:
    """Return a stream to a position noted by `position_of`, from where it draws the same again."""
    for generator, state in zip(_generators_of(stream), position, strict=True):
        generator.bit_generator.state = state


def _generators_of(stream: Generator) -> Sequence[Generator]:
    """List the generators of a block's stream, or of several blocks'."""
    return stream.blocks if isinstance(stream, SideBySide) else [stream]


class SomeRuns(_Joined):
    """Streams of chosen runs of a block at one step, for draws that only some runs make.

    ``size`` is ``(*draws, runs, N)``. Each run has a substream of the block's, so its draws do not
    depend on the other runs, and the block's stream is unchanged.
    """

    def __init__(self, block: Generator, step: int, runs: Iterable[int]) -> None:
        self._generators = [_substream(block, step, int(run)) for run in runs]

    def _join(self, draw: Draw, size: tuple[int, ...]) -> Array:
        """Draw variates (*draws, M, N), those of each run from the run's own stream.

        ``draw(stream, size)`` draws from one run's stream.
        """
        size = _shape(size)
        if size[-2:-1] != (len(self._generators),):
            raise ValueError(f"{size} is not for {len(self._generators)} runs")
        # Each run draws its own row (*draws, N); the rows are stacked along the run axis.
        row = (*size[:-2], size[-1])
        return np.stack([draw(g, row) for g in self._generators], axis=-2)


def _substream(block: Generator | SideBySide, step: int, run: int) -> Generator:
    """Open the stream of a run at a step; ``run`` is its number among the runs of ``block``."""
    if isinstance(block, SideBySide):  # several blocks
        number, run = divmod(run, block.width)
        block = block.blocks[number]
    seed = block.bit_generator.seed_seq
    assert isinstance(seed, SeedSequence)
    # The key of a substream is that of the block, the step and the run.
    sequence = SeedSequence(seed.entropy, spawn_key=(*seed.spawn_key, step, run))
    return NoiseGenerator(SFC64(sequence))


def run_seeds(block: Generator, runs: int) -> list[int]:
    """Derive a number of 32 bits for each run of a block, to seed generators outside of Python."""
    seed = block.bit_generator.seed_seq
    assert isinstance(seed, SeedSequence)
    numbers = []
    for run in range(runs):
        sequence = SeedSequence(seed.entropy, spawn_key=(*seed.spawn_key, run))
        numbers.append(int(sequence.generate_state(1)[0]))
    return numbers


Streams: TypeAlias = Generator | RunStreams | SomeRuns
"""Source of random numbers: a block's generator or the streams of runs."""


def block_stream(seed: int, block: int) -> Generator:
    """Open the stream of a filter's noise in one block, equal for all filters."""
    return NoiseGenerator(SFC64(_sequence(seed, block, _FILTER, _TRAINING_FILTER)))


def aside_stream(seed: int, block: int) -> Generator:
    """Open the stream for extra steps, such as one-step predictions, beside the filter's own."""
    return NoiseGenerator(SFC64(_sequence(seed, block, _ASIDE, _TRAINING_ASIDE)))


def _sequence(seed: int, number: int, kind: int, training_kind: int) -> SeedSequence:
    """Return the seed sequence of the run or block ``number``, which is negative for training.

    ``kind`` and ``training_kind`` are the numbers of the kinds of stream, such as data or filter noise.
    """
    if number >= 0:
        return SeedSequence(seed, spawn_key=(kind, number))
    # Training runs count from -1 downwards: number -1 becomes 0.
    return SeedSequence(seed, spawn_key=(training_kind, -1 - number))


Words = NDArray[np.uint64]
Singles = NDArray[np.float32]

ERLANG = 8
"""Largest whole shape of a gamma variate that is drawn as a sum of exponentials."""
_CELLS = 1 << 16
_QUADS = 4096  # words at a time: their variates stay in the cache
_OUTERMOST = 4.412675502108261  # quantile that gives the table the normal's kurtosis
_GRAIN = 2.0**22  # entries are multiples of 1 / _GRAIN, which float32 represents exactly


class NoiseGenerator(Generator):
    """numpy's generator with portable normals and Erlang variates, made from its raw words.

    Results depend on the bit generator's state and the size only.
    """

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.bit_generator,)

    def standard_normal(self, size: Any = None, *args: Any, **kwargs: Any) -> Any:
        """Draw N(0, 1) variates; by numpy for another dtype or output array.

        ``args`` and ``kwargs`` are the further arguments of numpy's method, ``dtype`` and ``out``.
        """
        if args or kwargs:
            return super().standard_normal(size, *args, **kwargs)
        shape = _shape(size)
        # Variates come in fours, from a Hadamard transform of four table entries.
        quads = -(-prod(shape) // 4)  # rounded up
        out = np.empty(4 * quads)
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

        ``args`` and ``kwargs`` are the further arguments of numpy's method, ``dtype`` and ``out``. With
        one of them numpy draws the variates, too.
        """
        if args or kwargs or not is_erlang(shape):
            return super().standard_gamma(shape, size, *args, **kwargs)
        whole = int(shape)
        count = prod(_shape(size))
        out = np.empty(count)
        step = 4 * _QUADS
        if compiled.kernels:
            # A word gives four exponentials, and a variate is the sum of ``whole`` of them.
            words = self.bit_generator.random_raw(-(-whole * count // 4))
            compiled.kernels.erlang(exponentials(), words, out, whole)
            return out.reshape(_shape(size))[()]
        for start in range(0, count, step):
            # Sum ``whole`` exponentials for each of the next ``length`` variates.
            length = min(step, count - start)
            drawn = self._look_up(exponentials(), -(-whole * length // 4))
            piece = drawn[:length]
            for i in range(1, whole):
                piece += drawn[i * length : (i + 1) * length]
            out[start : start + length] = piece
        return out.reshape(_shape(size))[()]

    def _look_up(self, table: Singles, words: int) -> Singles:
        """Draw so many words of 64 bits; look up an entry of the table for each 16 bits, four a word."""
        index = self.bit_generator.random_raw(words).view(np.uint16)
        drawn: Singles = table.take(index, mode="clip")
        return drawn


def is_erlang(shape: Any) -> bool:
    """Test whether a gamma variate of this shape is drawn as a sum of exponentials."""
    return isinstance(shape, int | float) and shape in range(1, ERLANG + 1)


def box_muller(words: Words) -> Array:
    """Transform 64-bit words (n, M), n even, to N(0, 1) variates (Box & Muller 1958)."""
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
    """Tabulate half of the normal's quantiles at the middles of 2^16 cells of equal probability."""
    # Step 1: the positive quantiles; the outermost is moved to give the table the normal's kurtosis.
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
    """Write ``(1/2) H t`` of quarters of t to the result; the table's entries are halved already."""
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


def _shape(size: Any) -> tuple[int, ...]:
    """Return the shape that numpy's argument ``size`` stands for."""
    if size is None:
        return ()
    return tuple(size) if isinstance(size, tuple | list) else (size,)
