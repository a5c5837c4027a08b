"""kalmankit: standard and extended Kalman filters, a prediction and an update each."""

import numpy as np
from kalmankit import ExtendedKalmanFilter, KalmanFilter

from benchmarks.audit.linear import Functions
from benchmarks.audit.nonlinear import EXTENDED

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
    rule = EXTENDED

    def step(self, z, dt):
        self.refuse_angles()
        Q, R = self.noises
        one = ExtendedKalmanFilter(
            self.x, self.P, [Q], [R], lambda x, u: self.f(x), self.h, lambda x, u: self.F(x), self.H
        )
        self.x, self.P = one.predict(self.x, NONE, self.P, Q)
        if z is not None:
            self.x, self.P = one.update(self.x, self.P, z, R)
        return self.x, self.P
