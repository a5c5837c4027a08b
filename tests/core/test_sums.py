"""Sums in a known order."""

import numpy as np
import pytest

from trackbench.core import sums


def one_by_one(rows: np.ndarray) -> np.ndarray:
    """Rows added to each other, one after the other."""
    out = np.zeros(rows.shape[1:])
    for row in rows:
        out = out + row
    return out


@pytest.mark.parametrize("shape", [(7, 10), (1, 33), (3, 255), (2, 4, 50), (5,), (1, 1)])
def test_short_rows_are_added_in_their_order(
    shape: tuple[int, ...], rng: np.random.Generator
) -> None:
    a = rng.standard_normal(shape)
    np.testing.assert_array_equal(sums.total(a), one_by_one(np.moveaxis(a, -1, 0)))
    np.testing.assert_array_equal(sums.total(a, axis=0), one_by_one(a))


def by_blocks(a: np.ndarray, block: int) -> np.ndarray:
    whole = a.shape[1] - a.shape[1] % block
    out = one_by_one(a[:, :whole].reshape(len(a), -1, block).transpose(1, 0, 2))
    out[:, : a.shape[1] - whole] += a[:, whole:]
    return out


@pytest.mark.parametrize("n", [256, 300, 4095, 4096, 10_001])
def test_long_rows_are_added_block_by_block(n: int, rng: np.random.Generator) -> None:
    a = rng.standard_normal((3, n))
    few = a
    for block in [128] if n < 4096 else [512, 128]:
        few = by_blocks(few, block)
    np.testing.assert_array_equal(sums.total(a), one_by_one(few.T))
    np.testing.assert_allclose(sums.total(a), a.sum(axis=-1), atol=1e-11)
    np.testing.assert_array_equal(sums.total(a[:1])[0], sums.total(a)[0])


def test_an_empty_axis_sums_to_zero() -> None:
    np.testing.assert_array_equal(sums.total(np.empty((2, 0))), [0.0, 0.0])
    np.testing.assert_array_equal(sums.total(np.empty((0, 2)), axis=0), [0.0, 0.0])
