"""pykalman: batch and online Kalman filters, square-root forms, and additive UKF."""

import numpy as np
from pykalman import AdditiveUnscentedKalmanFilter, KalmanFilter, UnscentedKalmanFilter
from pykalman.sqrt import BiermanKalmanFilter, CholeskyKalmanFilter

from benchmarks.audit.linear import Batch, Functions, Matrices
from benchmarks.audit.nonlinear import Augmented, SigmaPoints


class Standard(Batch, kind="KalmanFilter.filter"):
    """`filter` of all measurements: the prior is that of the first measurement."""

    shown_by = "pykalman_batch"

    def filtered(self, z, H, R):
        mean, cov = self.first
        # A missing measurement more: it takes a single one of n components for n of one.
        one = KalmanFilter(
            np.array([*self.Fs[1:], np.eye(4)]),
            H,
            np.array([*self.Qs[1:], np.eye(4)]),
            R,
            None,
            None,
            mean,
            cov,
        )
        means, covs = one.filter(np.ma.masked_invalid([*z, [np.nan] * len(H)]))
        return means[-2], covs[-2]


class OneByOne(Matrices, kind="KalmanFilter.filter_update"):
    def start(self, mean, cov):
        self.x, self.P, self.one = mean, cov, KalmanFilter(n_dim_state=4, n_dim_obs=2)

    def step(self, z, dt):
        (F, Q), (H, R) = self.motion_matrices(), self.sensor_matrices()
        zero = np.zeros(4)
        self.x, self.P = self.one.filter_update(self.x, self.P, z, F, zero, Q, H, np.zeros(2), R)
        return np.asarray(self.x), self.P


class OfRoots(Batch):
    """The square-root filters document one covariance for all times."""

    def filtered(self, z, H, R):
        (F, Q), (mean, cov) = self.constant(), self.first
        one = self.cls(F, H, Q, R, None, None, mean, cov)
        means, covs = one.filter(np.ma.masked_invalid([*z, [np.nan] * len(H)]))
        return means[-2], covs[-2]


class Cholesky(OfRoots, kind="CholeskyKalmanFilter.filter"):
    cls = CholeskyKalmanFilter


class Bierman(OfRoots, kind="BiermanKalmanFilter.filter"):
    cls = BiermanKalmanFilter


class Additive(Functions, kind="AdditiveUnscentedKalmanFilter.filter_update"):
    rule = SigmaPoints(kappa=-1.0)

    def start(self, mean, cov):
        self.x, self.P = mean, cov
        self.refuse_angles()

    def step(self, z, dt):
        Q, R = self.noises
        self.x, self.P = self.new(Q, R).filter_update(self.x, self.P, z)
        return np.asarray(self.x), self.P

    def new(self, Q, R):
        return AdditiveUnscentedKalmanFilter(self.f, self.h, Q, R, self.x, self.P)


class Unscented(Additive, kind="UnscentedKalmanFilter.filter_update"):
    rule = Augmented(kappa=-7.0)

    def new(self, Q, R):
        return UnscentedKalmanFilter(
            lambda x, v: self.f(x) + v, lambda x, v: self.h(x) + v, Q, R, self.x, self.P
        )
