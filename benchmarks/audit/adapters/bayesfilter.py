"""bayesfilter: unscented and extended filters of functions."""

import numpy as np
from bayesfilter.distributions import Gaussian
from bayesfilter.filtering import BayesianFilter
from bayesfilter.model import StateTransitionModel
from bayesfilter.observation import Observation

from benchmarks.audit.linear import Functions
from benchmarks.audit.nonlinear import EXTENDED, SigmaPoints


class Unscented(Functions, kind="BayesianFilter, unscented"):
    jacobian = False
    rule = SigmaPoints(alpha=1e-3, beta=2.0, kappa=-1.0)
    shown_by = "bayesfilter_unscented"

    def start(self, mean, cov):
        self.refuse_angles()
        self.now = Gaussian(mean, cov)

    def step(self, z, dt):
        Q, R = self.noises
        motion = StateTransitionModel(lambda x, dt: self.f(x), Q, lambda x, dt: self.F(x))
        one = BayesianFilter(motion, self.now)
        self.now = one.predict(self.now, dt, use_jacobian=self.jacobian)
        if z is not None:
            measured = Observation(z, R, self.h, self.H)
            self.now = one.update(measured, self.now, use_jacobian=self.jacobian)
        return np.ravel(self.now.mean()), self.now.covariance()


class Extended(Unscented, kind="BayesianFilter, extended"):
    jacobian = True
    rule = EXTENDED
    shown_by = "?"
