"""Metropolis-Hastings with independent proposals, against its transition matrix written out."""

import numpy as np
import pytest

from trackbench.core.metropolis_hastings import independence_moves

TARGET = np.array([0.1, 0.6, 0.3])
PROPOSAL = np.array([0.5, 0.2, 0.3])
RUNS, N = 200, 500


def matrix() -> list[list[float]]:
    """Row i: where one step goes from state i, by Metropolis and Hastings' formula."""
    rows = []
    for i in range(3):
        row = [0.0, 0.0, 0.0]
        for j in range(3):
            ratio = TARGET[j] * PROPOSAL[i] / (TARGET[i] * PROPOSAL[j])
            accepted = PROPOSAL[j] * min(1.0, ratio)
            row[j] += accepted
            row[i] += PROPOSAL[j] - accepted
        rows.append(row)
    return rows


def moved(start: np.ndarray, steps: int, rng: np.random.Generator) -> np.ndarray:
    """Shares of the three states after so many steps."""

    def draw(rng: np.random.Generator) -> np.ndarray:
        return rng.choice(3, size=(1, RUNS, N), p=PROPOSAL).astype(float)

    def log_ratio(x: np.ndarray) -> np.ndarray:
        # One constant per particle, which must not matter.
        constants = np.arange(RUNS * N).reshape(RUNS, N) % 7
        return np.log(TARGET / PROPOSAL)[x[0].astype(int)] + constants

    x = independence_moves(start, draw, log_ratio, steps, rng)
    return np.bincount(x.astype(int).ravel(), minlength=3) / x.size


def same(shares: np.ndarray, expected: np.ndarray) -> bool:
    return bool(
        (abs(shares - expected) < 4.5 * np.sqrt(expected * (1 - expected) / (RUNS * N))).all()
    )


@pytest.mark.parametrize("state", [0, 1, 2])
def test_one_step_goes_where_the_formula_says(state: int, rng: np.random.Generator) -> None:
    start = np.full((1, RUNS, N), float(state))
    expected = np.array(matrix()[state])
    assert same(moved(start, 1, rng), expected)
    assert state == 0 or not same(moved(start, 1, rng), PROPOSAL)  # 0 is left for anything


def test_the_target_is_left_as_it_is(rng: np.random.Generator) -> None:
    assert np.allclose(TARGET @ np.array(matrix()), TARGET)
    start = rng.choice(3, size=(1, RUNS, N), p=TARGET).astype(float)
    assert same(moved(start, 3, rng), TARGET)


def test_what_has_no_density_is_left_and_never_entered(rng: np.random.Generator) -> None:
    start = np.repeat([-1.0, 1.0], 50).reshape(1, 1, 100)

    def log_ratio(x: np.ndarray) -> np.ndarray:
        return np.where(x[0] > 0, 0.0, -np.inf)

    def into(value: float) -> np.ndarray:
        return independence_moves(start, lambda rng: np.full_like(start, value), log_ratio, 1, rng)

    np.testing.assert_array_equal(into(2.0), 2.0)
    np.testing.assert_array_equal(into(-2.0), start)
