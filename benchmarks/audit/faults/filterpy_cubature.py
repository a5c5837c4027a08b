"""filterpy 2.0.0, 1.4.5, bayesian-filters 1.4.5: the cubature filter's gain leaves out Q."""

import sys

import numpy as np

if "bayesian_filters" in sys.argv:
    from bayesian_filters.kalman import CubatureKalmanFilter
else:
    from filterpy.kalman import CubatureKalmanFilter

ckf = CubatureKalmanFilter(1, 1, 1.0, hx=lambda x: x, fx=lambda x, dt: x)
ckf.P, ckf.Q, ckf.R = np.eye(1), np.eye(1), np.eye(1)
ckf.predict()
ckf.update(np.array([[0.0]]))
# P = 1 + 1 = 2, and P R / (P + R) = 2 / 3
if not np.isclose(ckf.P.item(), 2 / 3):
    sys.exit(f"variance {ckf.P.item():.4f} on a linear model, the Kalman filter's is {2 / 3:.4f}")
