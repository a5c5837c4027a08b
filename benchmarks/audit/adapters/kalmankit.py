"""kalmankit: standard and extended Kalman filters, a prediction and an update each."""

import numpy as np
from kalmankit import ExtendedKalmanFilter, KalmanFilter

from benchmarks.audit.linear import Functions

NONE = np.array([np.nan])  # no control input


class Kalman(Functions, kind="KalmanFilter.predict, update"):
    def start(self, mean, cov):
        self.x, self.P = mean, cov

    def step(self, z, dt):
        (F, Q), (H, R) = self.motion_matrices(), self.sensor_matrices()
        one = KalmanFilter([F], self.x, None, self.P, [H], [Q], [R])
        self.x, self.P = one.predict(F, self.x, NONE, NONE, self.P, Q)
        if z is not None:
            self.x, self.P = one.update(H, self.x, self.P, z, R)
        return self.x, self.P


class Extended(Kalman, kind="ExtendedKalmanFilter.predict, update"):
    def step(self, z, dt):
        self.sensor_matrices()  # linear only: it has no option for angles
        Q, R = self.noises
        F = self.motion_matrices()[0]
        one = ExtendedKalmanFilter(
            self.x, self.P, [Q], [R], lambda x, u: self.f(x), self.h, lambda x, u: F, self.H
        )
        self.x, self.P = one.predict(self.x, NONE, self.P, Q)
        if z is not None:
            self.x, self.P = one.update(self.x, self.P, z, R)
        return self.x, self.P
