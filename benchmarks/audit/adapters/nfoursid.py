"""nfoursid: the Kalman filter of an identified state space."""

import numpy as np
from nfoursid.kalman import Kalman
from nfoursid.state_space import StateSpace

from benchmarks.audit.linear import Batch


class OfNfoursid(Batch, kind="Kalman.step"):
    """Its first prediction is zero with covariance 1, so the prior is put in its lists."""

    shown_by = "nfoursid_missing"

    def filtered(self, z, H, R):
        F, Q = self.constant()
        no_input = np.zeros((4, 1)), np.zeros((2, 1))
        one = Kalman(
            StateSpace(F, no_input[0], H, no_input[1]),
            np.block([[R, np.zeros((2, 4))], [np.zeros((4, 2)), Q]]),
        )
        one.x_predicteds, one.p_predicteds = [self.first[0][:, None]], [self.first[1]]
        for row in z:
            one.step(None if np.isnan(row).any() else row[:, None], np.zeros((1, 1)))
        return one.x_filtereds[-1][:, 0], one.p_filtereds[-1]
