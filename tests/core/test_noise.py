import pickle
from itertools import pairwise

import numpy as np
import pytest
from numpy.random import SFC64
from scipy import stats

from trackbench.core.noise import NoiseGenerator
from trackbench.core.streams import SomeRuns, block_stream

MANY = 4_000_000


@pytest.fixture(scope="module")
def normals() -> np.ndarray:
    return NoiseGenerator(SFC64(11)).standard_normal(MANY)


def test_normals_have_the_normals_moments(normals: np.ndarray) -> None:
    """Means of z^p within five of their standard errors."""
    for p in range(1, 9):
        expected = stats.norm.moment(p)
        variance = stats.norm.moment(2 * p) - expected**2
        assert abs(np.mean(normals**p) - expected) < 5 * np.sqrt(variance / MANY)


def test_normals_have_the_normals_distribution_and_tails(normals: np.ndarray) -> None:
    assert stats.kstest(normals[:500_000], "norm").pvalue > 1e-3
    for far in (3.0, 4.0, 4.5):
        expected = 2 * MANY * stats.norm.sf(far)
        assert abs(np.sum(np.abs(normals) > far) - expected) < 5 * np.sqrt(expected)
    # The largest of n: its distribution function is (2 Phi(x) - 1)^n.
    assert 1e-4 < (1 - 2 * stats.norm.sf(np.abs(normals).max())) ** MANY < 1 - 1e-4
    assert len(np.unique(normals[:100_000])) > 0.99 * 100_000  # 24 bits, not fewer


@pytest.mark.parametrize("lag", [1, 2, 3, 8192, 16_384])
def test_neighbours_and_the_two_of_a_pair_are_independent(normals: np.ndarray, lag: int) -> None:
    """A chunk's two halves, 8192 apart, are the cosines and sines of the same words."""
    a, b = normals[:-lag], normals[lag:]
    for f in (lambda z: z, np.square, np.abs):
        assert abs(np.corrcoef(f(a), f(b))[0, 1]) < 5 / np.sqrt(len(a))


@pytest.mark.parametrize("size", [2048, 16_383, 16_384, 16_385, 40_001, (3, 5, 1001)])
def test_normals_depend_on_state_and_size_only(size: int | tuple[int, ...]) -> None:
    first, again = block_stream(3, 0), pickle.loads(pickle.dumps(block_stream(3, 0)))
    a = first.standard_normal(size)
    kept = a.copy()
    np.testing.assert_array_equal(again.standard_normal(size), a)
    assert not np.array_equal(first.standard_normal(size), a)
    np.testing.assert_array_equal(a, kept)  # nothing handed out is scratch
    assert np.isfinite(a).all()
    assert len(np.unique(a)) > 0.99 * a.size


def test_few_variates_and_other_types_are_numpys_own() -> None:
    for draw in (
        lambda g: g.standard_normal(),
        lambda g: g.standard_normal((3, 100)),
        lambda g: g.standard_normal(5000, np.float32),
        lambda g: g.standard_normal(5000, dtype=np.float32),
        lambda g: g.normal(size=5000),
    ):
        mine, numpys = NoiseGenerator(SFC64(4)), np.random.Generator(SFC64(4))
        np.testing.assert_array_equal(draw(mine), draw(numpys))


def test_streams_of_one_block_and_of_chosen_runs_stay_apart() -> None:
    block = block_stream(5, 0)
    some = SomeRuns(block, 7, [0]).standard_normal((1, 4000))[0]
    drawn = [some, *(block_stream(5, b).standard_normal(4000) for b in range(3))]
    for a, b in pairwise(drawn):
        assert abs(np.corrcoef(a, b)[0, 1]) < 5 / np.sqrt(4000)
