"""Missing components of a measurement: NaN, left out of an update and of the log score."""

import numpy as np

from trackbench.core.arrays import Array, Mask, with_trailing
from trackbench.core.distributions import LOG_2PI, zero_mean_log_prob


def drop_missing(H: Array, R: Array, missing: Mask) -> tuple[Array, Array]:
    """Leave missing components out of the rows of H, and out of the rows and columns of R.

    The shapes stay as they are: a row of H becomes zero, and a row and column of R become those of a
    unit matrix. Constant matrices stay constant if the same components are missing in all runs.

    Parameters
    ----------
    H : array (n_z, n[, *batch])
        Measurement matrix.
    R : array (n_z, n_z[, *batch])
        Covariance of the measurement noise, or of the innovation.
    missing : array (n_z, *batch)
        True where a component is missing.

    Returns
    -------
    H, R : array (n_z, n[, *batch]) and (n_z, n_z[, *batch])
        Matrices without the missing components.
    """
    pattern = missing.reshape(len(missing), -1)
    # One pattern in all runs: drop the batch axes of the mask.
    if H.ndim == R.ndim == 2 and (pattern == pattern[:, :1]).all():
        missing = pattern[:, 0]
    H = np.where(missing[:, None], 0.0, with_trailing(H, missing.ndim - 1, leading=2))
    return H, drop_missing_cov(R, missing)


def drop_missing_cov(R: Array, missing: Mask) -> Array:
    """Leave missing components out of the rows and columns of R.

    They become those of a unit matrix: the variance has no effect, because H is zero there.

    Parameters
    ----------
    R : array (n_z, n_z[, *batch])
        Covariance of the measurement noise, or of the innovation.
    missing : array (n_z, *batch)
        True where a component is missing. A mask (n_z,) is that of all runs.

    Returns
    -------
    array (n_z, n_z[, *batch])
        R without the missing components, with batch axes if R or ``missing`` has them.
    """
    batch = missing.ndim - 1
    either = missing[:, None] | missing[None]
    eye = with_trailing(np.eye(len(missing)), batch, leading=2)
    return np.where(either, eye, with_trailing(R, batch, leading=2))


def log_prob_of_measured(nu: Array, cov: Array, missing: Mask, root: Array | None = None) -> Array:
    """Evaluate log N(nu; 0, cov) of the measured components of nu.

    Parameters
    ----------
    nu : array (n_z, *batch)
        Innovation. Its missing components may have any value.
    cov : array (n_z, n_z[, *batch])
        Covariance of nu, with the row and column of a unit matrix for a missing component.
    missing : array (n_z, *batch)
        True where a component is missing.
    root : array (n_z, n_z[, *batch]), optional
        Cholesky factor of ``cov``, if it is known.

    Returns
    -------
    array (*batch)
        Log-density, 0 where all components are missing.
    """
    value = zero_mean_log_prob(np.where(missing, 0.0, nu), cov, root)
    # Each missing component has entered with the density of N(0, 1) at zero.
    value += 0.5 * LOG_2PI * missing.sum(axis=0)
    return value
