"""simdkalman: Kalman filters of many series at once."""

import numpy as np
import simdkalman

from benchmarks.audit.linear import Batch, Matrices


class Kalman(Batch, kind="KalmanFilter.compute"):
    def filtered(self, z, H, R):
        F, Q = self.constant()
        mean, cov = self.first
        one = simdkalman.KalmanFilter(F, Q, H, R)
        out = one.compute(
            z[None], 0, initial_value=mean, initial_covariance=cov, filtered=True, smoothed=False
        ).filtered.states
        return out.mean[0, -1], out.cov[0, -1]


class OneByOne(Matrices, kind="KalmanFilter.predict_next, update"):
    def start(self, mean, cov):
        self.x, self.P = mean[None, :, None], cov[None]

    def step(self, z, dt):
        one = simdkalman.KalmanFilter(*self.motion_matrices(), *self.sensor_matrices())
        self.x, self.P = one.predict_next(self.x, self.P)
        if z is not None:
            self.x, self.P, *_ = one.update(self.x, self.P, z[None, :, None])
        return np.ravel(self.x), self.P[0]
