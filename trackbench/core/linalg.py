"""Algebra of small matrices over trailing batch axes.

Matrices are ``(n, m)`` (constant) or ``(n, m, *batch)``, vectors ``(n, *batch)``. Sums run over the few
components in Python and over the batch in numpy. A constant matrix is applied without its zeros and
ones, so ``F x`` of a constant-velocity model is two multiply-adds. BLAS and LAPACK are avoided: their
last bits depend on the processor, the number of threads and the number of runs in a batch.
"""

from collections.abc import Sequence
from itertools import combinations
from math import nan, prod, sqrt

import numpy as np

from trackbench.core import compiled
from trackbench.core.arrays import Array, all_finite, with_trailing
from trackbench.core.constant_matrix_cache import cached_if_constant

_EXACT = 128  # products of numbers of 23 bits whose sum is exact
_AT_ONCE = 16_384  # numbers of a product's rows: their halves stay in the cache


SINGULAR = 1e-14
"""Share of its variance below which a pivot is rounding."""
_NO_TOLERANCE = 0.0  # share of its variance below which a pivot is taken as zero: for none
_ROUNDING = 2.0**-52  # share of the diagonal below which a rotation changes nothing
_SWEEPS = 40  # of rotations; convergence is quadratic, after some ten
_MATRIX = 0  # last argument of the kernel `product`: what A is multiplied by
_VECTOR = 1


def matvec(A: Array, x: Array) -> Array:
    """Compute ``A x``.

    Parameters
    ----------
    A : array (n, m) or (n, m, *batch)
    x : array (m, *batch)

    Returns
    -------
    array (n, *batch)
    """
    if compiled.kernels and x.ndim > 1:
        out = np.empty((len(A), *x.shape[1:]))
        # `_VECTOR`: x is a vector. The kernel returns False for arrays that it leaves to numpy.
        if compiled.kernels.product(A, x, out, _VECTOR):
            return out
        # Call the kernel run by run, unless a matrix has zeros: it skips those of a single matrix, and
        # zero times infinity has to stay NaN.
        # `_pays_by_runs` is True only for a matrix per run A (n, m, M, 1) and particles x (m, M, N).
        if _pays_by_runs(A, x) and A.all():
            for run in range(A.shape[2]):
                compiled.kernels.product(A[:, :, run, 0], x[:, run], out[:, run], _VECTOR)
            return out
    if A.ndim == 2:
        return _constant_product(A, x)
    total = A[:, 0] * x[0]
    for j in range(1, A.shape[1]):
        total += A[:, j] * x[j]
    return total


_WORTH_A_CALL = 2000  # products of one run, from which on a call of a kernel for each run pays


def _pays_by_runs(A: Array, x: Array) -> bool:
    """Test whether to apply a matrix per run A (n, m, M, 1) to particles x (m, M, N) run by run."""
    if A.ndim != 4 or x.ndim != 3 or A.shape[2:] != (x.shape[1], 1):
        return False
    is_readable = A.dtype == x.dtype == np.float64 and x.strides[2] == x.itemsize
    return is_readable and len(A) * len(x) * x.shape[2] >= _WORTH_A_CALL


def lower_product(L: Array, x: Array) -> Array:
    """Compute ``L x`` of particles, by a lower triangle for each run.

    Parameters
    ----------
    L : array (n, n, M)
        Lower triangle of each run.
    x : array (n, M, N)
        Particles of each run.

    Returns
    -------
    array (n, M, N)
    """
    out = np.empty_like(x)
    for i, row in enumerate(out):
        np.multiply(L[i, 0][:, None], x[0], out=row)
        for j in range(1, i + 1):
            row += L[i, j][:, None] * x[j]
    return out


def matmul(A: Array, B: Array) -> Array:
    """Compute ``A B``.

    Parameters
    ----------
    A : array (n, m[, *batch])
    B : array (m, p[, *batch])

    Returns
    -------
    array (n, p[, *batch])
        With batch axes if one of the two has them.
    """
    if compiled.kernels:
        batch = A.shape[2:] or B.shape[2:]
        out = np.empty((len(A), B.shape[1], *batch))
        # `_MATRIX`: B is a matrix. The kernel returns False for arrays that it leaves to numpy.
        if compiled.kernels.product(A, B, out, _MATRIX):
            return out
    if A.ndim == 2 and B.ndim == 2:
        # numpy adds fewer than 8 terms one after the other, as the kernel does, which leaves sums of
        # more terms to numpy.
        return np.add.reduce(A[:, :, None] * B, axis=1)
    if A.ndim == 2:
        return _constant_product(A, B)
    # A B = (B' A')'
    if B.ndim == 2:
        return transpose(_constant_product(B.T, transpose(A)))
    return _sum_of([A[:, j, None] * B[None, j] for j in range(A.shape[1])])


def transpose(A: Array) -> Array:
    """Swap the first two axes: ``A'`` (a view)."""
    return A.swapaxes(0, 1)


def sandwich(F: Array, P: Array) -> Array:
    """Compute ``F P F'``, as a covariance is propagated.

    Parameters
    ----------
    F : array (m, n[, *batch])
    P : array (n, n[, *batch])
        Symmetric.

    Returns
    -------
    array (m, m[, *batch])
        Exactly symmetric.
    """
    if compiled.kernels:
        batch = F.shape[2:] or P.shape[2:]
        out = np.empty((len(F), len(F), *batch))
        # The kernel returns False for arrays that it leaves to numpy.
        if compiled.kernels.sandwich(F, P, out):
            return out
    FP = matmul(F, P)
    return symmetrize(matmul(F, transpose(FP)))


def symmetrize(P: Array) -> Array:
    """Compute ``(P + P') / 2``."""
    if len(P) == 1:
        return P.copy()
    return 0.5 * (P + transpose(P))


def outer(a: Array, b: Array) -> Array:
    """Compute ``a b'`` of two vectors.

    Parameters
    ----------
    a : array (n, *batch)
    b : array (m, *batch)

    Returns
    -------
    array (n, m, *batch)
    """
    return np.asarray(a[:, None] * b[None, :])


def identity_minus(A: Array) -> Array:
    """Compute ``I - A`` for square A."""
    out = -A
    for i in range(A.shape[0]):
        out[i, i] += 1.0
    return out


def diagonal(A: Array) -> Array:
    """Stack the diagonal to a vector (n, *batch)."""
    return np.array([A[i, i] for i in range(A.shape[0])])


def trace(A: Array) -> Array:
    """Sum the diagonal (*batch)."""
    return _sum_of(list(diagonal(A)))


def traces_of_products(A: Array) -> Array:
    """Compute ``tr(A_i A_j)`` for every pair of matrices.

    The products are added one after the other, so that every machine rounds them alike, unlike
    ``numpy.einsum``. They are computed in pieces that fit the processor's cache.

    Parameters
    ----------
    A : array (m, n, n[, *batch])
        m square matrices.

    Returns
    -------
    array (m, m[, *batch])
        Trace of ``A_i A_j`` in row i and column j.
    """
    at_once = max(1, _PRODUCTS_AT_ONCE // max(1, A[:, 0].size))
    pieces = []
    for first in range(0, len(A), at_once):
        A_i = A[first : first + at_once, None]
        # Element d of the diagonal of A_i A_j: the sum over r of (A_i)_dr (A_j)_rd.
        diagonals = A_i[:, :, :, 0] * A[:, 0]
        for r in range(1, A.shape[2]):
            diagonals += A_i[:, :, :, r] * A[:, r]
        pieces.append(_sum_of([diagonals[:, :, d] for d in range(A.shape[1])]))
    return np.concatenate(pieces)


_PRODUCTS_AT_ONCE = 65_536  # numbers of the diagonals of products, which stay in the cache


@cached_if_constant
def cholesky(P: Array) -> Array:
    """Factor ``P = L L'``.

    The rounding error is invariant under diagonal scaling, so meters beside meters per second need no
    scaling.

    Parameters
    ----------
    P : array (n, n[, *batch])
        Symmetric positive definite.

    Returns
    -------
    array (n, n[, *batch])
        Lower triangle L; NaN for a batch member that is not positive definite. A component with
        variance zero has a column of zeros.
    """
    n = P.shape[0]
    if n == 1:
        L = np.empty(P.shape)
        if compiled.kernels and compiled.kernels.factor(P, L, _NO_TOLERANCE):
            return L
        with np.errstate(invalid="ignore"):
            return np.sqrt(P)
    return _factor(P, _NO_TOLERANCE)


@cached_if_constant
def root(P: Array) -> Array:
    """Factor ``P = L L'`` of a covariance that may be singular, as ``q G G'`` is.

    It serves draws and sigma points; a matrix to be inverted needs `cholesky`.

    Parameters
    ----------
    P : array (n, n[, *batch])
        Covariance.

    Returns
    -------
    array (n, n[, *batch])
        Lower triangle L.
    """
    L = cholesky(P)
    # It is NaN in a batch member that is not positive definite, such as a singular one. Then all members
    # are factored within the range of P, with a column of zeros in a direction without spread.
    if all_finite(L):
        return L
    return root_in_range(P)


def root_in_range(P: Array) -> Array:
    """Factor ``P = L L'``, with a column of zeros where only rounding is left of P.

    Parameters
    ----------
    P : array (n, n[, *batch])
        Covariance, which may be singular.

    Returns
    -------
    array (n, n[, *batch])
        Lower triangle L. A pivot below the share `SINGULAR` of its variance counts as rounding. A batch
        member with a pivot that is negative beyond rounding has NaN.
    """
    return _factor(P, SINGULAR)


def _factor(P: Array, tolerance: float) -> Array:
    """Factor P (n, n, *batch) by Cholesky to a lower triangle of the same shape.

    A pivot below the share ``tolerance`` of its variance has a column of zeros.
    """
    if P.ndim == 2:
        return _factor_of_one(P, tolerance)
    n = P.shape[0]
    L = np.zeros(P.shape)
    if compiled.kernels and compiled.kernels.factor(P, L, tolerance):
        return L
    with np.errstate(invalid="ignore", divide="ignore"):
        for j in range(n):
            # Step 1: the pivot and the column below it, less the columns before.
            column = []
            for i in range(j, n):
                entry = P[i, j]
                if j > 0:
                    entry = entry - _sum_of([L[i, m] * L[j, m] for m in range(j)])
                column.append(entry)
            pivot = column[0]
            # Step 2: divide by the pivot's root.
            L[j, j] = np.sqrt(pivot)
            for i in range(j + 1, n):
                L[i, j] = column[i - j] / L[j, j]
            # Step 3: a column of zeros where there is no variance, NaN where P is not definite.
            least = tolerance * P[j, j] if tolerance else 0.0
            positive = pivot > least
            if not positive.all():
                zero = (P[j, j] == 0.0) | (np.abs(pivot) < least)
                L[j:, j][:, zero] = 0.0
                L[j:, j][:, ~(positive | zero)] = np.nan
    return L


def _factor_of_one(P: Array, tolerance: float) -> Array:
    """Factor a constant matrix P (n, n) as `_factor` does, by Python floats: ten times as fast."""
    rows = P.tolist()
    n = len(P)
    L = [[0.0] * n for _ in range(n)]
    for j in range(n):
        # L_jj^2 = P_jj - sum_k<j L_jk^2
        pivot = _minus_products(rows[j][j], L[j], L[j], j)
        least = tolerance * rows[j][j]
        if pivot > least:
            L[j][j] = sqrt(pivot)
            # L_ij = (P_ij - sum_k<j L_ik L_jk) / L_jj
            for i in range(j + 1, n):
                L[i][j] = _minus_products(rows[i][j], L[i], L[j], j) / L[j][j]
        # A zero variance, or a pivot within the tolerance, leaves a zero column; else nan.
        elif not (rows[j][j] == 0.0 or abs(pivot) < least):
            for i in range(j, n):
                L[i][j] = nan
    return np.array(L)


def _minus_products(value: float, a: list[float], b: list[float], n: int) -> float:
    """Subtract the first n products from ``value``, in order (`sum` differs from Python 3.12 on)."""
    for i in range(n):
        value -= a[i] * b[i]
    return value


def root_determinant(L: Array) -> tuple[Array, Array]:
    """Multiply a triangle's diagonal to ``m 2^e``.

    The product of many small pivots is below the range of floats. Its exponent is not.

    Parameters
    ----------
    L : array (n, n[, *batch])
        Lower triangle. Of a Cholesky factor of P the product is the root of det P.

    Returns
    -------
    m : array (*batch)
        Mantissa, 0.5 to 1 in magnitude, or 0 if the diagonal has a zero.
    e : array (*batch)
        Exponent, a whole number.
    """
    m, e = np.frexp(L[0, 0])
    for i in range(1, len(L)):
        m, more = np.frexp(m * L[i, i])
        e = e + more
    return m, e


def is_singular(P: Array) -> bool:
    """Test whether a covariance (n, n) leaves a direction without spread."""
    return bool((np.diagonal(root_in_range(P)) == 0.0).any())


def solve_lower(L: Array, b: Array) -> Array:
    """Compute ``L^-1 b``.

    Parameters
    ----------
    L : array (n, n[, *batch])
        Lower triangle.
    b : array (n, ...)
        Vectors, whose further axes are broadcast against those of the batch. If each run has a triangle
        for N vectors b (n, M, N), L has the shape (n, n, M, 1).

    Returns
    -------
    array (n, ...)
    """
    if len(L) == 1:
        return b * (1.0 / L[0])
    return np.array(whiten(L, b))


def whiten(L: Array, b: Array) -> list[Array]:
    """Solve ``L y = b`` and return the rows of y, as a list.

    Parameters
    ----------
    L : array (n, n[, *batch])
        Lower triangle. For b (n, M, N) the batch may be (M, 1): one triangle for the N vectors of a run.
    b : array (n, *batch)
        Vectors.

    Returns
    -------
    list of n arrays (*batch)
        Components of y.
    """
    if compiled.kernels and b.ndim > 1:
        out = np.empty(b.shape)
        # The kernel returns False for arrays that it leaves to numpy.
        if compiled.kernels.whiten(L, b, out):
            return list(out)
        # Call the kernel run by run, unless a triangle has zeros: it skips those of a single triangle,
        # and zero times infinity has to stay NaN.
        if _pays_by_runs(L, b) and _has_full_triangles(L):
            for m in range(L.shape[2]):
                compiled.kernels.whiten(L[:, :, m, 0], b[:, m], out[:, m])
            return list(out)
    rows: list[Array] = []
    for i in range(L.shape[0]):
        # Forward substitution: y_i = (b_i - sum_j<i L_ij y_j) / L_ii
        rest = b[i]
        for j in range(i):
            # The zeros of a single triangle are skipped, as the kernel does.
            if L.ndim > 2 or L[i, j] != 0.0:
                rest = rest - L[i, j] * rows[j]
        # Times the reciprocal, as the kernel computes it, for equal bits.
        rows.append(rest * (1.0 / L[i, i]))
    return rows


_SMALL_BATCH = 256  # members of a batch whose factors are copied for each column
_COPIED = 500_000  # numbers of the factors that `inverse` copies for each column


def inverse(S: Array) -> Array:
    """Compute ``S^-1``.

    Parameters
    ----------
    S : array (n, n[, *batch])
        Symmetric positive definite.

    Returns
    -------
    array (n, n[, *batch])
        Exactly symmetric.
    """
    if S.shape[0] == 1:
        return np.asarray(1.0 / S)
    if S.shape[0] == 2:
        return _inverse_of_two(S)
    n = S.shape[0]
    root = cholesky(S)
    # S^-1 = L^-T L^-1
    # Large matrices take a call of the kernel for each run. It skips the zeros of a triangle, so that it
    # is called for triangles without zeros on or below the diagonal only: NaN times zero must stay NaN.
    if compiled.kernels and S.ndim == 3 and n >= _LARGE and _has_full_triangles(root):
        identity = np.eye(n)
        inverses = np.empty((S.shape[2], n, n))
        for m, inverse_of_run in enumerate(inverses):
            compiled.kernels.whiten(root[:, :, m], identity, inverse_of_run)
        L_inverse = np.ascontiguousarray(np.moveaxis(inverses, 0, 2))
        return matmul(transpose(L_inverse), L_inverse)
    # L^-1 of all batch members: by L[:, :, None] the columns of the identity are one more batch axis.
    eye = np.eye(n).reshape((n, n) + (1,) * (S.ndim - 2))
    L = root[:, :, None]
    columns = np.broadcast_to(eye, S.shape)
    if S[0, 0].size <= _SMALL_BATCH and n * S.size <= _COPIED:
        # The kernel needs a factor for each column; copies take less time than rows one by one.
        L = np.ascontiguousarray(np.broadcast_to(L, (n, *S.shape)))
        columns = np.ascontiguousarray(columns)
    L_inverse = solve_lower(L, columns)
    return matmul(transpose(L_inverse), L_inverse)


_LARGE = 10  # components from which on a call of the kernel for each run pays


def _has_full_triangles(L: Array) -> bool:
    """Test whether no lower triangle (n, n, *batch) has a zero on or below its diagonal.

    The kernel skips the zeros of a single triangle, and zero times NaN has to stay NaN.
    """
    n = len(L)
    return bool(np.count_nonzero(L) == L[0, 0].size * (n * (n + 1) // 2))


def _inverse_of_two(S: Array) -> Array:
    """Invert S (2, 2, *batch) by Schur's complement of the first variance, which keeps more digits.

    The inverse of a batch member that is not positive definite is NaN.
    """
    # d = 1 / (c - b^2 / a), off-diagonal -d b / a, first entry 1 / a + d (b / a)^2
    a = S[0, 0]
    b = S[1, 0]
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = b / a
        rest = S[1, 1] - ratio * b
        d = 1.0 / np.where((rest > 0.0) & (a > 0.0), rest, np.nan)
    off = -ratio * d
    return np.array([[1.0 / a - ratio * off, off], [off, d]])


def mahalanobis(e: Array, P: Array, root: Array | None = None) -> Array:
    """Compute the squared Mahalanobis distance ``e' P^-1 e``.

    Parameters
    ----------
    e : array (n, *batch)
        Errors or innovations.
    P : array (n, n[, *batch])
        Their covariance.
    root : array (n, n[, *batch]), optional
        Lower triangle L of ``P = L L'``, if it is known.

    Returns
    -------
    array (*batch)
        NaN or infinite where P is not positive definite.
    """
    if root is None and len(P) == 1:
        return np.asarray(e[0] * e[0] / np.where(P[0, 0] > 0.0, P[0, 0], np.nan))
    L = cholesky(P) if root is None else root
    if compiled.kernels and e.ndim > 1:
        # The kernel returns False for arrays that it leaves to numpy.
        out = np.empty(e.shape[1:])
        if compiled.kernels.mahalanobis(L, e, out):
            return out
    return _sum_of([row * row for row in whiten(L, e)])


def distance(e: Array, P: Array) -> Array:
    """Compute the squared Mahalanobis distance, infinite where P is singular.

    Parameters
    ----------
    e : array (n, *batch)
        Errors.
    P : array (n, n[, *batch])
        Their covariance.

    Returns
    -------
    array (*batch)
        ``e' P^-1 e``; infinite for a finite error and a singular P, NaN for an error that is NaN.
    """
    squared = mahalanobis(e, P)
    if not np.isnan(squared).any():
        return squared
    finite = np.isfinite(e).all(axis=0) & np.isfinite(P).all(axis=(0, 1))
    return np.where(np.isnan(squared) & finite, np.inf, squared)


def _constant_product(A: Array, B: Array) -> Array:
    """Multiply a constant matrix A (n, m) by B (m, *batch), without the products by 0 and by 1."""
    out = np.empty((A.shape[0], *B.shape[1:]))
    for i, row in enumerate(A.tolist()):
        target = out[i, ...]
        # Skip the zeros of the constant matrix and the products with one.
        terms = []
        for j, a in enumerate(row):
            if a == 1.0:
                terms.append(B[j])
            elif a != 0.0:
                terms.append(a * B[j])
        if not terms:
            target[...] = 0.0
        elif len(terms) == 1:
            target[...] = terms[0]
        else:
            np.add(terms[0], terms[1], out=target)
            for term in terms[2:]:
                target += term
    return out


def _sum_of(terms: list[Array]) -> Array:
    """Add arrays one after the other."""
    total = terms[0]
    for term in terms[1:]:
        total = total + term
    return total


def solve_singular(P: Array, C: Array) -> Array:
    """Compute ``P^-1 C`` of a covariance that may be singular.

    Parameters
    ----------
    P : array (n, n[, *batch])
        Covariance.
    C : array (n, m[, *batch])
        Right-hand sides. If P has batch axes, C needs them, too.

    Returns
    -------
    array (n, m[, *batch])
        Zero along directions in which P is singular.
    """
    L = root(P)
    with np.errstate(divide="ignore"):
        scale = [np.where(L[i, i] > 0.0, 1.0 / L[i, i], 0.0) for i in range(len(L))]
    # L y = C, forwards
    rows: list[Array] = []
    for i in range(len(L)):
        rest = C[i]
        for j in range(i):
            rest = rest - L[i, j] * rows[j]
        rows.append(rest * scale[i])
    # L' x = y, backwards
    for i in reversed(range(len(L))):
        for j in range(i + 1, len(L)):
            rows[i] = rows[i] - L[j, i] * rows[j]
        rows[i] = rows[i] * scale[i]
    return np.array(rows)


def eigen(A: Array) -> tuple[Array, Array]:
    """Decompose ``A = V diag(w) V'``.

    Cyclic Jacobi rotations (Golub & Van Loan 2013, section 8.5) of each batch member by itself.

    Parameters
    ----------
    A : array (n, n[, *batch])
        Symmetric.

    Returns
    -------
    w : array (n[, *batch])
        Eigenvalues, in no order.
    V : array (n, n[, *batch])
        Eigenvectors, in its columns.
    """
    n = len(A)
    A = A.copy()
    V = np.broadcast_to(np.eye(n).reshape((n, n) + (1,) * (A.ndim - 2)), A.shape).copy()
    if compiled.kernels and A.dtype == np.float64:
        compiled.kernels.eigen(A, V, n, _SWEEPS, _ROUNDING)
    else:
        for _ in range(_SWEEPS):
            rotated = [_rotate(A, V, p, q) for p, q in combinations(range(n), 2)]
            # A sweep without a rotation leaves every entry as it is.
            if not any(rotated):
                break
    # -0 becomes 0: sweeps for the sake of another batch member may change the sign of a zero.
    return diagonal(A) + 0.0, V + 0.0


def _rotate(A: Array, V: Array, p: int, q: int) -> bool:
    """Make the element (p, q) of A (n, n, *batch) zero by a rotation, in place; turn V, too.

    Return whether any batch member needs it.
    """
    a = A[p, p].copy()
    b = A[q, q].copy()
    off = A[p, q].copy()
    with np.errstate(all="ignore"):
        turn = np.abs(off) > _ROUNDING * np.sqrt(np.abs(a * b))
        if not turn.any():
            return False
        # t = tan of the angle: the smaller root of t^2 + 2 theta t - 1 = 0
        theta = (b - a) / (2.0 * off)
        t = np.where(theta < 0.0, -1.0, 1.0) / (np.abs(theta) + np.sqrt(theta * theta + 1.0))
    t = np.where(turn, t, 0.0)
    c = 1.0 / np.sqrt(t * t + 1.0)
    s = t * c
    # Rotate the columns p and q of V, and the rows p and q of A.
    vector_p = c * V[:, p] - s * V[:, q]
    vector_q = s * V[:, p] + c * V[:, q]
    V[:, p] = vector_p
    V[:, q] = vector_q
    row_p = c * A[p] - s * A[q]
    row_q = s * A[p] + c * A[q]
    A[p] = row_p
    A[q] = row_q
    # The columns are the rows; a' = a - t A_pq, b' = b + t A_pq.
    A[:, p] = row_p
    A[:, q] = row_q
    A[p, p] = a - t * off
    A[q, q] = b + t * off
    A[p, q] = A[q, p] = np.where(turn, 0.0, off)
    return True


def beside(*blocks: Array) -> Array:
    """Put matrices beside each other, ``[A B ...]``.

    Parameters
    ----------
    *blocks : array (n, m[, *batch])
        Matrices with n rows each. Their m may differ, and some of them may lack batch axes.

    Returns
    -------
    array (n, sum of m[, *batch])
        Joined matrix, with the batch axes of all.
    """
    batch = np.broadcast_shapes(*(A.shape[2:] for A in blocks))
    wide = [with_trailing(A, len(batch), leading=2) for A in blocks]
    return np.concatenate([np.broadcast_to(A, (*A.shape[:2], *batch)) for A in wide], axis=1)


@cached_if_constant
def triangular(A: Array) -> Array:
    """Factor ``A A' = L L'`` without forming ``A A'``.

    Householder reflections make ``A Q = [L 0]`` (Golub & Van Loan 2013, section 5.2).

    Parameters
    ----------
    A : array (n, m[, *batch])
        With m >= n.

    Returns
    -------
    array (n, n[, *batch])
        Lower triangle L, without a negative entry on the diagonal.
    """
    A = A.copy()
    for i in range(len(A)):
        # v = a + sign(a_1) |a| e_1 of row i, from the diagonal on
        v = A[i, i:].copy()
        sign = np.where(v[0] < 0.0, -1.0, 1.0)
        v[0] += sign * np.sqrt(_sum_of(list(v * v)))
        square = _sum_of(list(v * v))
        # A <- A (I - 2 v v' / v'v), with a positive diagonal
        factor = 2.0 / np.where(square == 0.0, 1.0, square)
        A[i:, i:] -= outer(factor * matvec(A[i:, i:], v), v)
        A[i:, i] *= -sign
        A[i, i + 1 :] = 0.0
    return A[:, : len(A)]


def block_diagonal(blocks: Sequence[Array], batch: tuple[int, ...]) -> Array:
    """Return ``[A 0 0; 0 B 0; 0 0 C]`` of square blocks.

    Parameters
    ----------
    blocks : sequence of array (m, m[, *batch])
        Blocks, whose m may differ.
    batch : tuple of int
        Batch axes of the result, () for none.

    Returns
    -------
    array (n, n, *batch)
        Matrix, with n the sum of the m.
    """
    n = sum(len(block) for block in blocks)
    matrix = np.zeros((n, n, *batch))
    start = 0
    for block in blocks:
        rows = slice(start, start + len(block))
        matrix[rows, rows] = with_trailing(block, len(batch), leading=2)
        start += len(block)
    return matrix


def largest_deviation(cov: Array) -> float:
    """Return an upper bound of a covariance's standard deviation in any direction.

    For n = 2 it is the largest standard deviation itself.

    Parameters
    ----------
    cov : array (n, n)
        Covariance of components that have one unit.

    Returns
    -------
    float
        Standard deviation, in that unit.
    """
    if len(cov) != 2:
        # The trace is the sum of the eigenvalues, so at least the largest.
        return float(np.sqrt(np.diagonal(cov).sum()))
    # The larger eigenvalue of [[a, b], [b, d]] is (a + d) / 2 + sqrt((a - d)^2 / 4 + b^2).
    half = 0.5 * (cov[0, 0] - cov[1, 1])
    spread = np.sqrt(half * half + cov[0, 1] * cov[0, 1])
    return float(np.sqrt(0.5 * (cov[0, 0] + cov[1, 1]) + spread))


def whiten_in_range(L: Array, b: Array) -> Array:
    """Solve ``L y = b`` in the range of a lower triangle L, which may have columns of zeros.

    Parameters
    ----------
    L : array (n, n, *batch)
        Lower triangle, with as many batch axes as b. For b (n, M, N) the batch may be (M, 1).
    b : array (n, *batch)
        Vectors.

    Returns
    -------
    array (n, *batch)
        Solution y. A row is zero where L's diagonal is zero or NaN.
    """
    y = np.zeros(np.broadcast_shapes(b.shape, L.shape[1:]))
    for i, pivot in enumerate(diagonal(L)):
        rest = b[i]
        for j in range(i):
            rest = rest - L[i, j] * y[j]
        y[i] = np.where(pivot > 0.0, rest * (1.0 / np.where(pivot > 0.0, pivot, 1.0)), 0.0)
    return y


def product(A: Array, B: Array) -> Array:
    """Compute ``A B`` to some 45 bits.

    Each factor is split into two with 23 bits (Ozaki et al. 2012). Sums of 128 products of these are
    exact, so BLAS may add them in any order. Longer sums are cut into such pieces.

    Parameters
    ----------
    A : array (r, ..., n)
        First factor. The bits of ``A[i]`` are counted from its largest number, so that much smaller ones
        lose digits.
    B : array (n, p)
        Second factor. Its bits are counted from its largest number.

    Returns
    -------
    array (r, ..., p)
        Product.
    """
    if len(B) > _EXACT:
        first = slice(_EXACT)
        rest = slice(_EXACT, None)
        return product(A[..., first], B[first]) + product(A[..., rest], B[rest])
    B1, B2 = (half.reshape(B.shape) for half in _halves(B.reshape(1, -1)))
    out = np.empty((*A.shape[:-1], B.shape[1]))
    # A B = A1 B2 + A2 B1 + A1 B1 (A2 B2 is below 45 bits), for as many rows of A as fit the cache.
    size = max(1, _AT_ONCE // max(1, prod(A.shape[1:])))
    for i in range(0, len(A), size):
        rows = A[i : i + size]
        A1, A2 = (half.reshape(-1, len(B)) for half in _halves(rows.reshape(len(rows), -1)))
        target = out[i : i + size].reshape(-1, B.shape[1])  # a view
        np.matmul(A1, B2, out=target)
        target += A2 @ B1
        target += A1 @ B1
    return out


def _halves(rows: Array) -> tuple[Array, Array]:
    """Split each number into its leading 23 bits, counted from its row's largest, and the next 23."""
    largest = np.maximum(rows.max(axis=1), -rows.min(axis=1))
    _, exponent = np.frexp(np.where(np.isfinite(largest), largest, 0.0)[:, None])
    out = []
    rest = rows
    for bits in (23, 46):
        rounding = np.ldexp(1.5, exponent + (52 - bits))  # what is added to it loses its lower bits
        # Round to the leading bits; the remainder is exact.
        head = rest + rounding
        head -= rounding
        out.append(head)
        rest = rest - head
    return out[0], out[1]
