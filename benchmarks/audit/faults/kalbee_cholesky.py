"""kalbee 1.0.0: `covariance` of the Cholesky filter stays that of the beginning."""

import sys

import numpy as np
from kalbee import CholeskyKalmanFilter

one = np.eye(1)
kf = CholeskyKalmanFilter(np.zeros((1, 1)), one, one, one, one, one)
kf.predict()
kf.update(np.array([[0.0]]))
if not np.allclose(kf.covariance, kf.P):
    sys.exit(f"covariance {kf.covariance.item():.4f}, P {kf.P.item():.4f} after an update")
