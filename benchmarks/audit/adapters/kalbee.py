"""kalbee: linear filters in several forms, extended, unscented and cubature filters."""

import kalbee
import numpy as np
from kalbee.modules.filters.sr_ukf import SquareRootUKF

from benchmarks.audit.linear import Functions
from benchmarks.audit.nonlinear import CUBATURE, EXTENDED, SigmaPoints


class Linear(Functions):
    """Any class of F, Q, H and R; a new object takes the matrices of an interval."""

    def start(self, mean, cov):
        self.x, self.P = mean[:, None], cov

    def step(self, z, dt):
        one = self.cls(self.x, self.P, *self.motion_matrices(), *self.sensor_matrices())
        one.predict()
        if z is not None:
            one.update(z[:, None])
        self.x, self.P = one.x, one.P
        return np.ravel(self.x), self.P


class Kalman(Linear, kind="KalmanFilter"):
    cls = kalbee.KalmanFilter


class Information(Linear, kind="InformationFilter"):
    cls = kalbee.InformationFilter


class SquareRoot(Linear, kind="SquareRootKalmanFilter"):
    cls = kalbee.SquareRootKalmanFilter


class Cholesky(Linear, kind="CholeskyKalmanFilter"):
    cls = kalbee.CholeskyKalmanFilter


class CholeskyCovariance(Functions, kind="CholeskyKalmanFilter.covariance"):
    """The attribute `covariance`, which every filter of the package has beside `P`."""

    shown_by = "kalbee_cholesky"

    def start(self, mean, cov):
        (F, Q), (H, R) = self.motion_matrices(), self.sensor_matrices()
        self.one = kalbee.CholeskyKalmanFilter(mean[:, None], cov, F, Q, H, R)

    def step(self, z, dt):
        one = self.one
        one.transition_matrix, one.transition_covariance = self.motion_matrices()
        one.predict()
        if z is not None:
            one.update(z[:, None])
        return np.ravel(one.state), one.covariance


class Nonlinear(Functions):
    """Any class of f and h; there is no option for angles."""

    def start(self, mean, cov):
        self.refuse_angles()
        Q, R = self.noises
        self.one = self.new(mean[:, None], cov, Q, R, self.f_column, self.h_column)

    def new(self, *arguments):
        return self.cls(*arguments)

    def f_column(self, x, dt):
        return self.f(x)[:, None]

    def h_column(self, x):
        return self.h(x)[:, None]

    def step(self, z, dt):
        self.one.transition_covariance = self.noises[0]
        self.one.predict(dt)
        if z is not None:
            self.one.update(z[:, None])
        return np.ravel(self.one.x), self.one.P


class Extended(Nonlinear, kind="ExtendedKalmanFilter"):
    rule = EXTENDED
    shown_by = "kalbee_ekf"

    def new(self, *arguments):
        return kalbee.ExtendedKalmanFilter(
            *arguments,
            transition_jacobian=lambda x, dt: self.F(x),
            measurement_jacobian=self.H,
        )


class Unscented(Nonlinear, kind="UnscentedKalmanFilter"):
    rule = SigmaPoints(alpha=1e-3, beta=2.0)
    cls = kalbee.UnscentedKalmanFilter


class SigmaPoint(Nonlinear, kind="SigmaPointUKF"):
    rule = SigmaPoints(alpha=1e-3, beta=2.0)
    shown_by = "kalbee_sigma_point_ukf"

    cls = kalbee.SigmaPointUKF


class Cubature(Nonlinear, kind="CubatureKalmanFilter"):
    rule = CUBATURE
    cls = kalbee.CubatureKalmanFilter


class RootUnscented(Nonlinear, kind="SquareRootUKF"):
    rule = SigmaPoints(alpha=1e-3, beta=2.0)
    cls = SquareRootUKF
