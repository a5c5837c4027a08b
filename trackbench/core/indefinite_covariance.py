"""Test of a filter's covariance for a negative eigenvalue that is no rounding error."""

import numpy as np

from trackbench.core.arrays import Array, Mask
from trackbench.core.linalg import diagonal, eigen, root_in_range, symmetrize

INDEFINITE = 1e-10
"""Size of a negative eigenvalue of correlations from which on it is no rounding error of float64."""


def is_indefinite(P: Array) -> Mask:
    """Test whether P is no covariance, as a direction of the state has a negative variance.

    Parameters
    ----------
    P : array (n, n[, *batch])
        Symmetric, finite or not.

    Returns
    -------
    array (*batch)
        True for a finite P whose correlations have an eigenvalue below -`INDEFINITE`. A singular P, and
        one whose negative eigenvalues are rounding errors of float64, is no such matrix.
    """
    # Step 1: matrices without a Cholesky factor. Its last pivots may be rounding errors that grew.
    has_root = np.isfinite(root_in_range(P)).all(axis=(0, 1))
    suspicious = np.asarray(np.isfinite(P).all(axis=(0, 1)) & ~has_root)
    if not suspicious.any():
        return suspicious
    # Step 2: the eigenvalues of their correlations, whose rounding errors do not grow.
    covariances = P[:, :, suspicious]
    scale = np.sqrt(np.abs(diagonal(covariances)))
    scale[scale == 0.0] = 1.0
    eigenvalues, _ = eigen(symmetrize(covariances / (scale[:, None] * scale)))
    suspicious[suspicious] = eigenvalues.min(axis=0) < -INDEFINITE
    return suspicious
