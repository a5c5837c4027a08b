"""kalmax: predictions and updates of one step, in 64 bits."""

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np
from kalmax.kalman import kalman_predict, kalman_update

from benchmarks.audit.linear import Matrices

predict, update = jax.jit(kalman_predict), jax.jit(kalman_update)


class Kalman(Matrices, kind="kalman_predict, kalman_update"):
    def start(self, mean, cov):
        self.x, self.P = mean, cov

    def step(self, z, dt):
        (F, Q), (H, R) = self.motion_matrices(), self.sensor_matrices()
        self.x, self.P = predict(self.x, self.P, F, Q, np.zeros((4, 1)), np.zeros(1))
        if z is not None:
            self.x, self.P = update(self.x, self.P, H, R, z)
        return np.array(self.x), np.array(self.P)
