"""filterpy 1.4.5: the extended filter's Mahalanobis distance is always zero."""

import sys

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter

ekf = ExtendedKalmanFilter(dim_x=1, dim_z=1)
ekf.predict()
ekf.update(np.array([[10.0]]), HJacobian=lambda x: np.eye(1), Hx=lambda x: x)
# The attribute `mahalanobis` is the root of y' SI y.
squared, expected = (
    (ekf.y.T @ ekf.SI @ ekf.y).item(),
    (ekf.y.T @ np.linalg.inv(ekf.S) @ ekf.y).item(),
)
if not np.isclose(squared, expected):
    sys.exit(
        f"y' SI y is {squared:.2f} with the attribute SI, {expected:.2f} with the inverse of S"
    )
