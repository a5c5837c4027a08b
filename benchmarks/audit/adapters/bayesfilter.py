"""bayesfilter: unscented and extended filters of functions."""

import numpy as np
from bayesfilter.distributions import Gaussian
from bayesfilter.filtering import BayesianFilter
from bayesfilter.model import StateTransitionModel
from bayesfilter.observation import Observation

from benchmarks.audit.linear import Functions


class Unscented(Functions, kind="BayesianFilter, unscented"):
    jacobian = False

    def start(self, mean, cov):
        self.sensor_matrices()  # it has no option for angles
        self.now = Gaussian(mean, cov)

    def step(self, z, dt):
        Q, R = self.noises
        motion = StateTransitionModel(
            lambda x, dt: self.f(x), Q, lambda x, dt: self.motion_matrices()[0]
        )
        one = BayesianFilter(motion, self.now)
        self.now = one.predict(self.now, dt, use_jacobian=self.jacobian)
        if z is not None:
            measured = Observation(z, R, self.h, self.H)
            self.now = one.update(measured, self.now, use_jacobian=self.jacobian)
        return np.ravel(self.now.mean()), self.now.covariance()


class Extended(Unscented, kind="BayesianFilter, extended"):
    jacobian = True
