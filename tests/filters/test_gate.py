"""A gate refuses outliers, counts them, and leaves a clean problem alone."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.conftest import track
from trackbench.core.distributions import Gaussian
from trackbench.evaluation.block import simulate
from trackbench.filters.ekf import EKF
from trackbench.filters.imm import IMM, ModelBank
from trackbench.filters.kf import KF, Tracked
from trackbench.filters.ukf import CKF
from trackbench.models.base import Model
from trackbench.models.motions.kinematic import WhiteAcceleration
from trackbench.models.sensors.base import Outliers
from trackbench.models.sensors.position import PositionSensor
from trackbench.scenarios.starts.without_scans import GaussianStart
from trackbench.scenarios.targets.driven import Driven
from trackbench.scenarios.tracking import Tracking

RUNS = 200
CLEAN = Tracking(
    target=Driven(motion=WhiteAcceleration(q=1.0)),
    sensor=PositionSensor(sigma=5.0),
    start=GaussianStart(sigma=(5.0, 2.0, 5.0, 2.0)),
    last=40,
)
SPOILT = replace(CLEAN, sensor=replace(CLEAN.sensor, outliers=Outliers(share=0.05, times=30.0)))


def rms(scenario: Any, tracker: Any) -> float:
    found = track(scenario, tracker, RUNS)
    error = found.mean - simulate(scenario, 1, 0, RUNS).truth
    return float(np.sqrt(np.square(error[[0, 2]]).sum(axis=0).mean()))


@pytest.mark.parametrize("kind", [KF, EKF, CKF])
def test_outliers_are_refused(kind: Any) -> None:
    gated = kind(gate=0.999)
    assert rms(SPOILT, gated) < 0.35 * rms(SPOILT, kind())
    share = np.nanmean(track(SPOILT, gated, RUNS).diagnostics["gated"])
    assert share == pytest.approx(0.05, abs=0.01)


STAY = np.array([[0.9, 0.1], [0.3, 0.7]])
NOISE = (0.5, 400.0)
CHI2_99 = (np.inf, 6.634897, 9.210340)
"""0.99 quantiles of the chi-square laws of 0, 1 and 2 degrees of freedom, from printed tables."""


def by_hand(
    means: Any, covs: Any, w: Any, noise: Any, P: Any, z: Any, fading: float
) -> tuple[Any, ...]:
    """Mean, covariance, weights, NIS of one run after one second, and the models that refuse z."""
    H, measured = np.eye(4)[[0, 2]][np.isfinite(z)], z[np.isfinite(z)]
    predicted, updated, nis, like, c = [], [], [], [], P.T @ w
    for j, q in enumerate(noise):
        mu = P[:, j] * w / c[j]
        m = mu @ means
        V = sum(a * (C + np.outer(x - m, x - m)) for a, x, C in zip(mu, means, covs, strict=True))
        F = np.kron(np.eye(2), [[1.0, 1.0], [0.0, 1.0]])
        Q = np.kron(np.eye(2), q * np.array([[1 / 3, 1 / 2], [1 / 2, 1.0]]))
        m, V = F @ m, fading**2 * F @ V @ F.T + Q
        S, nu = H @ V @ H.T + 25.0 * np.eye(len(H)), measured - H @ m
        K = V @ H.T @ np.linalg.inv(S)
        predicted.append((m, V))
        updated.append((m + K @ nu, V - K @ S @ K.T))
        nis.append(nu @ np.linalg.solve(S, nu))
        like.append(np.exp(-0.5 * nis[-1]) / np.sqrt(np.linalg.det(S)))
    refused = np.array(nis) > CHI2_99[len(H)]
    alone = refused.all() or not len(H)  # no model is updated
    states, w = (predicted, c) if alone else (updated, c * like / (c @ like))
    m = sum(a * x for a, (x, _) in zip(w, states, strict=True))
    V = sum(a * (C + np.outer(x - m, x - m)) for a, (x, C) in zip(w, states, strict=True))
    return m, V, w, np.nan if alone else c @ nis, refused


@pytest.mark.parametrize("fading", [1.0, 1.5])
@pytest.mark.parametrize("models", [1, 2])
def test_the_limit_is_that_of_the_measured_components_and_of_all_models(
    models: int, fading: float, rng: np.random.Generator
) -> None:
    """Measurements with and without gaps about both limits, run by run in plain matrices."""
    noise, P = NOISE[:models], STAY[:models, :models] / STAY[:models, :models].sum(axis=1)
    z = 25.0 * rng.standard_normal((2, 300))
    z[rng.random(z.shape) < 0.25] = np.nan
    means = 3.0 * rng.standard_normal((models, 4, 300))
    covs = np.stack([np.diag([30.0, 9.0, 20.0, 4.0]) * (j + 1) for j in range(models)])
    states = tuple(
        Gaussian(m, C[..., None] * np.ones(300)) for m, C in zip(means, covs, strict=True)
    )
    model = Model(WhiteAcceleration(q=noise[0]).sampled(1.0), PositionSensor(sigma=5.0))
    if models == 1:
        tracker: Any = KF(gate=0.99, fading=fading)
        bank: Any = Tracked(states[0], np.full(300, np.nan))
        assert not tracker.diagnostics(bank)["gated"].any()  # of no measurement
    else:
        tracker = IMM(
            motions=tuple(WhiteAcceleration(q=q) for q in noise),
            transition=tuple(map(tuple, P.tolist())),
            filter=EKF(gate=0.99, fading=fading),
        )
        bank = ModelBank(states, np.full((2, 300), 0.5), np.full(300, np.nan), 4)
    found = tracker.step(model, bank, z, 1, rng)
    got, gates = tracker.estimate(found), []
    for run in range(300):
        first = means[:, :, run], covs, np.full(models, 1 / models)
        m, V, w, nis, refused = by_hand(*first, noise, P, z[:, run], fading)
        np.testing.assert_allclose(got.mean[:, run], m, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(got.cov[..., run], V, rtol=1e-9, atol=1e-9)
        if models == 2:
            np.testing.assert_allclose(found.weights[:, run], w, rtol=1e-8)
            np.testing.assert_allclose(found.nis[run], nis, rtol=1e-9)
        gates.append((np.isfinite(z[:, run]).sum(), refused.sum()))
    kinds = {(n, r) for n in (1, 2) for r in range(models + 1)} | {(0, 0)}
    assert set(gates) == kinds  # each number of components is refused by none, one and all models
