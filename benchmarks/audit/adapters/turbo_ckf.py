"""turbo-ckf: cubature filters of Rust."""

from turbo_ckf import TurboCKF, TurboSRCKF

from benchmarks.audit.linear import Functions


class Cubature(Functions, kind="TurboCKF"):
    cls = TurboCKF

    def start(self, mean, cov):
        self.sensor_matrices()
        H = self.sensor_matrices()[0]
        self.one = self.cls(
            4, 2, self.dt, lambda x: x @ H.T, lambda x, dt: x @ self.motion_matrices()[0].T
        )
        self.one.x, self.one.P = mean, cov
        self.one.R = self.noises[1]

    def step(self, z, dt):
        self.one.Q = self.noises[0]
        self.one.predict(dt)
        self.one.update(z)
        return self.one.x.copy(), self.one.P.copy()


class SquareRoot(Cubature, kind="TurboSRCKF"):
    cls = TurboSRCKF
