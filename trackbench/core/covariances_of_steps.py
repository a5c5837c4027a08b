"""Covariances of several steps in one array, whether or not the runs of a step share one."""

from collections.abc import Sequence

import numpy as np

from trackbench.core.arrays import Array, with_trailing


def stack_covariances(covs: Sequence[Array]) -> Array:
    """Stack the covariances, (n, n) or (n, n, M) each, of S steps to one array (n, n, S, M).

    The array is (n, n, S, 1) if the runs of every step share one covariance.
    """
    if all(cov.ndim == 2 for cov in covs):
        return np.stack(covs, axis=2)[..., None]
    if any(cov.shape != covs[0].shape for cov in covs):
        covs = [with_trailing(cov, 1, leading=2) for cov in covs]
        # A covariance that the runs of a step share is repeated if another step has one per run.
        widest = max((cov.shape for cov in covs), key=lambda shape: shape[-1])
        covs = [np.broadcast_to(cov, widest) for cov in covs]
    return np.stack(covs, axis=2)
