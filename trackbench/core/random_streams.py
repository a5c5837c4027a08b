"""Random numbers: one stream per run for the data, one per block of runs for a filter's noise.

The data of run m depend on ``(seed, m)`` only, so truth and measurements are equal for every filter,
batch size and number of workers. Filter noise depends on ``(seed, block)``: one SFC64 stream serves a
block, because a stream costs as much to create (10 us) as half a run of ten particles. Both are made
from raw words (`random_variates`), because numpy's normals and gammas use the C library, whose last bit
depends on the machine.

Runs and blocks with negative numbers are for training; -1 is the first. Their streams are of another
kind, so a filter is never evaluated on the data that it was tuned on.
"""

from collections.abc import Callable, Iterable, Sequence
from math import prod
from typing import TypeAlias, TypeVar, cast

import numpy as np
from numpy.random import SFC64, Generator, SeedSequence
from numpy.typing import NDArray

from trackbench.core.arrays import Array
from trackbench.core.random_variates import NoiseGenerator, box_muller, erlang, is_erlang

D = TypeVar("D", bound=np.generic)

_DATA, _FILTER, _TRAINING_DATA, _TRAINING_FILTER, _ASIDE, _TRAINING_ASIDE = range(6)
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
    """

    def __init__(self, seed: int, runs: Sequence[int]) -> None:
        self.runs = tuple(runs)
        sequences = (_sequence(seed, run, _DATA, _TRAINING_DATA) for run in runs)
        self._generators = [Generator(SFC64(sequence)) for sequence in sequences]
        self._waiting: dict[tuple[str, float], Array] = {}

    def standard_normal(self, size: tuple[int, ...]) -> Array:
        """Return N(0, 1) variates."""
        return self._take(
            ("normal", 0.0),
            lambda: box_muller(self._columns(lambda g: g.bit_generator.random_raw(_CHUNK))),
            size,
        )

    def random(self, size: tuple[int, ...]) -> Array:
        """Return uniform variates in [0, 1)."""
        return self._take(("uniform", 0.0), lambda: self._columns(lambda g: g.random(_CHUNK)), size)

    def standard_gamma(self, shape: float, size: tuple[int, ...]) -> Array:
        """Return Gamma(shape, rate 1) variates; by numpy unless the shape is a small whole number."""
        # Gamma(n) of whole n is the sum of n exponentials, -log of a product of uniforms.
        if is_erlang(shape):
            return erlang(self.random((int(shape), *size)))
        return self._take(
            ("gamma", shape),
            lambda: self._columns(lambda g: g.standard_gamma(shape, _CHUNK)),
            size,
        )

    def _columns(self, draw: Callable[[Generator], NDArray[D]]) -> NDArray[D]:
        """Return a chunk of every run (_CHUNK, M)."""
        return np.stack([draw(g) for g in self._generators], axis=1)

    def _take(
        self, kind: tuple[str, float], more: Callable[[], Array], size: tuple[int, ...]
    ) -> Array:
        """Return the next variates of a kind; ``more`` draws (_CHUNK, M) of them."""
        runs = len(self._generators)
        if size[-1] != runs:
            raise ValueError(f"the last axis of {size} must be the {runs} runs")
        count = prod(size[:-1])
        # Use the rest of the last chunk first, and keep the rest of this one.
        rows = self._waiting.get(kind, np.empty((0, runs)))
        while len(rows) < count:
            rows = np.concatenate([rows, more()])
        self._waiting[kind] = rows[count:]
        return rows[:count].reshape(size)


class SideBySide:
    """Streams of several blocks of runs that are filtered together, each drawing for its own runs.

    ``size`` is ``(*draws, runs, N)``, the runs being those of all blocks one after another. A block's
    numbers are those that it draws alone.
    """

    def __init__(self, blocks: Sequence[Generator], width: int) -> None:
        self.blocks, self.width = blocks, width

    def standard_normal(self, size: tuple[int, ...]) -> Array:
        """Return N(0, 1) variates."""
        return self._join(lambda g, part: g.standard_normal(part), size)

    def random(self, size: tuple[int, ...]) -> Array:
        """Return uniform variates in [0, 1)."""
        return self._join(lambda g, part: g.random(part), size)

    def standard_gamma(self, shape: float, size: tuple[int, ...]) -> Array:
        """Return Gamma(shape, rate 1) variates."""
        return self._join(lambda g, part: g.standard_gamma(shape, part), size)

    def _join(
        self, draw: Callable[[Generator, tuple[int, ...]], Array], size: tuple[int, ...]
    ) -> Array:
        if len(size) < 2 or size[-2] != len(self.blocks) * self.width:
            raise ValueError(f"{size} is not for {len(self.blocks)} blocks of {self.width} runs")
        part = (*size[:-2], self.width, size[-1])
        return np.concatenate([draw(g, part) for g in self.blocks], axis=-2)


def side_by_side(blocks: Sequence[Generator], width: int) -> Generator:
    """Return one stream for blocks of so many runs; typed as numpy's, whose draws it has three of."""
    return blocks[0] if len(blocks) == 1 else cast(Generator, SideBySide(blocks, width))


class SomeRuns:
    """Streams of chosen runs of a block at one step, for draws that only some runs make.

    ``size`` is ``(*draws, runs, N)``. Each run has a substream of the block's, so its draws do not
    depend on the other runs, and the block's stream is unchanged.
    """

    def __init__(self, block: Generator, step: int, runs: Iterable[int]) -> None:
        self._generators = [_substream(block, step, int(run)) for run in runs]

    def standard_normal(self, size: tuple[int, ...]) -> Array:
        """Return N(0, 1) variates."""
        return self._stack(lambda g, row: g.standard_normal(row), size)

    def random(self, size: tuple[int, ...]) -> Array:
        """Return uniform variates in [0, 1)."""
        return self._stack(lambda g, row: g.random(row), size)

    def standard_gamma(self, shape: float, size: tuple[int, ...]) -> Array:
        """Return Gamma(shape, rate 1) variates."""
        return self._stack(lambda g, row: g.standard_gamma(shape, row), size)

    def _stack(
        self, draw: Callable[[Generator, tuple[int, ...]], Array], size: tuple[int, ...]
    ) -> Array:
        if size[-2] != len(self._generators):
            raise ValueError(f"{size} is not for {len(self._generators)} runs")
        # Each run draws its own row (*draws, N); the rows are stacked along the run axis.
        row = (*size[:-2], size[-1])
        return np.stack([draw(g, row) for g in self._generators], axis=-2)


def _substream(block: Generator | SideBySide, step: int, run: int) -> Generator:
    """Return the stream of a run at a step, by its number within its block."""
    if isinstance(block, SideBySide):
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
    """Return the stream of a filter's noise in one block, equal for all filters.

    Parameters
    ----------
    seed : int
        Seed of the experiment.
    block : int
        Number of the block, negative for training.

    Returns
    -------
    Generator
        SFC64 stream with portable normals and Erlang variates.
    """
    return NoiseGenerator(SFC64(_sequence(seed, block, _FILTER, _TRAINING_FILTER)))


def aside_stream(seed: int, block: int) -> Generator:
    """Return the stream for extra steps, such as one-step predictions, beside the filter's own."""
    return NoiseGenerator(SFC64(_sequence(seed, block, _ASIDE, _TRAINING_ASIDE)))


def _sequence(seed: int, number: int, kind: int, training: int) -> SeedSequence:
    """Return the seed sequence of a run or block; negative numbers are training runs."""
    # Training runs count from -1 downwards: number -1 becomes 0.
    key = (kind, number) if number >= 0 else (training, -1 - number)
    return SeedSequence(seed, spawn_key=key)
