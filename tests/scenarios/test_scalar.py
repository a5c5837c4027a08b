"""The scalar kinds that no paper has: a first-order process seen with noise, by a Kalman filter."""

from dataclasses import replace

import numpy as np
import pytest

from tests.conftest import track
from trackbench.evaluation.simulated_runs import simulate
from trackbench.filters.kf import KF
from trackbench.models.motions.autoregressive import Autoregressive
from trackbench.models.motions.map_or_ode import MapMotion, OdeMotion
from trackbench.models.sensors.function import FunctionSensor
from trackbench.models.sensors.position import ScalarSensor
from trackbench.scenarios.starts.gaussian import GaussianStart
from trackbench.scenarios.targets.driven import Driven
from trackbench.scenarios.targets.initial_state import Launch
from trackbench.scenarios.tracking import Tracking

SCENARIO = Tracking(
    target=Driven(motion=Autoregressive(phi=0.9, q=0.5), launch=Launch(x=2.0)),
    sensor=ScalarSensor(sigma=0.7),
    start=GaussianStart(sigma=(1.5,)),
    last=30,
)


def test_kalman_filter() -> None:
    runs = 2000
    found, data = track(SCENARIO, KF(), runs), simulate(SCENARIO, 1, 0, runs)
    mean, P = np.full(runs, 2.0), 1.5**2
    for k, z in enumerate(data.measurements[0], 1):
        mean, P = 0.9 * mean, 0.81 * P + 0.5
        K = P / (P + 0.49)
        mean, P = mean + K * (z - mean), (1.0 - K) * P
        np.testing.assert_allclose(found.mean[0, k], mean, rtol=1e-11, atol=1e-12)
    error = found.mean[0] - data.truth[0]
    assert abs(np.square(error[-1]).mean() / P - 1.0) < 4.5 * np.sqrt(2.0 / runs)
    np.testing.assert_allclose(SCENARIO.bounds()[""][-1], np.sqrt(P), rtol=1e-10)


@pytest.mark.parametrize(
    ("motion", "phi"),
    [
        (MapMotion(components=("x",), next={"x": "0.9*x + 2 + sin(k)"}, Q=0.5), 0.9),
        # One Runge-Kutta step of dx/dt = -x/10 + t has the series of exp(-1/10) to order 4.
        (
            OdeMotion(components=("x",), derivative={"x": "-x/10 + t"}, Q=0.5),
            1 - 0.1 + 0.1**2 / 2 - 0.1**3 / 6 + 0.1**4 / 24,
        ),
    ],
)
def test_a_known_input_leaves_the_bound(motion: MapMotion | OdeMotion, phi: float) -> None:
    sensor = FunctionSensor(h={"z": "x"}, R=0.49)
    scenario = Tracking(
        target=Driven(motion=motion), sensor=sensor, start=GaussianStart(sigma=(1.5,)), last=30
    )
    assert scenario.why_no_bound is None
    P = 1.5**2
    for bound in scenario.bounds()[""][1:]:
        P = phi * phi * P + 0.5
        P = P * 0.49 / (P + 0.49)
        np.testing.assert_allclose(bound, np.sqrt(P), rtol=1e-10)


@pytest.mark.parametrize("following", ["x/(1 + x**2)", "x*cos(k)"])
def test_other_motions_have_no_bound(following: str) -> None:
    motion = MapMotion(components=("x",), next={"x": following}, Q=0.5)
    scenario = replace(SCENARIO, target=Driven(motion=motion))
    assert "constant F and Q" in str(scenario.why_no_bound)
