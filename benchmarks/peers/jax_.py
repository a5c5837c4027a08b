"""JAX by hand: `scan` over steps, `vmap` over runs, compiled; double precision, one CPU thread."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.peers.c_ import merwe_numbers
from trackbench.core.arrays import Array


def _banana(F, root, sigma, x, z, key):
    def step(x, inputs):
        seen, key = inputs
        moving, picking = jax.random.split(key)
        x = F @ x + root @ jax.random.normal(moving, x.shape, dtype=x.dtype)
        e_r = (seen[0] - jnp.sqrt(x[0] ** 2 + x[2] ** 2)) / sigma[0]
        turn = seen[1] - jnp.arctan2(x[2], x[0])
        e_a = (turn - 2.0 * jnp.pi * jnp.round(turn / (2.0 * jnp.pi))) / sigma[1]
        w = jax.nn.softmax(-0.5 * (e_r**2 + e_a**2))
        return _resampled(picking, w, x), x @ w

    keys = jax.random.split(key, len(z))
    return jax.lax.scan(step, x, (z, keys))[1]


_banana_runs = jax.jit(jax.vmap(_banana, in_axes=(None, None, None, 1, 2, 0)))


def banana_pf(F: Array, Q: Array, R: Array, start: Array, z: Array) -> Array:
    """Bootstrap filter of z (2, T, M) from clouds (4, M, N); estimates (4, T, M)."""
    root, sigma = np.linalg.cholesky(Q), np.sqrt(np.diag(R))
    keys = jax.random.split(jax.random.key(1), z.shape[2])
    mean = _banana_runs(F, root, sigma, start, z.swapaxes(0, 1), keys)
    return np.asarray(mean).transpose(2, 1, 0)


def _resampled(key, w, x):
    N = len(w)
    at = (jnp.arange(N) + jax.random.uniform(key, dtype=w.dtype)) / N
    return x[..., jnp.minimum(jnp.searchsorted(jnp.cumsum(w), at), N - 1)]


def _sensor(p, x, early):
    return jnp.where(early, p[3] * x * x, p[4] * x - 2.0)


def _merwe(p, k, z, key, N):
    def step(x, inputs):
        k, seen, key = inputs
        moving, picking = jax.random.split(key)
        # A gamma variate of shape 3 is the sum of three exponential ones.
        u = jax.random.uniform(moving, (3, N), dtype=x.dtype, minval=1e-300)
        x = 1.0 + jnp.sin(p[1] * k) + p[2] * x - jnp.log(u[0] * u[1] * u[2]) / p[6]
        w = jax.nn.softmax(-0.5 * (seen - _sensor(p, x, k <= p[7])) ** 2 / p[5])
        return _resampled(picking, w, x), x @ w

    return jax.lax.scan(step, jnp.full(N, p[0]), (k, z, jax.random.split(key, len(z))))[1]


def _merwe_unscented(p, k, z, key, N):
    # Seven points of state, process noise and measurement noise: alpha 1, beta 0, kappa 2.
    weights = jnp.array([0.4, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1])[:, None]
    apart = jnp.sqrt(5.0) * jnp.array([1.0, -1.0])[:, None]

    def step(state, inputs):
        (old, P), (k, seen, key) = state, inputs
        drawing, picking = jax.random.split(key)
        drive = 1.0 + jnp.sin(p[1] * k)
        mu, V = drive + p[2] * old + 3.0 / p[6], p[2] ** 2 * P + 3.0 / p[6] ** 2
        none, moved = jnp.zeros((2, N)), apart * p[2] * jnp.sqrt(P)
        pushed, noisy = none + apart * jnp.sqrt(3.0) / p[6], none + apart * jnp.sqrt(p[5])
        points = mu + jnp.concatenate([none[:1], moved, pushed, none])
        h = _sensor(p, points, k <= p[7]) + jnp.concatenate([none[:1], none, none, noisy])
        z_mean = (weights * h).sum(0)
        S = (weights * (h - z_mean) ** 2).sum(0)
        K = (weights * (points - mu) * (h - z_mean)).sum(0) / S
        P, e = V - K * K * S, jax.random.normal(drawing, (N,), dtype=old.dtype)
        x = mu + K * (seen - z_mean) + jnp.sqrt(P) * e
        v = x - drive - p[2] * old
        prior = jnp.where(v > 0.0, 2.0 * jnp.log(jnp.abs(v)) - p[6] * v, -1e300)
        fit = -0.5 * (seen - _sensor(p, x, k <= p[7])) ** 2 / p[5]
        w = jax.nn.softmax(prior + fit + 0.5 * e * e + 0.5 * jnp.log(P))
        chosen = _resampled(picking, w, jnp.stack([x, P]))
        return (chosen[0], chosen[1]), x @ w

    first = (jnp.full(N, p[0]), jnp.zeros(N))
    return jax.lax.scan(step, first, (k, z, jax.random.split(key, len(z))))[1]


def _over_runs(filtered):
    return jax.jit(jax.vmap(filtered, in_axes=(None, None, 1, 0, None)), static_argnums=4)


_merwe_runs, _merwe_unscented_runs = _over_runs(_merwe), _over_runs(_merwe_unscented)


def merwe_pf(scenario: Any, z: Array, N: int) -> Array:
    """Bootstrap filter; z (1, T, M), estimates (1, T, M)."""
    return _merwe_estimates(_merwe_runs, scenario, z, N)


def merwe_upf(scenario: Any, z: Array, N: int) -> Array:
    """Unscented particle filter; z (1, T, M), estimates (1, T, M)."""
    return _merwe_estimates(_merwe_unscented_runs, scenario, z, N)


def _merwe_estimates(filtered: Any, scenario: Any, z: Array, N: int) -> Array:
    keys = jax.random.split(jax.random.key(1), z.shape[2])
    k = np.array(scenario.steps[1:], dtype=float)
    return np.asarray(filtered(merwe_numbers(scenario), k, z[0], keys, N)).T[None]


def _kalman(F, Q, R, mean, P, z):
    H = jnp.zeros((2, 4)).at[0, 0].set(1.0).at[1, 2].set(1.0)

    def step(state, seen):
        mean, P = state
        mean, P = F @ mean, F @ P @ F.T + Q
        S = H @ P @ H.T + R
        # By hand: `linalg.solve` takes four times as long as the rest of a step.
        inverse = jnp.array([[S[1, 1], -S[0, 1]], [-S[1, 0], S[0, 0]]])
        K = P @ H.T @ (inverse / (S[0, 0] * S[1, 1] - S[0, 1] * S[1, 0]))
        mean = mean + K @ (seen - H @ mean)
        P = P - K @ S @ K.T
        return (mean, P), mean

    return jax.lax.scan(step, (mean, P), z)[1]


_kalman_runs = jax.jit(jax.vmap(_kalman, in_axes=(None, None, None, 1, None, 2)))


def kalman_cv(F: Array, Q: Array, R: Array, mean: Array, cov: Array, z: Array) -> Array:
    """Kalman filter of z (2, T, M) from N(mean, cov), mean (4, M); estimates (4, T, M)."""
    found = _kalman_runs(F, Q, R, mean, cov, z.swapaxes(0, 1))
    return np.asarray(found).transpose(2, 1, 0)


def _imm(F, Q, R, transition, mean, P, z):
    H = jnp.zeros((2, 4)).at[0, 0].set(1.0).at[1, 2].set(1.0)
    r = len(F)

    def filter_one(F, Q, mean, P, seen):
        mean = F @ mean
        P = F @ P @ F.T + Q
        S = H @ P @ H.T + R
        det = S[0, 0] * S[1, 1] - S[0, 1] * S[1, 0]
        inverse = jnp.array([[S[1, 1], -S[0, 1]], [-S[1, 0], S[0, 0]]]) / det
        K = P @ H.T @ inverse
        e = seen - H @ mean
        density = jnp.exp(-0.5 * e @ inverse @ e) / jnp.sqrt(det)
        return mean + K @ e, P - K @ S @ K.T, density

    def step(state, seen):
        x, P, mu = state
        joint = transition * mu[:, None]
        c = joint.sum(0)
        w = joint / c
        mixed = w.T @ x
        apart = x[:, None] - mixed[None]
        spread = jnp.einsum("ij,ikl->jkl", w, P) + jnp.einsum("ij,ijk,ijl->jkl", w, apart, apart)
        x, P, density = jax.vmap(filter_one, in_axes=(0, 0, 0, 0, None))(F, Q, mixed, spread, seen)
        mu = c * density
        mu = mu / mu.sum()
        return (x, P, mu), mu @ x

    start = (jnp.stack([mean] * r), jnp.stack([P] * r), jnp.full(r, 1.0 / r))
    return jax.lax.scan(step, start, z)[1]


_imm_runs = jax.jit(jax.vmap(_imm, in_axes=(None, None, None, None, 1, None, 2)))


def imm_cv(
    F: Array, Q: Array, R: Array, transition: Array, mean: Array, cov: Array, z: Array
) -> Array:
    """IMM of motions F, Q (r, 4, 4) of z (2, T, M) from N(mean, cov); estimates (4, T, M)."""
    found = _imm_runs(F, Q, R, transition, mean, cov, z.swapaxes(0, 1))
    return np.asarray(found).transpose(2, 1, 0)
