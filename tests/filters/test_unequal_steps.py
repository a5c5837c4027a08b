"""Unequal steps: every filter's prediction, and for smoothers all states at once by least squares."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from tests.conftest import make_filter
from trackbench.core.distributions import Gaussian
from trackbench.core.random_streams import block_stream
from trackbench.models.base import Model
from trackbench.models.motions.kinematic import WhiteAcceleration
from trackbench.models.motions.unequal_intervals import Irregular
from trackbench.models.sensors.position import PositionSensor
from trackbench.registry import kinds

FIRST, INTERVALS = 4, np.array([0.3, 2.0, 0.7, 5.0, 0.1, 1.4])
SIGMA, START, RUNS = 2.0, np.diag([9.0, 4.0, 16.0, 1.0]), 3
Z = 5.0 * np.random.default_rng(22).standard_normal((2, len(INTERVALS), RUNS))
Z[:, 2, 1], Z[0, 4, 2] = np.nan, np.nan


def filtered(
    tracker: Any, prior: Gaussian, z: np.ndarray, q: float
) -> tuple[list[Gaussian], list[Gaussian]]:
    """Estimates of every step, before and after the smoother; the first measured step is 4."""
    rng = block_stream(1, 0)
    motion = Irregular(WhiteAcceleration(q=q), 2, FIRST, INTERVALS)
    model = Model(motion, PositionSensor(sigma=SIGMA))
    with np.errstate(all="ignore"):
        states = [tracker.init(model, prior, rng)]
        for i in range(len(INTERVALS)):
            states.append(tracker.step(model, states[-1], z[:, i], FIRST + i, rng))
        smoothed = tracker.smoothed(model, states, FIRST - 1, rng)
    alone, later = (list(map(tracker.estimate, found)) for found in (states, smoothed))
    return alone, later


def smoothed_moments(tracker: Any) -> tuple[np.ndarray, ...]:
    """Smoothed means (4, T + 1, M), covariances (4, 4, T + 1, M), and those of the filter before."""
    out = []
    for each in reversed(filtered(tracker, Gaussian(np.ones((4, RUNS)), START), Z, 1.0)):
        covs = [np.broadcast_to(x.cov.reshape(4, 4, -1), (4, 4, RUNS)) for x in each]
        out += [np.stack([x.mean for x in each], 1), np.stack(covs, 2)]
    return tuple(out)


def least_squares(
    noise: Sequence[float], lag: int | None = None, fading: float = 1.0, P: Any = START
) -> tuple[np.ndarray, np.ndarray]:
    """The same of all states given the measurements, with the spectral density of each interval.

    A fading memory is a process noise of (a^2 - 1) F P F' more, with the filter's covariances P.
    """
    T = len(INTERVALS)
    means, covs = np.empty((4, T + 1, RUNS)), np.empty((4, 4, T + 1, RUNS))
    P = np.broadcast_to(P if P.ndim > 2 else P[..., None, None], (4, 4, T + 1, RUNS))
    for run in range(RUNS):
        # Prior and motions: x_0 = 1, x_{k+1} - F x_k = 0, each with its inverse covariance.
        J, y = np.zeros((4 * T + 4,) * 2), np.zeros(4 * T + 4)
        J[:4, :4], y[:4] = np.linalg.inv(START), np.diag(np.linalg.inv(START))
        for i, (t, q) in enumerate(zip(INTERVALS, noise, strict=True)):
            F = np.kron(np.eye(2), [[1.0, t], [0.0, 1.0]])
            Q = np.kron(np.eye(2), q * np.array([[t**3 / 3, t**2 / 2], [t**2 / 2, t]]))
            Q = Q + (fading**2 - 1.0) * F @ P[..., i, run] @ F.T
            A = np.hstack([-F, np.eye(4)])
            J[4 * i : 4 * i + 8, 4 * i : 4 * i + 8] += A.T @ np.linalg.solve(Q, A)
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


PLANAR = {"state.planar", "motion.jacobian", "sensor.jacobian", "motion.T|intervals"}
PLANAR |= {"motion.F|linear", "sensor.H"}
KINDS = [
    kind
    for kind, cls in kinds("filters").items()
    if cls.__module__.startswith("trackbench.")  # those of other tests may be registered
    and {*cls.requires} <= PLANAR
    and not (kind.startswith("grid") or cls.runs_program)
]


@pytest.mark.parametrize("kind", [*KINDS, "pf with moves"])
def test_a_known_state_without_noise_moves_in_a_straight_line(kind: str) -> None:
    """From 1 m at 1 m/s, along both axes; no measurement corrects a wrong interval."""
    still = WhiteAcceleration(q=1e-12)
    chain = {"motions": (still, still), "transition": ((0.9, 0.1), (0.2, 0.8))}
    keys: dict[str, Any] = {"imm": chain, "mmpf": chain, "pf with moves": {"moves": 3}}
    tracker: Any = make_filter(kind.split()[0], **keys.get(kind, {}))
    prior = Gaussian(np.ones((4, 2)), 1e-12 * np.eye(4))
    found, _ = filtered(tracker, prior, np.full((2, len(INTERVALS), 2), np.nan), still.q)
    at = 1.0 + np.concatenate([[0.0], np.cumsum(INTERVALS)])
    for x, position in zip(found, at, strict=True):
        np.testing.assert_allclose(x.mean[:, 0], [position, 1.0, position, 1.0], atol=1e-4)
