"""tfilterspy: linear, extended and unscented filters of one step after the other."""

from tfilterspy.state_estimation.extended_kalman import ExtendedKalmanFilter
from tfilterspy.state_estimation.linear_filters import KalmanFilter
from tfilterspy.state_estimation.unscented_kalman import UnscentedKalmanFilter

from benchmarks.audit.linear import Functions
from benchmarks.audit.nonlinear import EXTENDED, SigmaPoints


class Online(Functions):
    """`filter_step`: it has no prediction alone, so a missing measurement gets R = 1e12 R."""

    def start(self, mean, cov):
        self.x, self.P = mean, cov

    def step(self, z, dt):
        scale = 1.0
        if z is None:
            z, scale = self.h(self.f(self.x)), 1e12
        self.x, self.P = self.new(scale).filter_step(z)
        return self.x, self.P


class Kalman(Online, kind="KalmanFilter.filter_step"):
    def new(self, scale):
        (F, Q), (H, R) = self.motion_matrices(), self.sensor_matrices()
        return KalmanFilter(F, H, Q, scale * R, self.x, self.P)


class Extended(Online, kind="ExtendedKalmanFilter.filter_step"):
    rule = EXTENDED

    def new(self, scale):
        self.refuse_angles()
        Q, R = self.noises
        return ExtendedKalmanFilter(self.f, self.h, self.F, self.H, Q, scale * R, self.x, self.P)


class Unscented(Online, kind="UnscentedKalmanFilter.filter_step"):
    rule = SigmaPoints(alpha=1e-3, beta=2.0)

    def new(self, scale):
        self.refuse_angles()
        Q, R = self.noises
        return UnscentedKalmanFilter(self.f, self.h, Q, scale * R, self.x, self.P)
