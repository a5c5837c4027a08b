"""White acceleration at unequal steps: a filter's smoother, and all states at once by least squares."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from trackbench.core.distributions import Gaussian
from trackbench.models.base import Model
from trackbench.models.motions.irregular import Irregular
from trackbench.models.motions.kinematic import WhiteAcceleration
from trackbench.models.sensors.position import PositionSensor

FIRST, INTERVALS = 4, np.array([0.3, 2.0, 0.7, 5.0, 0.1, 1.4])
SIGMA, START, RUNS = 2.0, np.diag([9.0, 4.0, 16.0, 1.0]), 3
Z = 5.0 * np.random.default_rng(22).standard_normal((2, len(INTERVALS), RUNS))
Z[:, 2, 1], Z[0, 4, 2] = np.nan, np.nan


@np.errstate(all="ignore")
def smoothed_moments(tracker: Any, q: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Means (4, T + 1, M), covariances (4, 4, T + 1, M) of a filter; the first measured step is 4."""
    rng = np.random.default_rng(1)
    motion = Irregular(WhiteAcceleration(q=q), 2, FIRST, INTERVALS)
    model = Model(motion, PositionSensor(sigma=SIGMA))
    states = [tracker.init(model, Gaussian(np.ones((4, RUNS)), START), rng)]
    for i in range(len(INTERVALS)):
        states.append(tracker.step(model, states[-1], Z[:, i], FIRST + i, rng))
    found = [tracker.estimate(s) for s in tracker.smoothed(model, states, FIRST - 1, rng)]
    covs = [np.broadcast_to(x.cov.reshape(4, 4, -1), (4, 4, RUNS)) for x in found]
    return np.stack([x.mean for x in found], 1), np.stack(covs, 2)


def least_squares(noise: Sequence[float], lag: int | None = None) -> tuple[np.ndarray, np.ndarray]:
    """The same of all states given the measurements, with the spectral density of each interval."""
    T = len(INTERVALS)
    means, covs = np.empty((4, T + 1, RUNS)), np.empty((4, 4, T + 1, RUNS))
    # Prior and motions: x_0 = 1, x_{k+1} - F x_k = 0, each with its inverse covariance.
    J, y = np.zeros((4 * T + 4,) * 2), np.zeros(4 * T + 4)
    J[:4, :4], y[:4] = np.linalg.inv(START), np.diag(np.linalg.inv(START))
    for i, (t, q) in enumerate(zip(INTERVALS, noise, strict=True)):
        A = np.hstack([-np.kron(np.eye(2), [[1.0, t], [0.0, 1.0]]), np.eye(4)])
        Q = np.kron(np.eye(2), q * np.array([[t**3 / 3, t**2 / 2], [t**2 / 2, t]]))
        J[4 * i : 4 * i + 8, 4 * i : 4 * i + 8] += A.T @ np.linalg.solve(Q, A)
    for run in range(RUNS):
        for k in range(T + 1):
            last = T if lag is None else min(k + lag, T)
            with_z, of_z = J.copy(), y.copy()
            for i, axis in zip(*np.nonzero(np.isfinite(Z[:, :last, run].T)), strict=True):
                at = 4 * (i + 1) + 2 * axis
                with_z[at, at] += SIGMA**-2
                of_z[at] += Z[axis, i, run] / SIGMA**2
            cov, own = np.linalg.inv(with_z), slice(4 * k, 4 * k + 4)
            means[:, k, run], covs[..., k, run] = (cov @ of_z)[own], cov[own, own]
    return means, covs
