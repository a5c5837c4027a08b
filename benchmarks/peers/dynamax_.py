"""dynamax: `lgssm_filter`, mapped over the runs and compiled."""

import jax
import jax.numpy as jnp
import numpy as np
from dynamax.linear_gaussian_ssm import lgssm_filter
from dynamax.linear_gaussian_ssm.inference import make_lgssm_params

from trackbench.core.arrays import Array


@jax.jit
def _filtered(F, Q, R, mean, cov, z):
    H = jnp.zeros((2, 4)).at[0, 0].set(1.0).at[1, 2].set(1.0)

    def one(mean, z):
        # The package's first state is the one first measured: the prior moved on by a step.
        params = make_lgssm_params(F @ mean, F @ cov @ F.T + Q, F, Q, H, R)
        return lgssm_filter(params, z).filtered_means

    return jax.vmap(one, in_axes=(1, 2))(mean, z)


def kalman_cv(F: Array, Q: Array, R: Array, mean: Array, cov: Array, z: Array) -> Array:
    """Kalman filter of z (2, T, M) from N(mean, cov), mean (4, M); estimates (4, T, M)."""
    found = _filtered(F, Q, R, mean, cov, z.swapaxes(0, 1))
    return np.asarray(found).transpose(2, 1, 0)
