"""filterpy 1.4.5: the unscented filter's gain leaves out Q."""

import sys

import numpy as np
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

points = MerweScaledSigmaPoints(1, alpha=1.0, beta=2.0, kappa=2.0)
ukf = UnscentedKalmanFilter(1, 1, 1.0, hx=lambda x: x, fx=lambda x, dt: x, points=points)
ukf.P, ukf.Q, ukf.R = np.eye(1), np.eye(1), np.eye(1)
ukf.predict()
ukf.update(np.array([0.0]))
# P = 1 + 1 = 2, and P R / (P + R) = 2 / 3
if not np.isclose(ukf.P.item(), 2 / 3):
    sys.exit(f"variance {ukf.P.item():.4f} on a linear model, the Kalman filter's is {2 / 3:.4f}")
