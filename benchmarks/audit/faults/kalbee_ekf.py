"""kalbee 1.0.0: ExtendedKalmanFilter.predict takes the Jacobian of f at the predicted state."""

import sys

import numpy as np
from kalbee import ExtendedKalmanFilter

one = np.eye(1)
ekf = ExtendedKalmanFilter(
    state=2.0 * one,
    covariance=one,
    transition_covariance=0.0 * one,
    measurement_covariance=one,
    transition_function=lambda x, dt: x**2,
    measurement_function=lambda x: x,
    transition_jacobian=lambda x, dt: 2.0 * x,
    measurement_jacobian=lambda x: one,
)
ekf.predict()
# f(x) = x^2 at x = 2 has the derivative 4, so P = 4 * 1 * 4 = 16.
if not np.isclose(ekf.P.item(), 16.0):
    sys.exit(f"predicted variance {ekf.P.item():.1f}, with the Jacobian at the state before 16.0")
