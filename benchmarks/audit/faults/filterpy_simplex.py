"""filterpy 1.4.5: simplex sigma points have another covariance than the one given."""

import sys

import numpy as np
from filterpy.kalman import SimplexSigmaPoints

P = np.array([[4.0, 1.0], [1.0, 1.0]])
simplex = SimplexSigmaPoints(2)
points = simplex.sigma_points(np.zeros(2), P)
cov = (simplex.Wc[:, None] * points).T @ points
if not np.allclose(cov, P):
    sys.exit(f"the points of P = {P.tolist()} have the covariance {cov.round(3).tolist()}")
