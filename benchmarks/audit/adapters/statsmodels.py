"""statsmodels: the Kalman filter of its state space models."""

import numpy as np
from statsmodels.tsa.statespace.kalman_filter import KalmanFilter

from benchmarks.audit.linear import Batch


class Kalman(Batch, kind="KalmanFilter.filter"):
    univariate = False

    def filtered(self, z, H, R):
        n_z, n = H.shape
        one = KalmanFilter(
            n_z, n, initialization="known", constant=self.first[0], stationary_cov=self.first[1]
        )
        one.bind(z)
        one["design"], one["obs_cov"], one["selection"] = H, R, np.eye(n)
        # Those of time t lead to t + 1.
        one["transition"] = np.stack([*self.Fs[1:], np.eye(n)], axis=2)
        one["state_cov"] = np.stack([*self.Qs[1:], np.eye(n)], axis=2)
        one.set_filter_method(filter_univariate=self.univariate)
        out = one.filter()
        return out.filtered_state[:, -1], out.filtered_state_cov[..., -1]


class Univariate(Kalman, kind="KalmanFilter.filter, univariate"):
    univariate = True
