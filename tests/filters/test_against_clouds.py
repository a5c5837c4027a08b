"""Doppler and bearings only: Gaussian steps against the posterior of a cloud of 1e5 particles."""

from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pytest

from tests.conftest import make_filter, track
from trackbench.core.arrays import Array
from trackbench.filters.ekf import EKF
from trackbench.filters.ukf import CKF, UKF
from trackbench.models.motions.kinematic import WhiteAcceleration
from trackbench.models.sensors.bearing import Bearing
from trackbench.models.sensors.platform import Platform
from trackbench.models.sensors.range_azimuth import RangeAzimuthDoppler
from trackbench.scenarios.starts.gaussian import GaussianStart
from trackbench.scenarios.targets.driven import Driven
from trackbench.scenarios.targets.initial_state import Launch
from trackbench.scenarios.tracking import Tracking

RUNS, N = 4, 100_000
TARGET = Driven(
    motion=WhiteAcceleration(q=0.5), launch=Launch(x=6000.0, y=3000.0, vx=-60.0, vy=40.0)
)
SCENARIOS = {
    "doppler": Tracking(
        target=TARGET,
        sensor=RangeAzimuthDoppler(sigma_range=30.0, sigma_azimuth_mrad=5.0, sigma_range_rate=1.0),
        start=GaussianStart(sigma=(60.0, 8.0, 60.0, 8.0)),
        last=25,
    ),
    "bearings": Tracking(
        target=TARGET,
        sensor=Bearing(
            sigma_mrad=5.0,
            platform=Platform(steps=(0, 12, 25), x=(0.0, 0.0, 1500.0), y=(0.0, 1500.0, 1500.0)),
        ),
        start=GaussianStart(sigma=(400.0, 15.0, 400.0, 15.0)),
        last=25,
    ),
}


class Found(NamedTuple):
    """Means (n, T, M), variances (n, T, M), log-likelihoods (T, M)."""

    mean: Array
    variance: Array
    told: Array


def found(name: str, tracker: Any, seed: int = 1) -> Found:
    out = track(
        SCENARIOS[name], tracker, RUNS, seed, covariances=RUNS, predictive_metrics=("score",)
    )
    assert out.cov is not None
    variance = np.stack([out.cov[i, i] for i in range(4)])
    return Found(out.mean[:, 1:], variance[:, 1:], out.diagnostics["log_likelihood"][1:])


@cache
def posterior(name: str, particles: int = N) -> Found:
    """By a bootstrap filter: the transition is not regularized, which would widen it."""
    return found(name, make_filter("pf", N=particles))


def apart(a: Found, b: Found) -> float:
    """Root mean square distance of the means in the posterior's standard deviations."""
    return float(np.sqrt((np.square(a.mean - b.mean) / b.variance).mean()))


@pytest.mark.parametrize("name", SCENARIOS)
def test_the_cloud_is_large_enough(name: str) -> None:
    """Another cloud, with other noise, finds the same within a tenth of a standard deviation."""
    other, cloud = posterior(name, N - 1), posterior(name)
    assert 0.0 < apart(other, cloud) < 0.1
    assert np.abs(other.told - cloud.told).mean() < 0.06


@pytest.mark.parametrize(("name", "within"), [("doppler", 0.15), ("bearings", 0.5)])
@pytest.mark.parametrize("tracker", [EKF(), UKF(), CKF()], ids=lambda f: f"{f.kind}")
def test_gaussian_steps_find_the_posterior(name: str, within: float, tracker: Any) -> None:
    """Within the cloud's own error where ranges are measured; bearings alone leave it curved."""
    ours, cloud = found(name, tracker), posterior(name)
    assert apart(ours, cloud) < within
    assert np.sqrt(ours.variance / cloud.variance).mean() == pytest.approx(1.0, abs=0.05)
    assert np.abs((ours.told - cloud.told).mean()) < 0.05
