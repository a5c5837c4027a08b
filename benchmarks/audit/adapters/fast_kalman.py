"""fast-kalman: a linear filter of C++, imported as `kalman`."""

import numpy as np
from kalman import LinearKalmanFilter

from benchmarks.audit.linear import Matrices


class Kalman(Matrices, kind="LinearKalmanFilter"):
    def start(self, mean, cov):
        self.one = LinearKalmanFilter(4, 2)
        self.one.x, self.one.P = list(mean), list(np.ravel(cov))

    def step(self, z, dt):
        one, (F, Q), (H, R) = self.one, self.motion_matrices(), self.sensor_matrices()
        one.F, one.Q, one.H, one.R = (list(np.ravel(a)) for a in (F, Q, H, R))
        one.predict()
        if z is not None:
            one.correct(list(z))
        return np.array(one.x), np.reshape(one.P, (4, 4))
