"""filterpy: Kalman, square-root, information, extended, unscented and cubature filters."""

import numpy as np
from filterpy.kalman import (
    CubatureKalmanFilter,
    ExtendedKalmanFilter,
    FadingKalmanFilter,
    InformationFilter,
    JulierSigmaPoints,
    KalmanFilter,
    MerweScaledSigmaPoints,
    SimplexSigmaPoints,
    SquareRootKalmanFilter,
    UnscentedKalmanFilter,
)

from benchmarks.audit.linear import Functions
from benchmarks.audit.nonlinear import CUBATURE, EXTENDED, SigmaPoints
from trackbench.adapters import FilterPy


class Linear(FilterPy, Functions):
    """Any class that has F, Q, H and R."""

    def make(self, dt):
        one = self.new()
        (one.F, one.Q), (one.H, one.R) = self.motion_matrices(), self.sensor_matrices()
        return one


class Kalman(Linear, kind="KalmanFilter"):
    def new(self):
        return KalmanFilter(dim_x=4, dim_z=2)


class SquareRoot(Linear, kind="SquareRootKalmanFilter"):
    shown_by = "filterpy_root"

    def new(self):
        return SquareRootKalmanFilter(dim_x=4, dim_z=2)


class Fading(Linear, kind="FadingKalmanFilter"):
    def new(self):
        return FadingKalmanFilter(alpha=1.0, dim_x=4, dim_z=2)


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


class Extended(FilterPy, Functions, kind="ExtendedKalmanFilter"):
    shown_by = "filterpy_distance"
    rule = EXTENDED

    def move(self, one):
        """Set F and the prediction, which the class documents to be overridden."""
        one.F = self.F(one.x)
        one.x = self.f(one.x)

    def make(self, dt):
        one = ExtendedKalmanFilter(dim_x=4, dim_z=2)
        one.x = np.zeros(4)  # else columns, also of h and residual
        one.predict_x = lambda u=0: self.move(one)
        one.Q, one.R = self.noises
        return one, {"HJacobian": self.H, "Hx": self.h, "residual": self.residual}


class SigmaPoint(FilterPy, Functions):
    """Any sigma-point filter with functions for angles."""

    def mean_of(self, points, weights):
        # Angles are averaged about the first point.
        first = points[0]
        return first + weights @ np.array([self.residual(p, first) for p in points])


class Unscented(SigmaPoint):
    def make(self, dt):
        one = UnscentedKalmanFilter(
            4,
            2,
            dt,
            self.h,
            lambda x, dt: self.f(x),
            self.points(),
            residual_z=self.residual,
            z_mean_fn=self.mean_of,
        )
        one.Q, one.R = self.noises
        return one


class Merwe(Unscented, kind="UnscentedKalmanFilter, Merwe"):
    shown_by = "filterpy_unscented"

    rule = SigmaPoints(alpha=0.5, beta=2.0)

    def points(self):
        return MerweScaledSigmaPoints(4, alpha=0.5, beta=2.0, kappa=0.0)


class Julier(Unscented, kind="UnscentedKalmanFilter, Julier"):
    shown_by = "filterpy_unscented"

    rule = SigmaPoints(kappa=1.0)

    def points(self):
        return JulierSigmaPoints(4, kappa=1.0)


class Simplex(Unscented, kind="UnscentedKalmanFilter, simplex"):
    shown_by = "filterpy_simplex"

    rule = SigmaPoints(is_simplex=True)

    def points(self):
        return SimplexSigmaPoints(4)


class Cubature(SigmaPoint, kind="CubatureKalmanFilter"):
    shown_by = "filterpy_cubature"
    rule = CUBATURE

    def make(self, dt):
        self.refuse_angles()
        one = CubatureKalmanFilter(4, 2, dt, self.h, lambda x, dt: self.f(x))
        one.Q, one.R = self.noises
        return one
