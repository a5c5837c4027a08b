"""JAX by hand: `scan` over steps, `vmap` over runs, compiled; double precision, one CPU thread."""

import jax
import jax.numpy as jnp
import numpy as np

from trackbench.core.arrays import Array


def _banana(F, root, sigma, x, z, key):
    N = x.shape[1]

    def step(x, inputs):
        seen, key = inputs
        moving, picking = jax.random.split(key)
        x = F @ x + root @ jax.random.normal(moving, x.shape, dtype=x.dtype)
        e_r = (seen[0] - jnp.sqrt(x[0] ** 2 + x[2] ** 2)) / sigma[0]
        turn = seen[1] - jnp.arctan2(x[2], x[0])
        e_a = (turn - 2.0 * jnp.pi * jnp.round(turn / (2.0 * jnp.pi))) / sigma[1]
        w = jax.nn.softmax(-0.5 * (e_r**2 + e_a**2))
        at = (jnp.arange(N) + jax.random.uniform(picking, dtype=x.dtype)) / N
        chosen = jnp.searchsorted(jnp.cumsum(w), at)
        return x[:, jnp.minimum(chosen, N - 1)], x @ w

    keys = jax.random.split(key, len(z))
    return jax.lax.scan(step, x, (z, keys))[1]


_banana_runs = jax.jit(jax.vmap(_banana, in_axes=(None, None, None, 1, 2, 0)))


def banana_pf(F: Array, Q: Array, R: Array, start: Array, z: Array) -> Array:
    """Bootstrap filter of z (2, T, M) from clouds (4, M, N); estimates (4, T, M)."""
    root, sigma = np.linalg.cholesky(Q), np.sqrt(np.diag(R))
    keys = jax.random.split(jax.random.key(1), z.shape[2])
    mean = _banana_runs(F, root, sigma, start, z.swapaxes(0, 1), keys)
    return np.asarray(mean).transpose(2, 1, 0)


def _kalman(F, Q, R, mean, P, z):
    H = jnp.zeros((2, 4)).at[0, 0].set(1.0).at[1, 2].set(1.0)

    def step(state, seen):
        mean, P = state
        mean, P = F @ mean, F @ P @ F.T + Q
        S = H @ P @ H.T + R
        K = jnp.linalg.solve(S, H @ P).T
        mean = mean + K @ (seen - H @ mean)
        P = P - K @ S @ K.T
        return (mean, P), mean

    return jax.lax.scan(step, (mean, P), z)[1]


_kalman_runs = jax.jit(jax.vmap(_kalman, in_axes=(None, None, None, 1, None, 2)))


def kalman_cv(F: Array, Q: Array, R: Array, mean: Array, cov: Array, z: Array) -> Array:
    """Kalman filter of z (2, T, M) from N(mean, cov), mean (4, M); estimates (4, T, M)."""
    found = _kalman_runs(F, Q, R, mean, cov, z.swapaxes(0, 1))
    return np.asarray(found).transpose(2, 1, 0)
