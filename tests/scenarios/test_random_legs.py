"""The lidar problem, held against a scalar program of its own and against what its numbers say."""

from dataclasses import replace
from math import cos, hypot, pi, sin

import numpy as np
import pytest

from tests.conftest import EXPERIMENT_FILES, track
from trackbench.config.load import load
from trackbench.core.random_streams import RunStreams
from trackbench.evaluation.simulated_runs import simulate
from trackbench.models.sensors.range_azimuth import PolarPosition
from trackbench.scenarios.targets.random_legs import RandomLegs
from trackbench.scenarios.targets.timeline import Timeline

RUNS = 400


@pytest.fixture(scope="module")
def lidar():
    return load(EXPERIMENT_FILES["lidar"]).points[0]


def _flown(target: RandomLegs, steps: int, seed: int, run: int) -> np.ndarray:
    """One run from the same draws, as simple_lidar_simulator.py steps it (T = 1)."""
    rng = RunStreams(seed, [run])
    x, y, share, heading, many = rng.random((5, 1))[:, 0]
    lengths = [target.leg_steps[0] + int(u * 4) for u in rng.random((6, 1))[:, 0]]
    across = [target.across * (2 * u - 1) for u in rng.random((6, 1))[:, 0]]
    along = [target.sigma_along * e for e in rng.standard_normal((6, 1))[:, 0]]
    legs = target.legs[0] + int(many * 3)
    if target.straight_steps is not None:
        low, high = target.straight_steps
        straight = [low + int(u * (high - low + 1)) for u in rng.random((6, 1))[:, 0]]
        lengths = [n for pair in zip(straight, lengths, strict=True) for n in pair]
        across = [a for turn in across for a in (0.0, turn)]
        along = [a for push in along for a in (0.0, push)]
        legs *= 2
    v = 30 + 60 * share
    state = [
        600 * (2 * x - 1),
        v * cos(2 * pi * heading),
        600 * (2 * y - 1),
        v * sin(2 * pi * heading),
    ]
    path = [state]
    for leg in range(legs):
        for _ in range(lengths[leg]):
            px, vx, py, vy = path[-1]
            v = hypot(vx, vy)
            ax = along[leg] * vx / v - across[leg] * vy / v
            ay = along[leg] * vy / v + across[leg] * vx / v
            path.append([px + vx + ax / 2, vx + ax, py + vy + ay / 2, vy + ay])
    out = np.full((4, steps), np.nan)
    out[:, : len(path)] = np.array(path).T[:, :steps]
    return out


@pytest.mark.parametrize("straight", [None, (1, 4)])
def test_each_run_is_that_of_a_scalar_program(lidar, straight) -> None:
    target = replace(lidar.scenario.target, straight_steps=straight)
    data = simulate(replace(lidar.scenario, target=target), 7, 0, 20)
    for run in range(20):
        expected = _flown(target, 49, 7, run)
        np.testing.assert_allclose(data.truth[..., run], expected, rtol=1e-9)


def test_after_the_last_leg_there_is_neither_truth_nor_measurement(lidar) -> None:
    data = simulate(lidar.scenario, 7, 0, RUNS)
    there = np.isfinite(data.truth[0])
    lengths = there.sum(axis=0)
    assert 21 <= lengths.min() < 25
    assert 42 < lengths.max() <= 49
    assert (there == (np.arange(49)[:, None] < lengths)).all()
    np.testing.assert_array_equal(np.isfinite(data.measurements), there[1:][None].repeat(2, axis=0))
    found = track(lidar.scenario, lidar.filters["EKF"], 50)
    assert np.isfinite(found.mean).all()
    assert (np.isfinite(found.nees) == there[:, :50]).mean() > 0.5


def test_what_the_experiment_estimates_are_the_variances_of_the_data(lidar) -> None:
    """q = (2^2 + 15^2 / 3) / 2 off the motion on each axis, and 25 m of a measured position."""
    data = simulate(lidar.scenario, 8, 0, 1000)
    px, vx, py, vy = data.truth
    jumps = np.stack([np.diff(vx, axis=0), np.diff(vy, axis=0)])
    per_run = np.nanmean(np.square(jumps), axis=(0, 1))
    assert abs(per_run.mean() - 39.5) < 3 * per_run.std() / 1000**0.5
    off = np.square(data.measurements - np.stack([px, py])[:, 1:])
    per_run = np.nanmean(off, axis=(0, 1))
    assert abs(per_run.mean() - 25.0**2) < 4 * per_run.std() / 1000**0.5
    assert lidar.assumed["KF"].motion.q == 39.5
    assert lidar.assumed["KF"].sensor.sigma == 25


def test_the_sensor_s_covariance_is_that_of_its_errors(rng: np.random.Generator) -> None:
    sensor = PolarPosition(sigma_range=2.0, sigma_azimuth_mrad=26.0, at=(10.0, -5.0))
    x = np.array([510.0, 3.0, 295.0, 4.0])[:, None]
    z = sensor.draw(x.repeat(100_000, axis=1), 0, rng.standard_normal((2, 100_000)))
    seen = sensor.measurement(x, 0)
    # Bent along an arc, which the first order leaves out: r s^2 / 2 = 0.2 m of 15 m.
    np.testing.assert_allclose(z.mean(axis=1), seen.mean[:, 0], atol=0.35)
    np.testing.assert_allclose(np.cov(z), seen.cov[..., 0], rtol=0.03)
    located = sensor.located(x[0::2], 0)
    np.testing.assert_array_equal(located.mean, x[0::2])
    np.testing.assert_allclose(located.cov, seen.cov)


def test_a_random_path_has_no_bound() -> None:
    target = RandomLegs(
        area=600, speed=(30, 90), legs=(4, 6), leg_steps=(5, 8), sigma_along=2, across=15
    )
    assert target.why_no_bound is not None
    timeline = Timeline(np.arange(3), np.arange(3.0), 1.0)
    assert target.path(timeline).shape == (4, 3)
