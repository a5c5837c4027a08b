"""kalbee 1.0.0: UKF and CKF have no option for angles, so one beyond pi moves the state."""

import sys

import numpy as np
from kalbee import CubatureKalmanFilter, UnscentedKalmanFilter

one, off = 0.01 * np.eye(1), {}
for cls in (UnscentedKalmanFilter, CubatureKalmanFilter):
    # A heading of 3.1, measured as -3.1: 0.08 away.
    ukf = cls(np.array([[3.1]]), one, one, one, lambda x, dt: x, lambda x: x)
    ukf.predict()
    ukf.update(np.array([[-3.1]]))
    off[cls.__name__] = round(abs(np.angle(np.exp(1j * (ukf.x.item() - np.pi)))), 2)
if max(off.values()) > 0.1:
    sys.exit(f"a heading between 3.1 and -3.1 is off by {off} rad")
