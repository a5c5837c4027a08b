"""smcx: `kalman_filter`, in 64 bits; a missing measurement, which it has not, is one of R = 1e12 R."""

import jax

jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp
import numpy as np
from smcx.kalman import kalman_filter

from benchmarks.audit.linear import Batch

LENGTH = 32  # compiled once: further measurements are zero, and change nothing before them
compiled = jax.jit(kalman_filter)


class Kalman(Batch, kind="kalman_filter"):
    def filtered(self, z, H, R):
        T, (mean, cov) = len(z), self.first
        missing = np.isnan(z).any(axis=1)
        Rs = np.array([*np.where(missing[:, None, None], 1e12 * R, R), *[R] * (LENGTH - T)])
        # Those of time t lead to t + 1.
        Fs, Qs = (np.array([*a[1:], *[np.eye(4)] * (LENGTH - T)]) for a in (self.Fs, self.Qs))
        rows = np.zeros((LENGTH, 2))
        rows[:T] = np.nan_to_num(z)
        out = compiled(*map(jnp.asarray, (mean, cov, Fs, Qs, H, Rs, rows)))
        return np.array(out.filtered_means[T - 1]), np.array(out.filtered_covariances[T - 1])
