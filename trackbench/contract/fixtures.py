"""A filter over simulated data, and the Kalman filter over the same data."""

from typing import Any, NamedTuple

import numpy as np
from numpy.random import SFC64, Generator

from trackbench.core import kalman
from trackbench.core.arrays import Array
from trackbench.core.distributions import per_run_moments
from trackbench.core.random_streams import RunStreams
from trackbench.models.motions.kinematic import WhiteAcceleration
from trackbench.models.motions.scalar import SineGamma
from trackbench.models.sensors.position import PositionSensor
from trackbench.models.sensors.range_azimuth import RangeAzimuth
from trackbench.models.sensors.square_then_line import SquareThenLine
from trackbench.scenarios.base import Simulation
from trackbench.scenarios.starts.without_scans import GaussianStart, Known
from trackbench.scenarios.targets.base import Launch
from trackbench.scenarios.targets.driven import Driven
from trackbench.scenarios.tracking import Tracking


class Pass(NamedTuple):
    """Estimates of every step: mean (n_x, T + 1, M), cov (n_x, n_x, T + 1, M); draws made or not."""

    mean: Array
    cov: Array
    random: bool


def noise() -> Generator:
    """The same noise every time."""
    return Generator(SFC64(20260101))


def simulated(scenario: Any, runs: int, step: int = 1) -> Simulation:
    """The first runs of the scenario, the same every time; in their order, or the last one first."""
    return scenario.simulate(RunStreams(1, range(runs)[::step]), runs)


def filtered(tracker: Any, scenario: Any, data: Simulation) -> Pass:
    """The filter's estimates, by `init` and one `step` after another."""
    rng = noise()
    state = tracker.init(scenario.model, data.prior, rng)
    found = [tracker.estimate(state)]
    for i, k in enumerate(scenario.steps[1:]):
        state = tracker.step(scenario.model, state, data.measurements[:, i], int(k), rng)
        found.append(tracker.estimate(state))
    covs = [per_run_moments(g).cov for g in found]
    is_random = rng.bit_generator.state["state"]["state"].tolist() != _start()
    return Pass(np.stack([g.mean for g in found], axis=1), np.stack(covs, axis=2), is_random)


def _start() -> list[int]:
    return noise().bit_generator.state["state"]["state"].tolist()


def kalman_filtered(scenario: Any, data: Simulation) -> Pass:
    """The exact posterior of a linear Gaussian scenario."""
    motion, sensor = scenario.model
    found = [per_run_moments(data.prior)]
    for i, k in enumerate(scenario.steps[1:]):
        predicted = kalman.predict(found[-1], motion.F, motion.Q)
        nu = data.measurements[:, i] - sensor.measurement(predicted.mean, int(k)).mean
        H, R = sensor.jacobian(predicted.mean, int(k)), sensor.measurement(predicted.mean, 0).cov
        found.append(kalman.update(predicted, nu, H, R)[0])
    mean, cov = (np.stack(a, axis=-2) for a in ([g.mean for g in found], [g.cov for g in found]))
    return Pass(mean, cov, random=False)


LINEAR = Tracking(
    target=Driven(motion=WhiteAcceleration(q=1.0), launch=Launch(x=10.0, vx=1.0, y=-5.0, vy=2.0)),
    sensor=PositionSensor(sigma=2.0),
    start=GaussianStart(sigma=(2.0, 1.0, 2.0, 1.0)),
    last=6,
)
"""Constant velocity in the plane, seen through two noisy positions: the Kalman filter is exact."""

SCALAR = Tracking(
    target=Driven(motion=SineGamma(), launch=Launch(x=1.0)),
    sensor=SquareThenLine(R=0.1),
    start=Known(),
    first=1,
    last=8,
)
"""Van der Merwe's scalar model, for filters that need one."""

RADAR = Tracking(
    target=Driven(
        motion=WhiteAcceleration(q=1.0), launch=Launch(x=6000.0, vx=-80.0, y=3000.0, vy=40.0)
    ),
    sensor=RangeAzimuth(sigma_range=20.0, sigma_azimuth_mrad=2.0),
    start=GaussianStart(sigma=(40.0, 4.0, 40.0, 4.0)),
    last=6,
)
"""The same motion before a radar, for filters that take range and azimuth."""
