"""Random numbers: one stream per run for the data, one per block of runs for a filter's noise.

The data of run m depend on ``(seed, m)`` only, so every filter, batch size and worker count sees the
same truth and measurements. Filter noise depends on ``(seed, block)``: one SFC64 stream for the whole
block, because a stream per run costs as much to create (10 us) as half a run of ten particles. Both
are made of raw words (`noise`), data in full float64, a block's noise by tables: numpy's own methods
for other than uniform variates take the C library's functions, whose last bit is not the same
everywhere.

Runs and blocks of negative number are for training: -1 is the first of them. Their streams are of
another kind, so that no filter can be judged on what it was tuned on, however many runs there are.
"""

from collections.abc import Callable, Iterable, Sequence
from math import prod
from typing import TypeAlias, TypeVar

import numpy as np
from numpy.random import SFC64, Generator, SeedSequence
from numpy.typing import NDArray

from trackbench.core.arrays import Array
from trackbench.core.random_variates import NoiseGenerator, box_muller, erlang, is_erlang

D = TypeVar("D", bound=np.generic)

_DATA, _FILTER, _TRAINING_DATA, _TRAINING_FILTER, _ASIDE, _TRAINING_ASIDE = range(6)
_CHUNK = 256  # variates drawn per run at a time; part of the definition of a run's data


class RunStreams:
    """M independent streams read side by side: ``size`` is ``(*draws, M)``, column m from run m.

    Each run's stream is consumed in chunks of a fixed length per kind of variate, so column m does
    not depend on which other runs stand beside it.
    """

    def __init__(self, seed: int, runs: Sequence[int]) -> None:
        self.runs = tuple(runs)
        self._generators = [
            Generator(SFC64(_sequence(seed, run, _DATA, _TRAINING_DATA))) for run in runs
        ]
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
        """Return Gamma(shape, rate 1) variates; numpy's own unless the shape is a small whole number."""
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
        wanted = prod(size[:-1])
        rows = self._waiting.get(kind, np.empty((0, runs)))
        while len(rows) < wanted:
            rows = np.concatenate([rows, more()])
        self._waiting[kind] = rows[wanted:]
        return rows[:wanted].reshape(size)


class SomeRuns:
    """Streams of chosen runs of a block at one step, for draws that not every run makes.

    ``size`` is ``(*draws, runs, N)``; each run's row comes from a stream of its own under the block's,
    so that it does not depend on which other runs draw, and the block's own stream goes on untouched.
    """

    def __init__(self, block: Generator, step: int, runs: Iterable[int]) -> None:
        seed = block.bit_generator.seed_seq
        assert isinstance(seed, SeedSequence)
        self._generators = [
            NoiseGenerator(
                SFC64(SeedSequence(seed.entropy, spawn_key=(*seed.spawn_key, step, int(run))))
            )
            for run in runs
        ]

    def standard_normal(self, size: tuple[int, ...]) -> Array:
        """Return N(0, 1) variates."""
        return self._each(lambda g, shape: g.standard_normal(shape), size)

    def random(self, size: tuple[int, ...]) -> Array:
        """Return uniform variates in [0, 1)."""
        return self._each(lambda g, shape: g.random(shape), size)

    def standard_gamma(self, shape: float, size: tuple[int, ...]) -> Array:
        """Return Gamma(shape, rate 1) variates."""
        return self._each(lambda g, each: g.standard_gamma(shape, each), size)

    def _each(
        self, draw: Callable[[Generator, tuple[int, ...]], Array], size: tuple[int, ...]
    ) -> Array:
        if size[-2] != len(self._generators):
            raise ValueError(f"{size} is not for {len(self._generators)} runs")
        each = (*size[:-2], size[-1])
        return np.stack([draw(g, each) for g in self._generators], axis=-2)


Streams: TypeAlias = Generator | RunStreams | SomeRuns
"""What a distribution samples from: a block's generator or the runs' own streams."""


def block_stream(seed: int, block: int) -> Generator:
    """Yield the stream of a filter's noise in one block, the same for every filter of that width."""
    return NoiseGenerator(SFC64(_sequence(seed, block, _FILTER, _TRAINING_FILTER)))


def aside_stream(seed: int, block: int) -> Generator:
    """Yield the stream of steps that a filter is asked to take and that are not its own."""
    return NoiseGenerator(SFC64(_sequence(seed, block, _ASIDE, _TRAINING_ASIDE)))


def _sequence(seed: int, number: int, kind: int, training: int) -> SeedSequence:
    """Return the seed sequence of a run or block; negative numbers are training runs."""
    key = (kind, number) if number >= 0 else (training, -1 - number)
    return SeedSequence(seed, spawn_key=key)
