import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trackbench.core.resampling import SCHEMES, Scheme, _tally, ancestors, select

ALL: list[Scheme] = ["systematic", "stratified", "residual", "multinomial"]


@settings(max_examples=40, deadline=None)
@given(
    st.sampled_from(ALL),
    st.integers(1, 6),
    st.integers(1, 40),
    st.integers(0, 2**32),
    st.floats(0.1, 300.0),
)
def test_counts_are_exact(scheme: Scheme, runs: int, N: int, seed: int, spread: float) -> None:
    """Rows sum to N, no weight below zero offspring, none for a particle without weight."""
    rng = np.random.Generator(np.random.SFC64(seed))
    w = np.exp(-spread * rng.random((runs, N)))
    w[rng.random((runs, N)) < 0.3] = 0.0
    w[:, rng.integers(N)] += 1e-3
    w /= w.sum(axis=1, keepdims=True)
    counts = SCHEMES[scheme](w, rng, N)
    assert (counts.sum(axis=1) == N).all()
    assert (counts >= 0).all()
    assert (counts[w == 0.0] == 0).all()
    if scheme == "systematic":
        assert (np.abs(counts - N * w) < 1 + 1e-9).all()
    if scheme == "residual":
        assert (counts >= np.floor(N * w - 1e-9)).all()


@pytest.mark.parametrize("runs", [1, 3])
@pytest.mark.parametrize("size", [2**21, 2**23 - 1, 2**23, 2**26])
def test_systematic_counts_of_millions(runs: int, size: int, rng: np.random.Generator) -> None:
    """Beyond 2^23 offspring in a block the fixed-point weights have fewer digits."""
    w = np.array([0.05, 0.4, 0.0, 0.25, 0.3])
    counts = SCHEMES["systematic"](np.tile(w, (runs, 1)), rng, size)
    assert (counts.sum(axis=1) == size).all()
    assert (np.abs(counts - size * w) < 1 + 1e-3).all()


@pytest.mark.parametrize("scheme", ALL)
def test_unbiased(scheme: Scheme, rng: np.random.Generator) -> None:
    w = np.array([0.05, 0.4, 0.0, 0.25, 0.3])
    runs, N = 40_000, len(w)
    counts = SCHEMES[scheme](np.tile(w, (runs, 1)), rng, N)
    standard_error = counts.std(axis=0) / np.sqrt(runs) + 1e-12
    assert (np.abs(counts.mean(axis=0) - N * w) < 4 * standard_error).all()
    if scheme == "multinomial":
        # Var = N w (1 - w); the standard error of a variance is about sqrt(2 / runs) of it.
        expected = N * w * (1 - w)
        assert np.allclose(counts.var(axis=0), expected, rtol=5 * np.sqrt(2 / runs), atol=1e-9)


@pytest.mark.parametrize("scheme", ALL)
def test_a_run_that_left_the_numbers_disturbs_nobody(scheme: Scheme) -> None:
    def draw(w: np.ndarray) -> np.ndarray:
        return ancestors(w, np.random.Generator(np.random.SFC64(3)), scheme)

    w = np.full((3, 4), 0.25)
    broken = w.copy()
    broken[1] = np.nan
    np.testing.assert_array_equal(draw(w)[[0, 2]], draw(broken)[[0, 2]])
    assert set(draw(broken)[1]) <= set(range(4, 8))


def test_select_takes_from_its_own_run(rng: np.random.Generator) -> None:
    x = np.arange(24.0).reshape(2, 3, 4)
    index = ancestors(np.tile([0.0, 1.0, 0.0, 0.0], (3, 1)), rng)
    np.testing.assert_array_equal(select(x, index), np.repeat(x[..., 1:2], 4, axis=2))


@pytest.mark.parametrize("N", [3, 10, 49, 98, 103, 1000])
def test_residual_of_equal_weights_copies_each_particle_once(N: int) -> None:
    """Rounding of 1 / N, which is 1 - 1e-16 in 49 times 1 / 49, leaves nothing to draw."""
    rng = np.random.Generator(np.random.SFC64(1))
    assert (SCHEMES["residual"](np.full((2, N), 1.0 / N), rng, N) == 1).all()


@pytest.mark.parametrize("scheme", ALL)
def test_a_run_without_weights_is_resampled_with_equal_ones(
    scheme: Scheme, rng: np.random.Generator
) -> None:
    runs, N = 4000, 5
    counts = SCHEMES[scheme](np.full((runs, N), np.nan), rng, N)
    assert (counts.sum(axis=1) == N).all()
    standard_error = counts.std(axis=0) / np.sqrt(runs) + 1e-12
    assert (np.abs(counts.mean(axis=0) - 1.0) < 5 * standard_error).all()


@pytest.mark.parametrize("u", [0.0, 1e-17])
def test_a_draw_of_zero_selects_the_first_particle_with_a_weight_of_its_own_run(u: float) -> None:
    """In the second run ``1 + u`` is 1, where the first run ends."""
    every = np.ones((2, 2), dtype=np.bool_)
    draws = np.array([[0.2, 0.7], [u, 0.7]])
    counts = _tally(np.array([[0.5, 1.0], [0.5, 1.0]]), draws, every)
    np.testing.assert_array_equal(counts, [[1, 1], [1, 1]])
    counts = _tally(np.array([[0.5, 1.0], [0.0, 1.0]]), draws, every)
    np.testing.assert_array_equal(counts, [[1, 1], [0, 2]])
