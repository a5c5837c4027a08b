"""kalmanbox: linear, square-root, information, extended and unscented filters."""

import numpy as np
from kalmanbox.core.representation import StateSpaceRepresentation
from kalmanbox.filters.ekf import ExtendedKalmanFilter
from kalmanbox.filters.information import InformationFilter
from kalmanbox.filters.kalman import KalmanFilter
from kalmanbox.filters.square_root import SquareRootKalmanFilter
from kalmanbox.filters.ukf import UnscentedKalmanFilter

from benchmarks.audit.linear import Batch, Functions
from benchmarks.audit.nonlinear import EXTENDED, SigmaPoints
from trackbench.models.motions.unequal_intervals import Irregular


class InOneCall(Batch):
    def filtered(self, z, H, R):
        model = StateSpaceRepresentation(4, 2)
        model.T, model.Q = self.constant()
        model.Z, model.H, model.R = H, R, np.eye(4)
        model.a1, model.P1 = self.first
        out = self.cls().filter(z, model)
        return out.filtered_state[-1], out.filtered_cov[-1]


class Kalman(InOneCall, kind="KalmanFilter"):
    cls = KalmanFilter


class SquareRoot(InOneCall, kind="SquareRootKalmanFilter"):
    cls = SquareRootKalmanFilter


class Information(InOneCall, kind="InformationFilter"):
    cls = InformationFilter


class Model:
    """Model of the package's nonlinear filters; row 0 of the data is the prior's and is missing."""

    k_states, k_endog, R = 4, 2, np.eye(4)

    def __init__(self, one, mean, cov):
        self.one, self.a1, self.P1 = one, mean, cov
        self.Q, self.H = one.noises

    def transition(self, x, t):
        return self.one.f(x)

    def transition_jacobian(self, x, t):
        return self.one.F(x)

    def observation(self, x, t):
        return self.one.h(x)

    def observation_jacobian(self, x, t):
        return self.one.H(x)


class Nonlinear(Functions):
    """A filter of all measurements so far, which takes one Q for all steps."""

    def start(self, mean, cov):
        self.refuse_angles()
        if isinstance(self.model.motion, Irregular):
            raise ValueError("the package takes one Q for all steps")
        self.rows, self.of = [np.full(2, np.nan)], Model(self, mean, cov)

    def step(self, z, dt):
        self.rows.append(np.full(2, np.nan) if z is None else z)
        out = self.cls().filter(np.array(self.rows), self.of)
        return out.filtered_state[-1], out.filtered_cov[-1]


class Extended(Nonlinear, kind="ExtendedKalmanFilter"):
    cls, rule = ExtendedKalmanFilter, EXTENDED


class Unscented(Nonlinear, kind="UnscentedKalmanFilter"):
    cls, rule = UnscentedKalmanFilter, SigmaPoints(alpha=1e-3, beta=2.0)
