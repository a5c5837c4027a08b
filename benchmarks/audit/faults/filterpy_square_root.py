"""filterpy 1.4.5: the square-root filter has a wrong `P`, and fails where dim_z > 1."""

import sys

import numpy as np
from filterpy.kalman import KalmanFilter, SquareRootKalmanFilter

P = {}
for cls in (KalmanFilter, SquareRootKalmanFilter):
    one = cls(dim_x=2, dim_z=1)
    one.F, one.H = np.array([[1.0, 1.0], [0.0, 1.0]]), np.array([[1.0, 0.0]])
    one.P = one.Q = np.array([[2.0, 1.0], [1.0, 1.0]])
    one.predict()
    P[cls] = one.P
if not np.allclose(P[KalmanFilter], P[SquareRootKalmanFilter]):
    sys.exit(
        f"predicted P {P[SquareRootKalmanFilter].round(2).tolist()}, KalmanFilter's "
        f"{P[KalmanFilter].round(2).tolist()}"
    )
