"""Covariances of several steps in one array, whether or not the runs of a step share one."""

from collections.abc import Sequence

import numpy as np

from trackbench.core.arrays import Array, with_trailing


def stack_covariances(covs: Sequence[Array]) -> Array:
    """Stack the covariances of K steps to one array.

    Parameters
    ----------
    covs : sequence of arrays (n, n) or (n, n, M)
        Covariance of each step, shared by all runs or one per run.

    Returns
    -------
    array (n, n, K, M)
        Covariances of all steps. Its last axis has the length 1 if the runs of every step share one
        covariance.
    """
    if all(cov.ndim == 2 for cov in covs):
        return np.stack(covs, axis=2)[..., None]
    if any(cov.shape != covs[0].shape for cov in covs):
        covs = [with_trailing(cov, 1, leading=2) for cov in covs]
        # A covariance that the runs of a step share is repeated if another step has one per run.
        widest = max((cov.shape for cov in covs), key=lambda shape: shape[-1])
        covs = [np.broadcast_to(cov, widest) for cov in covs]
    return np.stack(covs, axis=2)
