"""Algebra of small matrices over trailing batch axes.

Matrices are ``(n, m)`` (constant) or ``(n, m, *batch)``, vectors ``(n, *batch)``. Sums run over the few
components in Python and over the batch in numpy. A constant matrix is applied without its zeros and
ones, so ``F x`` of a constant-velocity model is two multiply-adds.
"""

import numpy as np

from trackbench.core.arrays import Array


def matvec(A: Array, x: Array) -> Array:
    """``A x`` for A (n, m) or (n, m, *batch) and x (m, *batch); shape (n, *batch)."""
    if A.ndim == 2:
        return _constant_product(A, x)
    return _sum_of([A[:, j] * x[j] for j in range(A.shape[1])])


def lower_product(L: Array, x: Array) -> Array:
    """``L x`` for lower triangular L (n, n, *batch) and x (n, *batch): half of `matvec`'s work."""
    out = np.empty(x.shape)
    for i, row in enumerate(out):
        np.multiply(L[i, 0], x[0], out=row)
        for j in range(1, i + 1):
            row += L[i, j] * x[j]
    return out


def matmul(A: Array, B: Array) -> Array:
    """``A B`` for A (n, m[, *batch]) and B (m, p[, *batch]); shape (n, p[, *batch])."""
    if A.ndim == 2:
        return _constant_product(A, B)
    if B.ndim == 2:
        return transpose(_constant_product(B.T, transpose(A)))
    return _sum_of([A[:, j, None] * B[None, j] for j in range(A.shape[1])])


def transpose(A: Array) -> Array:
    """``A'``: the first two axes swapped (a view)."""
    return A.swapaxes(0, 1)


def sandwich(F: Array, P: Array) -> Array:
    """``F P F'`` for symmetric P, exactly symmetric."""
    FP = matmul(F, P)
    return symmetrised(matmul(F, transpose(FP)))


def symmetrised(P: Array) -> Array:
    """``(P + P') / 2``."""
    return 0.5 * (P + transpose(P))


def outer(a: Array, b: Array) -> Array:
    """``a b'`` for vectors (n, *batch) and (m, *batch)."""
    return np.asarray(a[:, None] * b[None, :])


def identity_minus(A: Array) -> Array:
    """``I - A`` for square A."""
    out = -A
    for i in range(A.shape[0]):
        out[i, i] += 1.0
    return out


def diagonal(A: Array) -> Array:
    """The diagonal as a vector (n, *batch)."""
    return np.stack([A[i, i] for i in range(A.shape[0])])


def cholesky(P: Array) -> Array:
    """Lower L with ``L L' = P``; a batch member that is not positive definite becomes NaN.

    A component that is known exactly (its variance is zero) gets a column of zeros. Cholesky's
    rounding error is invariant under diagonal scaling, so metres beside metres per second need no
    scaling of their own.
    """
    n = P.shape[0]
    L = np.zeros_like(P)
    with np.errstate(invalid="ignore", divide="ignore"):
        for j in range(n):
            d = P[j, j] - sum(L[j, i] ** 2 for i in range(j))
            known = P[j, j] == 0.0
            L[j, j] = np.sqrt(np.where((d > 0.0) | known, d, np.nan))
            for i in range(j + 1, n):
                column = (P[i, j] - sum(L[i, m] * L[j, m] for m in range(j))) / L[j, j]
                L[i, j] = np.where(known, 0.0, column)
    return L


def solve_lower(L: Array, b: Array) -> Array:
    """``L^-1 b`` for lower triangular L (n, n[, *batch]) and b (n, ...)."""
    if len(L) == 1:
        return b * (1.0 / L[0])
    rows: list[Array] = []
    for i in range(L.shape[0]):
        rest = b[i] - sum(L[i, j] * rows[j] for j in range(i)) if i else b[i]
        rows.append(rest / L[i, i])
    return np.stack(rows)


def inverse(S: Array) -> Array:
    """``S^-1`` of a symmetric positive definite S (n, n[, *batch])."""
    if S.shape[0] == 1:
        return np.asarray(1.0 / S)
    n = S.shape[0]
    eye = np.eye(n).reshape((n, n) + (1,) * (S.ndim - 2))
    # L[:, :, None] lets every column of the identity be one more batch axis of the solve.
    L = cholesky(S)
    L_inverse = solve_lower(L[:, :, None], np.broadcast_to(eye, S.shape))
    return matmul(transpose(L_inverse), L_inverse)


def mahalanobis(e: Array, P: Array) -> Array:
    """``e' P^-1 e`` for e (n, *batch) and P (n, n[, *batch]); shape (*batch)."""
    white = solve_lower(cholesky(P), e)
    return np.asarray((white * white).sum(axis=0))


def log_determinant(P: Array) -> Array:
    """``log det P`` of a symmetric positive definite P."""
    return np.asarray(2.0 * np.log(diagonal(cholesky(P))).sum(axis=0))


def _constant_product(A: Array, B: Array) -> Array:
    out = np.empty((A.shape[0], *B.shape[1:]))
    for i, row in enumerate(A):
        terms = [B[j] if a == 1.0 else a * B[j] for j, a in enumerate(row) if a != 0.0]
        out[i] = _sum_of(terms) if terms else 0.0
    return out


def _sum_of(terms: list[Array]) -> Array:
    total = terms[0]
    for term in terms[1:]:
        total = total + term
    return total
