"""norfair: the Kalman filter of its trackers, of one point; `norfair.yaml` has its constants."""

import numpy as np
from norfair.filter import OptimizedKalmanFilter

from trackbench.adapters import PerRun


class Optimized(PerRun, kind="OptimizedKalmanFilter"):
    shown_by = "norfair_gap"

    def start(self, mean, cov):
        self.one = OptimizedKalmanFilter(2, 1, cov[0, 0], cov[0, 1], cov[1, 1], q=0.1, r=4.0)
        self.one.x = mean[:, None]

    def step(self, z, dt):
        one = self.one
        one.predict()
        if z is not None:
            one.update(z[:, None])
        (p,), (c,), (v,) = one.pos_variance, one.pos_vel_covariance, one.vel_variance
        return np.ravel(one.x), np.block([[p, c], [c, v]])
