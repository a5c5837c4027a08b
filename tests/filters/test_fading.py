"""Fading memory: exponential weights of old measurements, in closed form."""

from typing import Any

import numpy as np
import pytest

from tests.conftest import make_filter
from trackbench.core.distributions import Gaussian
from trackbench.filters.gaussian_base import Tracked
from trackbench.models.base import Model
from trackbench.models.motions.autoregressive import Autoregressive
from trackbench.models.motions.kinematic import ConstantVelocity
from trackbench.models.sensors.function import FunctionSensor
from trackbench.models.sensors.position import PositionSensor

A, R, M0, P0 = 1.1, 2.0, 0.5, 3.0
Z = np.array([1.0, -0.3, 2.2, 0.7, 1.9])
STILL = Model(
    Autoregressive(phi=1.0, q=0.0).sampled(1.0),
    FunctionSensor(h={"z": "x"}, R=R, state=("x",)),
)
KINDS: list[tuple[str, dict[str, Any]]] = [("kf", {}), ("ekf", {}), ("ukf", {}), ("ckf", {})]
KINDS += [("ukf", {"noise": "additive"}), ("iplf", {})]


def states(tracker: Any) -> list[Tracked]:
    """States of the filter of a constant, that before the first measurement included."""
    prior = Gaussian(np.array([[M0]]), np.array([[P0]]))
    out = [tracker.init(STILL, prior, np.random.default_rng(1))]
    for k, z in enumerate(Z, 1):
        out.append(tracker.step(STILL, out[-1], np.array([[z]]), k, np.random.default_rng(1)))
    return out


@pytest.mark.parametrize(("kind", "keys"), KINDS)
def test_old_measurements_lose_weight(kind: str, keys: dict[str, Any]) -> None:
    """A constant: information is the sum of ``a^(-2 age) / R``, the mean is so weighted."""
    steps = states(make_filter(kind, fading=A, **keys))
    for k, state in enumerate(steps):
        weights = A ** (-2.0 * np.arange(k, -1, -1)) / np.array([P0, *[R] * k])
        values = np.array([M0, *Z[:k]])
        got = state.posterior
        np.testing.assert_allclose(np.ravel(got.cov), 1.0 / weights.sum(), rtol=1e-12)
        np.testing.assert_allclose(np.ravel(got.mean), weights @ values / weights.sum(), rtol=1e-11)


@pytest.mark.parametrize(("kind", "keys"), KINDS)
def test_the_smoother_is_that_of_the_noise_between_two_steps(
    kind: str, keys: dict[str, Any]
) -> None:
    """``x_k+1 = x_k + e_k`` with variance (a^2 - 1) P_k: condition the joint Gaussian of all x."""
    tracker = make_filter(kind, fading=A, smooth=True, **keys)
    steps = states(tracker)
    noise = [(A * A - 1.0) * float(np.ravel(s.posterior.cov)[0]) for s in steps[:-1]]
    variances = np.cumsum([P0, *noise])
    prior = np.minimum.outer(variances, variances)  # cov(x_i, x_j) of a random walk
    gain = np.linalg.solve(prior[1:, 1:] + R * np.eye(len(Z)), prior[1:]).T
    mean = M0 + gain @ (Z - M0)
    cov = prior - gain @ prior[1:]
    smoothed = [s.posterior for s in tracker.smoothed(STILL, steps, 0, np.random.default_rng(0))]
    np.testing.assert_allclose([s.mean.item() for s in smoothed], mean, rtol=1e-9)
    np.testing.assert_allclose([s.cov.item() for s in smoothed], np.diag(cov), rtol=1e-9)


def test_an_imm_fades_its_filters_forwards_and_backwards() -> None:
    """One motion twice is that motion."""
    cv = ConstantVelocity(q=0.5)
    model = Model(cv.sampled(1.0), PositionSensor(sigma=2.0))
    prior = Gaussian(np.ones((4, 3)), 9.0 * np.eye(4))
    rng = np.random.default_rng(1)
    trackers = (
        make_filter("ekf", fading=A, smooth=True),
        make_filter(
            "imm",
            smooth=True,
            filter=make_filter("ekf", fading=A),
            motions=(cv, cv),
            transition=((0.9, 0.1), (0.1, 0.9)),
        ),
    )
    estimates = []
    for tracker in trackers:
        steps = [tracker.init(model, prior, rng)]
        for k in range(1, 5):
            steps.append(tracker.step(model, steps[-1], np.full((2, 3), 1.5 * k), k, rng))
        smoothed = tracker.smoothed(model, steps, 0, rng)
        estimates.append([tracker.estimate(state) for state in (steps[-1], *smoothed)])
    for one, imm in zip(*estimates, strict=True):
        np.testing.assert_allclose(imm.mean, one.mean, rtol=1e-9)
        covs = [np.broadcast_to(np.reshape(e.cov, (4, 4, -1)), (4, 4, 3)) for e in (one, imm)]
        np.testing.assert_allclose(covs[1], covs[0], rtol=1e-9, atol=1e-11)
