from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.conftest import random_covariance
from trackbench.core import indefinite_covariance, linalg


def _stacked(A: np.ndarray) -> np.ndarray:
    """Batch axis first, as numpy.linalg wants it."""
    return np.moveaxis(A, -1, 0)


@settings(max_examples=25, deadline=None)
@given(st.integers(1, 6), st.integers(1, 6), st.integers(1, 6), st.integers(0, 2**32))
def test_products_agree_with_numpy(n: int, m: int, p: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    A, B = rng.standard_normal((n, m, 5)), rng.standard_normal((m, p, 5))
    x = rng.standard_normal((m, 5))
    np.testing.assert_allclose(
        _stacked(linalg.matmul(A, B)), _stacked(A) @ _stacked(B), rtol=1e-12, atol=1e-12
    )
    for constant in (A[..., 0], np.round(A[..., 0])):  # rounding makes zeros and ones
        np.testing.assert_allclose(
            _stacked(linalg.matmul(constant, B)), constant @ _stacked(B), rtol=1e-12, atol=1e-12
        )
        np.testing.assert_allclose(linalg.matvec(constant, x), constant @ x, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(
        linalg.matvec(A, x), np.einsum("ijb,jb->ib", A, x), rtol=1e-12, atol=1e-12
    )
    np.testing.assert_allclose(
        linalg.matmul(A, B[..., 0]), np.einsum("ijb,jk->ikb", A, B[..., 0]), rtol=1e-12, atol=1e-12
    )


@pytest.mark.parametrize("n", [1, 2, 4, 6])
def test_factorizations_agree_with_numpy(n: int, rng: np.random.Generator) -> None:
    P, e = random_covariance(rng, n, 50), rng.standard_normal((n, 50))
    np.testing.assert_allclose(_stacked(linalg.cholesky(P)), np.linalg.cholesky(_stacked(P)))
    np.testing.assert_allclose(_stacked(linalg.inverse(P)), np.linalg.inv(_stacked(P)), rtol=1e-8)
    solved = np.linalg.solve(_stacked(P), e.T[..., None])[..., 0].T
    np.testing.assert_allclose(linalg.mahalanobis(e, P), (e * solved).sum(axis=0), rtol=1e-8)
    np.testing.assert_allclose(linalg.inverse(P[..., 0]), np.linalg.inv(P[..., 0]), rtol=1e-8)


def test_cholesky_marks_what_is_not_positive_definite_and_keeps_what_is_known() -> None:
    P = np.stack([np.eye(2), -np.eye(2), np.diag([0.0, 4.0])], axis=-1)
    L = linalg.cholesky(P)
    np.testing.assert_array_equal(L[..., 0], np.eye(2))
    assert np.isnan(L[..., 1]).any()
    np.testing.assert_array_equal(L[..., 2], np.diag([0.0, 2.0]))


@pytest.mark.parametrize("T", [0.1, 1.0, 2.5, 3.0])
def test_a_singular_covariance_has_a_root(T: float) -> None:
    """Of rank one, as the noise of a random acceleration is, alone and beside a regular one."""
    G = np.array([T**2 / 2.0, T, 1.0])
    Q = 0.3 * np.outer(G, G)
    for P in (Q, np.stack([Q, np.eye(3)], axis=-1)):
        L = linalg.root(P)
        np.testing.assert_allclose(linalg.matmul(L, linalg.transpose(L)), P, atol=1e-14 * T**4)
    assert linalg.is_singular(Q)
    assert not linalg.is_singular(Q + 1e-3 * np.diag(np.diag(Q)))
    assert np.isnan(linalg.root(np.array([[1.0, 2.0], [2.0, 1.0]]))).any()  # no covariance at all


def test_cholesky_keeps_its_digits_at_condition_1e10(rng: np.random.Generator) -> None:
    scale = np.array([1e5, 1.0, 1e5, 1.0])
    C = random_covariance(rng, 4, 20)
    P = scale[:, None, None] * C * scale[None, :, None]
    L = linalg.cholesky(P)
    np.testing.assert_allclose(linalg.matmul(L, linalg.transpose(L)), P, rtol=1e-11)


@pytest.mark.parametrize("n", [1, 2, 3])
@pytest.mark.parametrize("batch", [3, 200])
def test_few_and_many_matrices_are_factored_alike(
    n: int, batch: int, rng: np.random.Generator
) -> None:
    P = np.stack([random_covariance(rng, n) for _ in range(batch)], axis=-1)
    P[..., 1] = -P[..., 1]
    good = np.arange(batch) != 1
    L, inverse = linalg.cholesky(P), linalg.inverse(P)
    assert np.isnan(L[..., 1]).any()
    if n > 1:
        assert np.isnan(inverse[..., 1]).any()
    np.testing.assert_allclose(
        _stacked(L[..., good]), np.linalg.cholesky(_stacked(P[..., good])), rtol=1e-9, atol=1e-12
    )
    np.testing.assert_allclose(
        _stacked(inverse[..., good]), np.linalg.inv(_stacked(P[..., good])), rtol=1e-7, atol=1e-12
    )


@pytest.mark.parametrize("n", [1, 4])
def test_a_lower_triangle_per_run_transforms_its_cloud(n: int, rng: np.random.Generator) -> None:
    L = np.stack([np.tril(rng.standard_normal((n, n))) for _ in range(3)], axis=-1)
    x = rng.standard_normal((n, 3, 7))
    expected = np.einsum("ijm,jmk->imk", L, x)
    np.testing.assert_allclose(linalg.lower_product(L, x), expected, rtol=1e-12, atol=1e-14)


def test_a_run_does_not_depend_on_the_runs_beside_it(rng: np.random.Generator) -> None:
    A, x = rng.standard_normal((4, 4)), rng.standard_normal((4, 9))
    P = np.stack([random_covariance(rng, 4) for _ in range(9)], axis=-1)
    for runs in (1, 2, 5):
        assert (linalg.matvec(A, x[:, :runs]) == linalg.matvec(A, x)[:, :runs]).all()
        assert (linalg.sandwich(A, P[..., :runs]) == linalg.sandwich(A, P)[..., :runs]).all()
        assert (linalg.cholesky(P[..., :runs]) == linalg.cholesky(P)[..., :runs]).all()
        assert (linalg.inverse(P[..., :runs]) == linalg.inverse(P)[..., :runs]).all()


@pytest.mark.parametrize("n", [1, 2, 3, 12])
def test_eigenvalues_agree_with_numpy(n: int, rng: np.random.Generator) -> None:
    scale = np.logspace(0, -6, n)[:, None, None]
    A = scale * np.stack([random_covariance(rng, n) for _ in range(3)], axis=-1)
    A = A * scale[:, 0]
    A[..., 1] = np.diag(np.arange(n))  # two equal in no case, one zero, nothing to turn
    w, V = linalg.eigen(A)
    for i in range(3):
        exact = np.linalg.eigvalsh(A[..., i])
        np.testing.assert_allclose(np.sort(w[:, i]), exact, rtol=1e-9, atol=1e-15)
        np.testing.assert_allclose(V[..., i] @ V[..., i].T, np.eye(n), atol=1e-14)
        np.testing.assert_allclose(V[..., i] * w[:, i] @ V[..., i].T, A[..., i], atol=1e-14 * n)
        alone = linalg.eigen(A[..., i])
        assert alone[0].tobytes() == w[:, i].tobytes()
        assert alone[1].tobytes() == np.ascontiguousarray(V[..., i]).tobytes()


def test_eigenvalues_of_a_singular_matrix() -> None:
    ones, nan = np.ones((4, 4)), np.full((4, 4), np.nan)
    w, _ = linalg.eigen(np.stack([ones, nan], axis=-1))
    np.testing.assert_allclose(np.sort(w[:, 0]), [0, 0, 0, 4], atol=1e-15)
    assert np.isnan(w[:, 1]).any()


@pytest.mark.parametrize(("n", "m"), [(1, 1), (1, 3), (3, 3), (4, 9)])
def test_a_triangular_factor_agrees_with_numpy(n: int, m: int, rng: np.random.Generator) -> None:
    A = rng.standard_normal((n, m, 3))
    A[-1, :, 1] = 0.0  # of a singular product
    L = linalg.triangular(A)
    for i in range(3):
        R = np.linalg.qr(A[..., i].T)[1].T
        np.testing.assert_allclose(
            L[..., i], R * np.sign(np.diag(R) + (np.diag(R) == 0)), atol=1e-13
        )
        assert L[..., i].tobytes() == linalg.triangular(A[..., i : i + 1])[..., 0].tobytes()
        np.testing.assert_allclose(linalg.triangular(A[..., i]), L[..., i], atol=1e-14)


def test_traces_of_products_are_those_of_the_products() -> None:
    A = np.random.default_rng(4).normal(size=(3, 4, 4, 5))
    traces = linalg.traces_of_products(A)
    assert traces.shape == (3, 3, 5)
    for i in range(3):
        for j in range(3):
            # The same sums in the same order, so not a rounding error apart.
            exact = linalg.trace(linalg.matmul(A[i], A[j]))
            np.testing.assert_array_equal(traces[i, j], exact)


def test_a_matrix_with_a_negative_variance_is_indefinite() -> None:
    covariance = np.array([[4.0, 1.0], [1.0, 2.0]])
    singular = np.array([[4.0, 2.0], [2.0, 1.0]])
    rounding = np.array([[4.0, 2.0], [2.0, 1.0 - 1e-13]])  # of float64
    float32 = np.array([[4.0, 2.0], [2.0, 1.0 - 1e-7]])
    negative = np.diag([1.0, -1e-30])
    unknown = np.full((2, 2), np.nan)
    # The covariance of particles that lie nearly on a line: only the last pivot is negative.
    line = np.array([[1.0, 1e-9], [1e-9, 1e-18 * (1.0 - 1e-13)]])
    matrices = [covariance, singular, rounding, line, float32, negative, unknown, np.zeros((2, 2))]
    indefinite = indefinite_covariance.is_indefinite(np.stack(matrices, axis=-1))
    assert indefinite.tolist() == [False, False, False, False, True, True, False, False]
    assert [bool(indefinite_covariance.is_indefinite(P)) for P in matrices] == indefinite.tolist()


def test_a_product_is_that_of_fractions_and_of_any_order(rng: np.random.Generator) -> None:
    A = rng.standard_normal((2, 3, 128)) * 10.0 ** rng.integers(-3, 3, 128)
    B = rng.standard_normal((128, 4))
    got = linalg.product(A, B)
    order = rng.permutation(128)
    np.testing.assert_array_equal(linalg.product(A[..., order], B[order]), got)
    exact = sum(Fraction(a) * Fraction(b) for a, b in zip(A[1, 2], B[:, 3], strict=True))
    scale = 128 * np.abs(A[1]).max() * np.abs(B).max()
    assert abs(float(exact) - got[1, 2, 3]) < scale * 2.0**-44
