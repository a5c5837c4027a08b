"""filterpy 2.0.0, 1.4.5: the cubature filter with z of the documented shape (dim_z)."""

import sys

import numpy as np
from filterpy.kalman import CubatureKalmanFilter

ckf = CubatureKalmanFilter(2, 2, 1.0, hx=lambda x: x, fx=lambda x, dt: x)
ckf.predict()
ckf.update(np.array([1.0, 2.0]))
if ckf.x.size != 2:
    sys.exit(f"the state has shape {ckf.x.shape} after an update with z of shape (2,)")
