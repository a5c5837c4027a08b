"""kalmanbox: linear, square-root, information, extended and unscented filters."""

import numpy as np
from kalmanbox.core.representation import StateSpaceRepresentation
from kalmanbox.filters.ekf import ExtendedKalmanFilter, LinearEKFModel
from kalmanbox.filters.information import InformationFilter
from kalmanbox.filters.kalman import KalmanFilter
from kalmanbox.filters.square_root import SquareRootKalmanFilter
from kalmanbox.filters.ukf import LinearUKFModel, UnscentedKalmanFilter

from benchmarks.audit.linear import Batch


class InOneCall(Batch):
    wrap = staticmethod(lambda model: model)

    def filtered(self, z, H, R):
        model = StateSpaceRepresentation(4, 2)
        model.T, model.Q = self.constant()
        model.Z, model.H, model.R = H, R, np.eye(4)
        model.a1, model.P1 = self.first
        out = self.cls().filter(z, self.wrap(model))
        return out.filtered_state[-1], out.filtered_cov[-1]


class Kalman(InOneCall, kind="KalmanFilter"):
    cls = KalmanFilter


class SquareRoot(InOneCall, kind="SquareRootKalmanFilter"):
    cls = SquareRootKalmanFilter


class Information(InOneCall, kind="InformationFilter"):
    cls = InformationFilter


class Extended(InOneCall, kind="ExtendedKalmanFilter"):
    cls, wrap = ExtendedKalmanFilter, staticmethod(LinearEKFModel)


class Unscented(InOneCall, kind="UnscentedKalmanFilter"):
    cls, wrap = UnscentedKalmanFilter, staticmethod(LinearUKFModel)
