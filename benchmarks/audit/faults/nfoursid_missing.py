"""nfoursid 1.0.2: a missing output shrinks the covariance as a measured one does."""

import sys

import numpy as np
from nfoursid.kalman import Kalman
from nfoursid.state_space import StateSpace

one = np.eye(1)
kf = Kalman(StateSpace(one, one, one, 0 * one), np.eye(2))  # the first variance is 1
kf.step(None, np.zeros((1, 1)))
if not np.isclose(kf.p_filtereds[0].item(), 1.0):
    sys.exit(f"variance {kf.p_filtereds[0].item():.2f} after no output, 1.00 before")
