"""Filters on a wide prior and accurate sensors against the Kalman filter's Joseph form."""

from typing import Any

import numpy as np
import pytest

from tests.conftest import make_filter
from trackbench.core.distributions import Gaussian
from trackbench.models.base import Model
from trackbench.models.motions.linear import Linear
from trackbench.models.sensors.function import FunctionSensor


@pytest.mark.parametrize(("kind", "keys"), [
    ("ukf", {}), ("ukf", {"noise": "additive"}), ("ckf", {}), ("ckf", {"form": "square-root"}),
    ("ghkf", {"order": 3}), ("iplf", {}), ("ekf", {}),
])  # fmt: skip
@pytest.mark.parametrize("planar", [True, False])
def test_a_wide_prior_and_an_accurate_sensor_leave_the_kalman_filter(
    kind: str, keys: dict[str, Any], planar: bool
) -> None:
    """The posterior variance is 1e-21 of the prior's; the difference of both has no digits left."""
    names = ("px", "vx", "py", "vy") if planar else ("x",)
    F = np.eye(len(names)) + (np.diag([0.1, 0.0, 0.1], 1) if planar else 0.0)
    model = Model(
        Linear(0.1, F, 1e-4 * np.eye(len(names)), names),
        FunctionSensor(h={name: name for name in names[::2]}, R=1e-6, state=names),
    )
    sigma = np.array([3e7, 10.0, 3e7, 10.0][: len(names)])
    prior, rng = Gaussian(np.zeros((len(names), 2)), np.diag(sigma**2)), np.random.default_rng(3)
    states: dict[str, Any] = {}
    filters: dict[str, Any] = {"kf": make_filter("kf"), kind: make_filter(kind, **keys)}
    for name, tracker in filters.items():
        states[name] = tracker.init(model, prior, rng)
    for k in range(1, 5):
        z = 5000.0 + rng.standard_normal((len(names[::2]), 2))
        for name, tracker in filters.items():
            states[name] = tracker.step(model, states[name], z, k, rng)
        exact, got = (filters[name].estimate(states[name]) for name in ("kf", kind))
        P = np.broadcast_to(exact.cov.reshape(len(names), len(names), -1), got.cov.shape)
        np.testing.assert_allclose(got.cov, P, rtol=1e-4, atol=1e-6 * np.abs(P).max())
        np.testing.assert_allclose(np.diagonal(got.cov), np.diagonal(P), rtol=1e-4)
        np.testing.assert_allclose(got.mean, exact.mean, rtol=1e-6, atol=1e-9)
