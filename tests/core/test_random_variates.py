import pickle
from itertools import combinations

import numpy as np
import pytest
from numpy.random import SFC64
from scipy import signal, special, stats

from trackbench.core import random_variates
from trackbench.core.random_streams import RunStreams, SomeRuns, block_stream
from trackbench.core.random_variates import NoiseGenerator, halved_normals

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
    assert len(np.unique(normals[:100_000])) > 0.99 * 100_000


@pytest.mark.parametrize("lag", [1, 2, 3, 4096, 8192, 12_288, 16_384])
def test_neighbors_and_the_four_of_a_word_are_independent(normals: np.ndarray, lag: int) -> None:
    """A piece's quarters, 4096 apart, are sums and differences of the same four entries."""
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


def test_other_types_and_other_shapes_are_numpys_own() -> None:
    for draw in (
        lambda g: g.standard_normal(5000, np.float32),
        lambda g: g.standard_normal(5000, dtype=np.float32),
        lambda g: g.normal(size=5000),
        lambda g: g.standard_gamma(2.5, 100),
        lambda g: g.standard_gamma(np.array([1.0, 2.0])),
        lambda g: g.random(7),
    ):
        mine, numpys = NoiseGenerator(SFC64(4)), np.random.Generator(SFC64(4))
        np.testing.assert_array_equal(draw(mine), draw(numpys))


def test_normals_of_the_table_are_as_near_the_normal_as_is_said() -> None:
    """Without sampling: probabilities of a sum of two sums of two entries, on a fine lattice."""
    table, grain = halved_normals().astype(float), 2.0**-13
    assert 4.0 * np.mean(table**2) == pytest.approx(1.0, abs=1e-6)
    assert 16.0 * np.mean(table**4) == pytest.approx(3.0, abs=1e-5)
    position = (table - table[0]) / grain
    cell = np.floor(position).astype(int)
    share = position - cell  # shared between two neighbors, so that means are kept
    one = np.bincount(cell, 1.0 - share, cell.max() + 2) + np.bincount(cell + 1, share)
    two = np.maximum(signal.fftconvolve(one, one), 0.0) / len(table) ** 2
    x = 2.0 * table[0] + grain * np.arange(len(two))
    above = np.append(np.cumsum(two[::-1])[::-1], 0.0)
    for far, error in ((2.0, 3e-4), (3.0, 7e-4), (4.0, 1.5e-3), (5.0, 1.2e-2)):
        first = np.clip(np.round((far - x - x[0]) / grain).astype(int), 0, len(two))
        found = float(np.sum(two * above[first]))
        assert found == pytest.approx(stats.norm.sf(far), rel=error)


def test_erlang_variates_of_a_block_and_of_runs() -> None:
    for shape in (1, 2, 3, 8):
        drawn = NoiseGenerator(SFC64(5)).standard_gamma(shape, 200_000)
        exact = RunStreams(6, range(500)).standard_gamma(shape, (400, 500)).ravel()
        for x in (drawn, exact):
            assert abs(x.mean() - shape) < 5 * np.sqrt(shape / len(x))
            assert abs(x.var() - shape) < 5 * np.sqrt((2 * shape**2 + 6 * shape) / len(x))
            assert stats.kstest(x, stats.gamma(shape).cdf).pvalue > 1e-4
            assert x.min() > 0.0


def test_normals_of_runs_are_normal_and_their_own() -> None:
    x = RunStreams(7, range(400)).standard_normal((500, 400))
    assert stats.kstest(x.ravel(), "norm").pvalue > 1e-4
    assert abs(np.corrcoef(x[:128].ravel() ** 2, x[128:256].ravel() ** 2)[0, 1]) < 0.03
    np.testing.assert_array_equal(RunStreams(7, [3]).standard_normal((500, 1)), x[:, 3:4])


def test_tables_do_not_hang_on_a_librarys_last_bit() -> None:
    """No entry is so near the middle of two grains that an error of a few bits could move it."""
    z = special.ndtri((np.arange(1 << 15, 1 << 16) + 0.5) / (1 << 16))
    z[-1] = random_variates._OUTERMOST
    grains = z / np.sqrt(np.square(z).mean()) * (0.5 * random_variates._GRAIN)
    middle = np.abs(grains - np.floor(grains) - 0.5)
    assert middle.min() > 100 * np.spacing(grains.max())
    np.testing.assert_array_equal(
        np.round(grains) / random_variates._GRAIN, halved_normals()[1 << 15 :]
    )


def test_streams_of_one_block_and_of_chosen_runs_stay_apart() -> None:
    block = block_stream(5, 0)
    some = [SomeRuns(block, step, [0]).standard_normal((1, 4000))[0] for step in (7, 8)]
    some.append(SomeRuns(block, 7, [1]).standard_normal((1, 4000))[0])
    drawn = [*some, *(block_stream(5, b).standard_normal(4000) for b in range(3))]
    for a, b in combinations(drawn, 2):
        assert abs(np.corrcoef(a, b)[0, 1]) < 5 / np.sqrt(4000)


def test_words_become_numbers_between_zero_and_one() -> None:
    """The middles of 2^52 cells: symmetric about a half, with neither end."""
    words = np.array([0, 1 << 63, (1 << 64) - 1], dtype=np.uint64)
    half = 2.0**-53
    np.testing.assert_array_equal(random_variates._open_unit(words), [half, 0.5 + half, 1.0 - half])
