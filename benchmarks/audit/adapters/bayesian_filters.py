"""bayesian-filters, a fork of filterpy: linear, information, unscented and cubature filters."""

import numpy as np
from bayesian_filters.kalman import (
    CubatureKalmanFilter,
    InformationFilter,
    KalmanFilter,
    MerweScaledSigmaPoints,
    SquareRootKalmanFilter,
    UnscentedKalmanFilter,
)

from benchmarks.audit.linear import Functions
from benchmarks.audit.nonlinear import CUBATURE, SigmaPoints
from trackbench.adapters import FilterPy


class Linear(FilterPy, Functions):
    def make(self, dt):
        one = self.cls(dim_x=4, dim_z=2)
        (one.F, one.Q), (one.H, one.R) = self.motion_matrices(), self.sensor_matrices()
        return one


class Kalman(Linear, kind="KalmanFilter"):
    cls = KalmanFilter


class SquareRoot(Linear, kind="SquareRootKalmanFilter"):
    cls = SquareRootKalmanFilter


class Unscented(FilterPy, Functions, kind="UnscentedKalmanFilter, Merwe"):
    rule = SigmaPoints(alpha=0.5, beta=2.0)

    def make(self, dt):
        self.refuse_angles()
        points = MerweScaledSigmaPoints(4, alpha=0.5, beta=2.0, kappa=0.0)
        one = UnscentedKalmanFilter(4, 2, dt, self.h, lambda x, dt: self.f(x), points)
        one.Q, one.R = self.noises
        return one


class Cubature(FilterPy, Functions, kind="CubatureKalmanFilter"):
    shown_by = "filterpy_cubature"
    rule = CUBATURE

    def make(self, dt):
        self.refuse_angles()
        one = CubatureKalmanFilter(4, 2, dt, self.h, lambda x, dt: self.f(x))
        one.Q, one.R = self.noises
        return one


class Information(Functions, kind="InformationFilter"):
    shown_by = "filterpy_information"
    likelihood = True

    def start(self, mean, cov):
        self.one = InformationFilter(4, 2, compute_log_likelihood=self.likelihood)
        self.one.x, self.one.P_inv = mean[:, None], np.linalg.inv(cov)

    def step(self, z, dt):
        one, (F, Q), (H, R) = self.one, self.motion_matrices(), self.sensor_matrices()
        one.F, one.Q, one.H, one.R_inv = F, Q, H, np.linalg.inv(R)
        one.predict()
        if z is not None:
            one.update(z[:, None])
        return np.ravel(one.x), np.linalg.inv(one.P_inv)


class Without(Information, kind="InformationFilter, no log-likelihood"):
    likelihood = False
