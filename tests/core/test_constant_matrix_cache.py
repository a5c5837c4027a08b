"""What does not depend on the data is computed once for all runs, blocks and points."""

import ctypes

import numpy as np
import pytest

from tests.papers import maneuver, seen_as
from trackbench.core import compiled, kalman
from trackbench.core.arrays import Array
from trackbench.core.constant_matrix_cache import cached_if_constant, clear_caches
from trackbench.core.distributions import Gaussian
from trackbench.core.read_only import fixed
from trackbench.core.undo_plugin_changes import Seal
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.run_blocks_side_by_side import run_block
from trackbench.filters.kf import KF
from trackbench.models.motions.kinematic import WhiteAcceleration


def test_constant_matrices_are_computed_once_and_batches_every_time() -> None:
    calls = []

    @cached_if_constant
    def twice(A: Array) -> Array:
        calls.append(A.shape)
        return 2.0 * A

    flat, square, batch = np.ones((1, 4)), np.eye(2) + 1.0, np.ones((2, 2, 3))
    for A in (flat, square, batch, flat.copy(), square.T, batch, np.array([[1, 2]])):
        np.testing.assert_array_equal(twice(A), 2.0 * A)
    assert calls == [(1, 4), (2, 2), (2, 2, 3), (2, 2, 3), (1, 2)]


def test_fixed_matrices_are_recognized_and_others_compared() -> None:
    @cached_if_constant
    def twice(A: Array, B: Array) -> Array:
        return A + B

    A, B = fixed(np.eye(2)), fixed(np.ones((2, 2)))
    first = twice(A, B)
    assert twice(A, B) is first
    assert twice(A.copy(), B) is first
    # A writable array may change between two calls.
    changing = np.ones((2, 2))
    assert twice(A, changing) is first
    changing[0, 0] = 7.0
    np.testing.assert_array_equal(twice(A, changing), A + changing)
    # Arrays come and go: an identity may be used again.
    for i in range(100):
        both = fixed(np.full((2, 2), float(i))), fixed(np.full((2, 2), 1.0))
        np.testing.assert_array_equal(twice(*both), both[0] + 1.0)
        del both


def test_results_of_changed_memory_are_dropped() -> None:
    @cached_if_constant
    def twice(A: Array) -> Array:
        return 2.0 * A

    A = fixed(np.ones((3, 3)))
    seal = Seal(A)
    # As a library that takes the address would.
    ctypes.memset(A.ctypes.data, 0, 8)
    assert twice(A)[0, 0] == 0.0
    assert seal.mend()
    np.testing.assert_array_equal(twice(A), 2.0 * np.ones((3, 3)))


def test_what_is_handed_out_again_cannot_be_changed() -> None:
    state = Gaussian(np.zeros((2, 5)), np.eye(2))
    H, R, nu = np.eye(1, 2), np.eye(1), np.ones((1, 5))
    posterior, innovation = kalman.update(state, nu, H, R)
    for shared in (posterior.cov, innovation.S):
        with pytest.raises(ValueError, match="read-only"):
            shared[0, 0] = 7.0


def test_a_second_block_computes_no_gain(monkeypatch: pytest.MonkeyPatch) -> None:
    clear_caches()  # what another test may have made
    monkeypatch.setattr(compiled, "kernels", None)  # numpy's gain, which calls `inverse`
    gains = []
    inverse = kalman.linalg.inverse
    monkeypatch.setattr(kalman.linalg, "inverse", lambda S: gains.append(S) or inverse(S))
    scenario, tracker = seen_as(maneuver(), WhiteAcceleration(q=0.01)), KF()
    steps = len(scenario.steps) - 1
    run_block(BlockTask(scenario, tracker, seed=1, index=0, width=3, runs_used=3))
    first = len(gains)
    assert 0 < first < steps  # the steady state is reached before the end
    run_block(BlockTask(scenario, tracker, seed=1, index=1, width=3, runs_used=3))
    assert len(gains) == first
