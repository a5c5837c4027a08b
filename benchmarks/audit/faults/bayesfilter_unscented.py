"""bayesfilter 0.2.0: the unscented update takes the residual z - h(mean), not z - the mean of h."""

import sys

import numpy as np
from bayesfilter.distributions import Gaussian
from bayesfilter.filtering import BayesianFilter
from bayesfilter.model import StateTransitionModel
from bayesfilter.observation import Observation

one = np.eye(1)
prior = Gaussian(np.array([1.0]), one)
ukf = BayesianFilter(StateTransitionModel(lambda x, dt: x, 0.0 * one), prior)
measured = Observation(np.array([2.0]), one, lambda x: x**2)
posterior = ukf.update(measured, prior, use_jacobian=False)
# x ~ N(1, 1) and z = x^2 + v have E z = 1 + 1 = 2, so z = 2 does not move the mean.
if not np.isclose(posterior.mean().item(), 1.0, atol=1e-6):
    sys.exit(f"mean {posterior.mean().item():.4f} after the expected measurement, should be 1.0000")
