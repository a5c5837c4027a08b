"""filterpy 1.4.5: the square-root filter's `P` and `S` are not those of the Kalman filter."""

import sys

import numpy as np
from filterpy.kalman import KalmanFilter, SquareRootKalmanFilter

P, S = [], []
for cls in (KalmanFilter, SquareRootKalmanFilter):
    one = cls(dim_x=2, dim_z=1)
    one.F, one.H = np.array([[1.0, 1.0], [0.0, 1.0]]), np.array([[1.0, 0.0]])
    one.P = one.Q = np.array([[2.0, 1.0], [1.0, 1.0]])
    one.predict()
    P.append(one.P.round(2).tolist())
    one.update(np.array([[1.0]]))
    S.append(np.shape(one.S))
if P[0] != P[1] or S[0] != S[1]:
    sys.exit(f"predicted P {P[1]}, KalmanFilter's {P[0]}; S of shape {S[1]}, KalmanFilter's {S[0]}")
