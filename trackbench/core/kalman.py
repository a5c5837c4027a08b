"""The Kalman filter's two equations, batched: predict, and update in Joseph's form.

NaN marks a missing component of a measurement. The update uses the remaining components; a run without
any keeps its prediction.
"""

from typing import NamedTuple, TypeAlias

import numpy as np

from trackbench.core import compiled, linalg
from trackbench.core.arrays import Array, any_nan, with_axes_of, with_trailing
from trackbench.core.constant_matrix_cache import cached_if_constant
from trackbench.core.counted_operations import count_operations
from trackbench.core.distributions import Factored, Gaussian, from_root, zero_mean_log_prob
from trackbench.core.elementary import log
from trackbench.core.missing_components import drop_missing, log_prob_of_measured

_MOST_INVERTED = 40
"""Measured components up to which a gain takes the inverse of S, in n^3 steps, and R counts as small."""


class Innovation(NamedTuple):
    """Innovation of a measurement, with its covariance."""

    nu: Array
    """innovation (n_z, *batch), NaN where a component is missing"""
    S: Array
    """covariance (n_z, n_z[, *batch])"""
    volume_ratio: Array | float = 1.0
    """volume of converted measurements per volume of measurements (*batch), if ``nu`` is converted"""
    root: Array | None = None
    """lower factor of S, if it was computed without S"""
    predicted: Gaussian | None = None
    """prediction that the measurement updates, if an update without it returns the same bytes"""

    @property
    def nis(self) -> Array:
        """Normalized innovation squared, nu' S^-1 nu (*batch), with mean n_z.

        It uses the measured components, and is NaN if all are missing.
        """
        if not any_nan(self.nu):
            return linalg.mahalanobis(self.nu, self.S, self.root)
        missing = np.isnan(self.nu)
        # A missing component has the row of a unit matrix in S, and so a zero adds nothing.
        nis = linalg.mahalanobis(np.where(missing, 0.0, self.nu), self.S, self.root)
        return np.where(missing.all(axis=0), np.nan, nis)

    def nis_and_scale(self) -> tuple[Array, Array, Array]:
        """Compute NIS (*batch), and mantissa and exponent of sqrt(det S), from one Cholesky factor."""
        L = linalg.cholesky(self.S) if self.root is None else self.root
        # A missing component is zero and has the row of a unit matrix in S: it changes no result.
        known = np.where(np.isnan(self.nu), 0.0, self.nu) if any_nan(self.nu) else self.nu
        return linalg.mahalanobis(known, self.S, L), *linalg.root_determinant(L)

    @property
    def log_likelihood(self) -> Array:
        """Log N(nu; 0, S) (*batch), the log-density of the measurement before any conversion.

        It uses the measured components, and is NaN if all are missing.
        """
        if not any_nan(self.nu):
            value = zero_mean_log_prob(self.nu, self.S, self.root)
        else:
            missing = np.isnan(self.nu)
            # Leave out the missing components of each run.
            value = log_prob_of_measured(self.nu, self.S, missing, self.root)
            value = np.where(missing.all(axis=0), np.nan, value)
        # Change of variables: a converted measurement adds the log of the volume ratio, which is the
        # float 1.0 if nothing was converted.
        return value if isinstance(self.volume_ratio, float) else value + log(self.volume_ratio)


Updated: TypeAlias = tuple[Gaussian, Innovation]
"""A posterior and the innovation of its update."""


def predict(state: Gaussian, F: Array, Q: Array, mean: Array | None = None) -> Gaussian:
    """Predict: ``N(F m, F P F' + Q)``.

    Parameters
    ----------
    state : Gaussian
        Posterior of the step before: m (n, *batch), P (n, n[, *batch]).
    F, Q : (n, n[, *batch])
        Transition matrix (or Jacobian) and covariance of the process noise.
    mean : (n, *batch), optional
        Predicted mean of a nonlinear motion, in place of F m.

    Returns
    -------
    Gaussian
        Prediction.
    """
    predicted = linalg.matvec(F, state.mean) if mean is None else mean
    if isinstance(state, Factored):
        # [F L, Q^1/2] = [L_pred 0] U' with an orthogonal matrix U
        columns = linalg.beside(linalg.matmul(F, state.root), linalg.root(Q))
        return from_root(predicted, linalg.triangular(columns))
    return Gaussian(predicted, _predicted_cov(F, state.cov, Q))


@cached_if_constant
def _predicted_cov(F: Array, P: Array, Q: Array) -> Array:
    FPF = linalg.sandwich(F, P)
    return FPF + with_axes_of(FPF, Q)


def update(predicted: Gaussian, nu: Array, H: Array, R: Array) -> Updated:
    """Condition on the innovation ``nu = z - h(m)`` of a measurement ``z = H x + N(0, R)``.

    ``S = H P H' + R``, ``K = P H' S^-1``, mean ``m + K nu``; the covariance in Joseph's form
    ``(I - K H) P (I - K H)' + K R K'`` stays symmetric positive definite for any gain.

    Parameters
    ----------
    predicted : Gaussian
        Prediction: m (n, *batch), P (n, n[, *batch]).
    nu : (n_z, *batch)
        Innovation, NaN where a component is missing.
    H : (n_z, n[, *batch])
        Measurement matrix, or Jacobian at m.
    R : (n_z, n_z[, *batch])
        Covariance of the measurement noise.

    Returns
    -------
    Updated
        Posterior, and the innovation with S.
    """
    known = nu
    if any_nan(nu):
        # A component is missing if it is NaN for another reason than a diverged prediction, whose run
        # stays NaN.
        missing = np.isnan(nu) & np.isfinite(predicted.mean).all(axis=0)
        H, R = drop_missing(H, R, missing)
        known = np.where(missing, 0.0, nu)
    if isinstance(predicted, Factored):
        L = predicted.root
        posterior, root = update_roots(predicted.mean, known, L, linalg.matmul(H, L), R)
        return posterior, Innovation(nu, linalg.matmul(root, linalg.transpose(root)), root=root)
    S, K = gain(predicted.cov, H, R)
    return _with_gain(predicted, known, K, H, R), Innovation(nu, S, predicted=predicted)


def update_roots(m: Array, nu: Array, dx: Array, dz: Array, R: Array) -> tuple[Factored, Array]:
    """Update by roots, ``P = dx dx'``, ``C = dx dz'``, ``S = dz dz' + R``.

    ``[dz R^1/2; dx 0] = [S^1/2 0; G P^1/2] U'`` with an orthogonal matrix U, mean ``m + G S^-1/2 nu``
    (Kaminski, Bryson & Schmidt 1971; for points Arasaratnam & Haykin 2009, appendix).

    Parameters
    ----------
    m : array (n, *batch)
        Predicted mean.
    nu : array (n_z, *batch)
        Innovation, zero where a component is missing.
    dx, dz : array (n, p[, *batch]) and (n_z, p[, *batch])
        Roots of P and of the measurement's part of S. The row of a missing component in dz is zero, so
        that it changes neither mean nor covariance.
    R : array (n_z, n_z[, *batch])
        Covariance of the measurement noise, with the row of a unit matrix for a missing component.

    Returns
    -------
    posterior : Factored
        Posterior with its lower root.
    S_root : array (n_z, n_z[, *batch])
        Lower root of S.
    """
    n_z = len(dz)
    # Blocks below each other are transposed blocks beside each other.
    transpose = linalg.transpose
    deviations = transpose(linalg.beside(transpose(dz), transpose(dx)))
    noise = linalg.root(R)
    added = transpose(linalg.beside(transpose(noise), np.zeros((n_z, len(dx)))))
    L = linalg.triangular(linalg.beside(deviations, added))
    S_root = L[:n_z, :n_z]
    G = L[n_z:, :n_z]
    root = L[n_z:, n_z:]
    count_operations("covariances", root, component_axes=2)
    mean = m + linalg.matvec(G, linalg.solve_lower(S_root, nu))
    return from_root(mean, root), S_root


def update_with_gain(predicted: Gaussian, nu: Array, K: Array, H: Array, R: Array) -> Gaussian:
    """Update by any gain K, in Joseph's form; a run with a missing component keeps its prediction.

    Parameters
    ----------
    predicted : Gaussian
        Prediction: m (n, *batch), P (n, n[, *batch]).
    nu : array (n_z, *batch)
        Innovation, NaN where a component is missing.
    K : array (n, n_z[, *batch])
        Gain.
    H, R : array (n_z, n[, *batch]) and (n_z, n_z[, *batch])
        Measurement matrix and covariance of the measurement noise.

    Returns
    -------
    Gaussian
        Posterior: ``m + K nu``, ``(I - K H) P (I - K H)' + K R K'``.
    """
    if any_nan(nu):
        # A run whose prediction has diverged keeps its NaN.
        missing = np.isnan(nu).any(axis=0) & np.isfinite(predicted.mean).all(axis=0)
        # K = 0 leaves mean and covariance at the prediction.
        K = np.where(missing, 0.0, with_trailing(K, nu.ndim - 1, leading=2))
        nu = np.where(missing, 0.0, nu)
    return _with_gain(predicted, nu, K, H, R)


def _with_gain(predicted: Gaussian, nu: Array, K: Array, H: Array, R: Array) -> Gaussian:
    """Update a prediction by a gain K that need not be optimal (Joseph form).

    nu is zero where a component is missing, and H or K has zeros for it.
    """
    count_operations("covariances", predicted.cov, component_axes=2)
    # m + K nu
    mean = predicted.mean + linalg.matvec(K, nu)
    return Gaussian(mean, _joseph(predicted.cov, K, H, R))


@cached_if_constant
def gain(P: Array, H: Array, R: Array) -> tuple[Array, Array]:
    """Compute ``S = H P H' + R`` and ``K = P H' S^-1``.

    Parameters
    ----------
    P : array (n, n[, *batch])
        Predicted covariance.
    H : array (n_z, n[, *batch])
        Measurement matrix.
    R : array (n_z, n_z[, *batch])
        Covariance of the measurement noise.

    Returns
    -------
    S : array (n_z, n_z[, *batch])
        Covariance of the innovation.
    K : array (n, n_z[, *batch])
        Gain.
    """
    if compiled.kernels:
        n_z = len(H)
        n, *batch = P.shape[1:]
        S = np.empty((n_z, n_z, *batch))
        K = np.empty((n, n_z, *batch))
        # The kernel returns False for arrays that it leaves to numpy.
        if compiled.kernels.gain(P, H, R, S, K):
            return S, K
    HP = linalg.matmul(H, P)
    # S = H P H' + R
    S = linalg.symmetrize(linalg.matmul(H, linalg.transpose(HP)))
    S = S + with_axes_of(S, R)
    # K = (H P)' S^-1
    return S, _times_inverse(linalg.transpose(HP), S)


@cached_if_constant
def _joseph(P: Array, K: Array, H: Array, R: Array) -> Array:
    """Compute ``(I - K H) P (I - K H)' + K R K'``."""
    if compiled.kernels:
        out = np.empty(P.shape)
        # The kernel returns False for arrays that it leaves to numpy.
        if compiled.kernels.joseph(P, H, R, K, out):
            return out
    IKH = linalg.identity_minus(linalg.matmul(K, H))
    # A large R that all runs share stays a matrix (n_z, n_z), so that the product skips its zeros. A
    # small one gets the batch axes of K, so that the product is one operation on all runs.
    if len(R) <= _MOST_INVERTED:
        R = with_axes_of(K, R)
    return linalg.sandwich(IKH, P) + linalg.sandwich(K, R)


def condition(predicted: Gaussian, nu: Array, C: Array, S: Array) -> Gaussian:
    """Condition on an innovation: mean ``m + K nu``, covariance ``P - K S K'`` with ``K = C S^-1``.

    Parameters
    ----------
    predicted : Gaussian
        Prediction: m (n, *batch), P (n, n, *batch).
    nu : array (n_z, *batch)
        Innovation, zero where a component is missing.
    C : array (n, n_z, *batch)
        Covariance of state and measurement, with a column of zeros for a missing component.
    S : array (n_z, n_z, *batch)
        Covariance of the innovation, with the row and column of a unit matrix for a missing component.

    Returns
    -------
    Gaussian
        Posterior.
    """
    m = predicted.mean
    P = predicted.cov
    if compiled.kernels:
        mean = np.empty(m.shape)
        cov = np.empty(P.shape)
        # The kernel returns False for arrays that it leaves to numpy.
        if compiled.kernels.condition(m, P, nu, C, S, mean, cov):
            return Gaussian(mean, cov)
    K = _times_inverse(C, S)
    return Gaussian(m + linalg.matvec(K, nu), P - linalg.sandwich(K, S))


def _times_inverse(C: Array, S: Array) -> Array:
    """Compute ``C S^-1`` for C (m, n[, *batch]) and S (n, n[, *batch]); for large n in m n^2 steps."""
    if len(S) <= _MOST_INVERTED:
        return linalg.matmul(C, linalg.inverse(S))
    # L L' x = c for each row c of C; L' with its axes reversed is lower as well.
    L = linalg.cholesky(S)
    reverse = linalg.transpose(L)[::-1, ::-1]
    rows = [linalg.solve_lower(reverse, linalg.solve_lower(L, c)[::-1])[::-1] for c in C]
    return np.stack(rows)
