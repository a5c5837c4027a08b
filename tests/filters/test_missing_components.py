"""A measurement with a missing component updates with the others: as a sensor without it would."""

from typing import Any

import numpy as np
import pytest

from trackbench.core.distributions import Gaussian
from trackbench.filters.ekf import EKF, IEKF
from trackbench.filters.gauss_hermite_filter import GHKF
from trackbench.filters.kf import KF
from trackbench.filters.ukf import CKF, UKF
from trackbench.models.base import Model
from trackbench.models.motions.kinematic import WhiteAcceleration
from trackbench.models.sensors.bearing import Bearing
from trackbench.models.sensors.position import PositionSensor
from trackbench.models.sensors.stacked import StackedSensor

MOTION = WhiteAcceleration(q=1.0).sampled(1.0)
POSITION, BEARING = PositionSensor(sigma=20.0), Bearing(sigma_mrad=5.0)
FILTERS = [EKF(), IEKF(), UKF(), UKF(noise="additive"), CKF(), GHKF()]


def prior(runs: int) -> Gaussian:
    mean = np.array([[3000.0], [10.0], [2000.0], [-5.0]]) * np.ones((4, runs))
    return Gaussian(mean, np.diag([400.0, 9.0, 400.0, 9.0])[..., None] * np.ones(runs))


@pytest.mark.parametrize("tracker", FILTERS, ids=lambda f: f"{f.kind}")
def test_nonlinear(tracker: Any) -> None:
    state = prior(3)
    both = Model(MOTION, StackedSensor((POSITION, BEARING)))
    z = np.array([[3020.0], [1990.0], [0.59]]) * np.ones((3, 3))
    z[2, 0], z[:2, 1], z[:, 2] = np.nan, np.nan, np.nan
    found, seen = tracker.update(both, state, z, 1)
    position, alone = tracker.update(Model(MOTION, POSITION), state, z[:2], 1)
    bearing, single = tracker.update(Model(MOTION, BEARING), state, z[2:], 1)
    rtol = 1e-9 if tracker != UKF() else 1e-3  # its points spread with the noise of all components
    for run, expected in ((0, position), (1, bearing), (2, position)):
        np.testing.assert_allclose(found.mean[:, run], expected.mean[:, run], rtol=rtol)
        np.testing.assert_allclose(
            found.cov[..., run], expected.cov[..., run], rtol=rtol, atol=1e-6
        )
    assert seen.nis[0] == pytest.approx(alone.nis[0], rel=rtol)
    assert seen.nis[1] == pytest.approx(single.nis[1], rel=rtol)
    assert np.isnan(seen.nis[2])
    assert seen.log_likelihood[0] == pytest.approx(alone.log_likelihood[0], rel=rtol)
    assert seen.log_likelihood[1] == pytest.approx(single.log_likelihood[1], rel=rtol)


def test_linear_with_one_covariance_for_all_runs() -> None:
    """Alike in all runs, as of a sensor that measures at every other step: the covariance stays one."""
    state = Gaussian(prior(3).mean, prior(3).cov[..., 0])
    z = np.array([[3020.0], [np.nan]]) * np.ones((2, 3))
    found, seen = KF().update(Model(MOTION, POSITION), state, z, 1)
    assert found.cov.ndim == 2
    P = MOTION.F @ state.cov @ MOTION.F.T + MOTION.Q
    x = MOTION.F @ state.mean
    S = P[0, 0] + 400.0
    np.testing.assert_allclose(found.mean, x + P[:, :1] / S * (3020.0 - x[0]), rtol=1e-12)
    np.testing.assert_allclose(found.cov, P - np.outer(P[0], P[0]) / S, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(seen.nis, (3020.0 - x[0]) ** 2 / S, rtol=1e-12)
