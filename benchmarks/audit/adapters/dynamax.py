"""dynamax: `lgssm_filter`, in 64 bits; a missing measurement, which it has not, is one of R = 1e12 R."""

import jax

jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp
import numpy as np
from dynamax.linear_gaussian_ssm import lgssm_filter
from dynamax.linear_gaussian_ssm.inference import make_lgssm_params

from benchmarks.audit.linear import Batch

LENGTH = 32  # compiled once: further measurements are zero, and change nothing before them


@jax.jit
def filtered(mean, cov, Fs, Qs, H, Rs, z):
    out = lgssm_filter(make_lgssm_params(mean, cov, Fs, Qs, H, Rs), z)
    return out.filtered_means, out.filtered_covariances


class Kalman(Batch, kind="lgssm_filter"):
    def filtered(self, z, H, R):
        T, (mean, cov) = len(z), self.first
        missing = np.isnan(z).any(axis=1)
        Rs = np.array([*np.where(missing[:, None, None], 1e12 * R, R), *[R] * (LENGTH - T)])
        # Those of time t lead to t, so the first are unused.
        Fs, Qs = (np.array([*a, *[np.eye(4)] * (LENGTH - T)]) for a in (self.Fs, self.Qs))
        rows = np.zeros((LENGTH, 2))
        rows[:T] = np.nan_to_num(z)
        means, covs = filtered(*map(jnp.asarray, (mean, cov, Fs, Qs, H, Rs, rows)))
        return np.array(means[T - 1]), np.array(covs[T - 1])
