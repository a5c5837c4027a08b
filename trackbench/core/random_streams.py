"""Random streams: one per run for the data, one per block of runs for a filter's noise.

The data of run m depend on ``(seed, m)`` only, so truth and measurements are equal for every filter,
batch size and number of workers. Filter noise depends on ``(seed, block)``: one SFC64 stream serves a
block, because a stream costs as much to create (10 us) as half a run of ten particles. `random_variates`
makes normals and gammas of a stream's words.

Runs and blocks with negative numbers are for training; -1 is the first. Their streams are of another
kind, so a filter is never evaluated on the data that it was tuned on.
"""

from collections.abc import Callable, Iterable, Sequence
from math import prod
from typing import Any, TypeAlias, TypeVar, cast

import numpy as np
from numpy.random import SFC64, Generator, SeedSequence
from numpy.typing import NDArray

from trackbench.core.arrays import Array
from trackbench.core.random_variates import (
    NoiseGenerator,
    box_muller,
    erlang,
    is_erlang,
    shape_of_size,
)

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
        Kinds of stream: first number of the spawn key of a run's seed. The first kind is for runs, the
        second for training runs, whose numbers are negative.
    """

    def __init__(
        self, seed: int, runs: Sequence[int], kinds: tuple[int, int] = (_DATA, _TRAINING_DATA)
    ) -> None:
        """Open the stream of each run.

        Of ``kinds`` the first is that of the runs' streams, the second that of training runs' streams,
        whose numbers are negative.
        """
        self.seed = seed
        self.runs = tuple(runs)
        sequences = (_sequence(seed, run, *kinds) for run in runs)
        self._generators = [Generator(SFC64(sequence)) for sequence in sequences]
        # By the law of the variates and its parameter: the rest (n, M) of the last chunk.
        self._waiting: dict[tuple[str, float], Array] = {}

    def standard_normal(self, size: tuple[int, ...]) -> Array:
        """Draw N(0, 1) variates.

        Parameters
        ----------
        size : tuple of int
            Shape (*draws, M) of the result.

        Returns
        -------
        array (*draws, M)
            Variates, column m from the stream of run m.

        Raises
        ------
        ValueError
            If the last axis of ``size`` is not the M runs.
        """

        def draw_chunk() -> Array:
            return box_muller(self._columns(lambda g: g.bit_generator.random_raw(_CHUNK)))

        return self._take(("normal", 0.0), draw_chunk, size)

    def random(self, size: tuple[int, ...]) -> Array:
        """Draw uniform variates in [0, 1).

        Parameters
        ----------
        size : tuple of int
            Shape (*draws, M) of the result.

        Returns
        -------
        array (*draws, M)
            Variates, column m from the stream of run m.

        Raises
        ------
        ValueError
            If the last axis of ``size`` is not the M runs.
        """

        def draw_chunk() -> Array:
            return self._columns(lambda g: g.random(_CHUNK))

        return self._take(("uniform", 0.0), draw_chunk, size)

    def standard_gamma(self, shape: float, size: tuple[int, ...]) -> Array:
        """Draw Gamma(shape, rate 1) variates.

        They are drawn by numpy unless the shape is a small whole number (`is_erlang`).

        Parameters
        ----------
        shape : float
            Shape parameter of the gamma distribution, which is also its mean.
        size : tuple of int
            Shape (*draws, M) of the result.

        Returns
        -------
        array (*draws, M)
            Variates, column m from the stream of run m.

        Raises
        ------
        ValueError
            If the last axis of ``size`` is not the M runs.
        """
        # Gamma(n) of whole n is the sum of n exponentials, -log of a product of uniforms. Its bits are
        # the same on every machine, unlike those of numpy's variates, which any other shape needs.
        if is_erlang(shape):
            return erlang(self.random((int(shape), *shape_of_size(size))))

        def draw_chunk() -> Array:
            return self._columns(lambda g: g.standard_gamma(shape, _CHUNK))

        return self._take(("gamma", shape), draw_chunk, size)

    def beside(self, number: int) -> "RunStreams":
        """Open further streams of these runs, beside the data's.

        Parameters
        ----------
        number : int
            Number of the streams, 0 or more. Each number has other streams.

        Returns
        -------
        RunStreams
            Streams of the M runs.
        """
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
        size = shape_of_size(size)
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

    Parameters
    ----------
    blocks : sequence of Generator
        Stream of each block.
    width : int
        Number of runs in each block.
    """

    def __init__(self, blocks: Sequence[Generator], width: int) -> None:
        self.blocks = blocks
        self.width = width

    def _join(self, draw: Draw, size: tuple[int, ...]) -> Array:
        """Draw variates (*draws, M, N), the runs of each block from the block's own stream.

        ``draw(stream, size)`` draws from one block's stream. M are the runs of all blocks.
        """
        size = shape_of_size(size)
        if len(size) < 2 or size[-2] != len(self.blocks) * self.width:
            raise ValueError(f"{size} is not for {len(self.blocks)} blocks of {self.width} runs")
        share = (*size[:-2], self.width, size[-1])
        return np.concatenate([draw(g, share) for g in self.blocks], axis=-2)


def side_by_side(blocks: Sequence[Generator], width: int) -> Generator:
    """Join the streams of blocks, so that each draws for its own runs.

    Parameters
    ----------
    blocks : sequence of Generator
        Stream of each block.
    width : int
        Number of runs in each block.

    Returns
    -------
    Generator
        The stream of a single block as it is, or else a `SideBySide`. This has only three methods of
        numpy's generator, and is typed as one.
    """
    if len(blocks) == 1:
        return blocks[0]
    return cast(Generator, SideBySide(blocks, width))


def position_of(stream: Generator) -> list[Any]:
    """Return the position in a block's stream, or in those of several blocks, for `put_back`."""
    return [g.bit_generator.state for g in _generators_of(stream)]


def put_back(stream: Generator, position: list[Any]) -> None:
    """Return a stream to an earlier position, from where it draws the same again.

    Parameters
    ----------
    stream : Generator
        Stream of a block, or of several blocks as `side_by_side` returns it.
    position : list
        Position that `position_of` returned for this stream.
    """
    for generator, state in zip(_generators_of(stream), position, strict=True):
        generator.bit_generator.state = state


def _generators_of(stream: Generator) -> Sequence[Generator]:
    """List the generators of a block's stream, or of several blocks'."""
    return stream.blocks if isinstance(stream, SideBySide) else [stream]


class SomeRuns(_Joined):
    """Streams of chosen runs of a block at one step, for draws that only some runs make.

    ``size`` is ``(*draws, runs, N)``. Each run has a substream of the block's, so its draws do not
    depend on the other runs, and the block's stream is unchanged.

    Parameters
    ----------
    block : Generator
        Stream of a block, or of several blocks as `side_by_side` returns it.
    step : int
        Number of the step.
    runs : iterable of int
        Numbers of the chosen runs, counted from 0 in ``block``.
    """

    def __init__(self, block: Generator, step: int, runs: Iterable[int]) -> None:
        self._generators = [_substream(block, step, int(run)) for run in runs]

    def _join(self, draw: Draw, size: tuple[int, ...]) -> Array:
        """Draw variates (*draws, M, N), those of each run from the run's own stream.

        ``draw(stream, size)`` draws from one run's stream.
        """
        size = shape_of_size(size)
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


Streams: TypeAlias = Generator | RunStreams | SomeRuns
"""Source of random numbers: a block's generator or the streams of runs."""


def block_stream(seed: int, block: int) -> Generator:
    """Open the stream of a filter's noise in one block, equal for all filters.

    Parameters
    ----------
    seed : int
        Seed of the experiment.
    block : int
        Number of the block of runs, negative for training.

    Returns
    -------
    NoiseGenerator
        Stream, at its beginning.
    """
    return NoiseGenerator(SFC64(_sequence(seed, block, _FILTER, _TRAINING_FILTER)))


def aside_stream(seed: int, block: int) -> Generator:
    """Open the stream for extra steps, such as one-step predictions, beside the filter's own.

    Parameters
    ----------
    seed : int
        Seed of the experiment.
    block : int
        Number of the block of runs, negative for training.

    Returns
    -------
    NoiseGenerator
        Stream, at its beginning.
    """
    return NoiseGenerator(SFC64(_sequence(seed, block, _ASIDE, _TRAINING_ASIDE)))


def _sequence(seed: int, number: int, kind: int, training_kind: int) -> SeedSequence:
    """Return the seed sequence of the run or block ``number``, which is negative for training.

    ``kind`` and ``training_kind`` are the numbers of the kinds of stream, such as data or filter noise.
    """
    if number >= 0:
        return SeedSequence(seed, spawn_key=(kind, number))
    # Training runs count from -1 downwards: number -1 becomes 0.
    return SeedSequence(seed, spawn_key=(training_kind, -1 - number))
