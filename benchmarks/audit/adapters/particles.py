"""particles: its exact Kalman filter of linear Gaussian models."""

import numpy as np
from particles import kalman

from benchmarks.audit.linear import Matrices


class Steps(Matrices, kind="kalman.predict_step, filter_step"):
    def start(self, mean, cov):
        self.now = kalman.MeanAndCov(mean=mean, cov=cov)

    def step(self, z, dt):
        (F, Q), (H, R) = self.motion_matrices(), self.sensor_matrices()
        self.now = kalman.predict_step(F, Q, self.now)
        if z is not None:
            self.now, _ = kalman.filter_step(H, R, self.now, z)
        return np.ravel(self.now.mean), self.now.cov
