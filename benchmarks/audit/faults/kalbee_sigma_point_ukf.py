"""kalbee 1.0.0: the gain of SigmaPointUKF leaves out Q; UnscentedKalmanFilter's does not."""

import sys

import numpy as np
from kalbee import SigmaPointUKF

one = np.eye(1)
ukf = SigmaPointUKF(np.zeros((1, 1)), one, one, one, lambda x, dt: x, lambda x: x)
ukf.predict()
ukf.update(np.array([[0.0]]))
# P = 1 + 1 = 2, and P R / (P + R) = 2 / 3
if not np.isclose(ukf.P.item(), 2 / 3):
    sys.exit(f"variance {ukf.P.item():.4f} on a linear model, the Kalman filter's is {2 / 3:.4f}")
