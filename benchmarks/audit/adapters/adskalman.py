"""adskalman: a Kalman filter of one step and of all."""

import adskalman.adskalman as adskalman
import numpy as np

from benchmarks.audit.linear import Batch, Matrices


class Kalman(Matrices, kind="KalmanFilter.step"):
    def start(self, mean, cov):
        self.x, self.P = mean, cov

    def step(self, z, dt):
        (F, Q), (H, R) = self.motion_matrices(), self.sensor_matrices()
        one = adskalman.KalmanFilter(F, H, Q, R, self.x, self.P)
        self.x, self.P = one.step(z)
        return self.x, self.P


class InOneCall(Batch, kind="kalman_filter"):
    def filtered(self, z, H, R):
        F, Q = self.constant()
        means, covs = adskalman.kalman_filter(z, F, H, Q, R, *self.first)
        return np.asarray(means[-1]), covs[-1]
