"""cuthbert: its square-root Kalman filter, a step after the other, in 64 bits."""

import jax

jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp
import numpy as np
from cuthbert.gaussian import kalman

from benchmarks.audit.linear import Matrices


@jax.jit
def combined(now, F, root_Q, H, root_R, z):
    zero = jnp.zeros(4), jnp.zeros(2)
    following = kalman.filter_prepare(
        0, lambda _: (F, zero[0], root_Q), lambda _: (H, zero[1], root_R, z)
    )
    return kalman.filter_combine(now, following)


class Kalman(Matrices, kind="gaussian.kalman"):
    def start(self, mean, cov):
        self.now = kalman.init_prepare(mean, np.linalg.cholesky(cov))
        self.now = self.now._replace(model_inputs=0)

    def step(self, z, dt):
        (F, Q), (H, R) = self.motion_matrices(), self.sensor_matrices()
        # A missing measurement is one of R = 1e12 R.
        scale, z = (1e6, np.zeros(2)) if z is None else (1.0, z)
        roots = np.linalg.cholesky(Q), scale * np.linalg.cholesky(R)
        self.now = combined(self.now, F, roots[0], H, roots[1], z)
        root = np.array(self.now.chol_cov)
        return np.array(self.now.mean), root @ root.T
