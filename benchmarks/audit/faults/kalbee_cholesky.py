"""kalbee 1.0.0: `covariance` of two square-root filters stays that of the beginning."""

import sys

import numpy as np
from kalbee import CholeskyKalmanFilter
from kalbee.modules.filters.sr_ukf import SquareRootUKF

one, stale = np.eye(1), []
root = SquareRootUKF(np.zeros((1, 1)), one, one, one, lambda x, dt: x, lambda x: x)
for kf in (CholeskyKalmanFilter(np.zeros((1, 1)), one, one, one, one, one), root):
    kf.predict()
    kf.update(np.array([[0.0]]))
    if not np.allclose(kf.covariance, kf.P):
        numbers = f"covariance {kf.covariance.item():.4f}, P {kf.P.item():.4f}"
        stale.append(f"{type(kf).__name__}: {numbers}")
if stale:
    sys.exit(f"after an update, {'; '.join(stale)}")
