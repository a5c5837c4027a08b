"""turbo-ckf: cubature filters of Rust."""

import numpy as np
from turbo_ckf import TurboCKF, TurboSRCKF

from benchmarks.audit.linear import Functions
from benchmarks.audit.nonlinear import CUBATURE


class Cubature(Functions, kind="TurboCKF"):
    cls, rule = TurboCKF, CUBATURE

    def start(self, mean, cov):
        self.refuse_angles()
        self.one = self.cls(4, 2, self.dt, self.h_rows, self.f_rows)
        self.one.x, self.one.P = mean, cov
        self.one.R = self.noises[1]

    def h_rows(self, points):
        return np.array([self.h(x) for x in points])

    def f_rows(self, points, dt):
        return np.array([self.f(x) for x in points])

    def step(self, z, dt):
        self.one.Q = self.noises[0]
        self.one.predict(dt)
        self.one.update(z)
        return self.one.x.copy(), self.one.P.copy()


class SquareRoot(Cubature, kind="TurboSRCKF"):
    cls = TurboSRCKF
