"""pykalman 0.9.7, 0.10.1: `filter` uses the first of a stack of covariances at every step."""

import sys

import numpy as np
from pykalman import KalmanFilter

R = np.array([[[1.0]], [[1e6]]])  # the second measurement is worth nothing
kf = KalmanFilter([[1.0]], [[1.0]], [[0.0]], R, initial_state_mean=[0.0])
_, cov = kf.filter([[0.0], [0.0]])
expected = 1 / (1 / 1 + 1 / 1 + 1 / 1e6)  # prior variance 1
if not np.isclose(cov[1, 0, 0], expected):
    sys.exit(f"variance {cov[1, 0, 0]:.4f} after R = 1 and 1e6, expected {expected:.4f}")
