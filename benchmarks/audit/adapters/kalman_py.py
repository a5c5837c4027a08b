"""kalman-py: linear, square-root, extended and unscented filters."""

from kalman_py import ExtendedKalmanFilter, KalmanFilter, UnscentedKalmanFilter

from benchmarks.audit.linear import Functions, Matrices
from benchmarks.audit.nonlinear import EXTENDED, SigmaPoints


class Kalman(Matrices, kind="KalmanFilter"):
    square_root = False

    def start(self, mean, cov):
        (F, Q), (H, R) = self.motion_matrices(), self.sensor_matrices()
        self.one = KalmanFilter(F, H, Q, R, mean, cov, square_root=self.square_root)

    def step(self, z, dt):
        self.one.predict(*self.motion_matrices())
        if z is not None:
            self.one.update(z)
        return self.one.x, self.one.P


class SquareRoot(Kalman, kind="KalmanFilter, square root"):
    square_root = True


class Unscented(Functions, kind="UnscentedKalmanFilter"):
    rule = SigmaPoints(alpha=1.0, beta=2.0)
    square_root = False

    def start(self, mean, cov):
        self.x, self.P = mean, cov

    def new(self, *model):
        root = self.square_root
        return UnscentedKalmanFilter(*model, residual_z=self.residual, square_root=root)

    def step(self, z, dt):
        # A new object for the Q of each interval.
        one = self.new(lambda x, dt: self.f(x), self.h, *self.noises, self.x, self.P)
        one.predict(dt)
        if z is not None:
            one.update(z)
        self.x, self.P = one.x, one.P
        return self.x, self.P


class Extended(Unscented, kind="ExtendedKalmanFilter"):
    rule = EXTENDED

    def new(self, *model):
        return ExtendedKalmanFilter(
            *model,
            jac_f=lambda x, dt: self.F(x),
            jac_h=self.H,
            residual_z=self.residual,
            square_root=self.square_root,
        )


class RootUnscented(Unscented, kind="UnscentedKalmanFilter, square root"):
    square_root = True


class RootExtended(Extended, kind="ExtendedKalmanFilter, square root"):
    square_root = True
