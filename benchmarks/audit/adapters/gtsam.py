"""GTSAM: its Kalman filter of information matrices, through Python."""

import gtsam
import numpy as np

from benchmarks.audit.linear import Matrices


class Kalman(Matrices, kind="KalmanFilter"):
    def start(self, mean, cov):
        self.filter = gtsam.KalmanFilter(4)
        self.now = self.filter.init(mean, cov)

    def step(self, z, dt):
        (F, Q), (H, R) = self.motion_matrices(), self.sensor_matrices()
        zero = np.zeros((4, 1))
        self.now = self.filter.predictQ(self.now, F, zero, np.zeros(1), Q)
        if z is not None:
            noise = gtsam.noiseModel.Gaussian.Covariance(R)
            self.now = self.filter.update(self.now, H, z, noise)
        return np.array(self.now.mean()), np.array(self.now.covariance())
