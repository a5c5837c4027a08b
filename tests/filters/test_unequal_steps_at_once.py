"""All steps of a recording with unequal intervals in one call: the bytes of single steps."""

from typing import Any

import numpy as np
import pytest

from trackbench.core import compiled
from trackbench.core.arrays import Array, with_trailing
from trackbench.core.distributions import Gaussian
from trackbench.filters.base import AnyFilter
from trackbench.filters.ekf import EKF
from trackbench.filters.imm import IMM
from trackbench.filters.kf import KF
from trackbench.filters.ukf import UKF
from trackbench.models.base import Model, Motion
from trackbench.models.motions.coordinated_turn import CoordinatedTurn, UnknownTurn
from trackbench.models.motions.kinematic import WhiteAcceleration
from trackbench.models.motions.singer import Singer
from trackbench.models.motions.unequal_intervals import Irregular, put_side_by_side
from trackbench.models.sensors.position import PositionSensor
from trackbench.models.sensors.range_azimuth import RangeAzimuth

pytestmark = pytest.mark.skipif(compiled.kernels is None, reason="there are no C kernels")
FIRST = 1
"""number of the first step"""
INTERVALS = np.array([0.7, 0.7, 2.0, 0.1, 0.7, 5.0, 0.3, 0.1, 0.7])
CWNA = WhiteAcceleration(q=1.0)
POSITIONS = PositionSensor(sigma=3.0)
RADAR = RangeAzimuth(sigma_range=20.0, sigma_azimuth_mrad=30.0)
SWITCHING = IMM(
    motions=(WhiteAcceleration(q=0.1), WhiteAcceleration(q=10.0)),
    transition=((0.9, 0.1), (0.2, 0.8)),
)
CASES: dict[str, tuple[AnyFilter, Motion, Any]] = {
    "kf": (KF(), CWNA, POSITIONS),
    "kf with accelerations": (KF(), Singer(sigma=2.0, tau=9.0), POSITIONS),
    "kf of a turn": (KF(), CoordinatedTurn(turn_rate_deg_s=5.0, q=1.0), POSITIONS),
    "ekf of positions": (EKF(), CWNA, POSITIONS),
    "ekf of a radar": (EKF(), CWNA, RADAR),
    "ukf of positions": (UKF(), CWNA, POSITIONS),
    "ukf of a radar": (UKF(), CWNA, RADAR),
    "imm of positions": (SWITCHING, CWNA, POSITIONS),
    "imm of a radar": (SWITCHING, CWNA, RADAR),
}


def model_of(motion: Motion, sensor: Any) -> Model:
    return Model(Irregular(motion, axes=2, first=FIRST, intervals=INTERVALS), sensor)


def first_state(tracker: AnyFilter, model: Model, runs: int) -> Any:
    n = len(model.motion.components)
    mean = np.random.default_rng(runs).normal(scale=5.0, size=(n, runs))
    mean[0] -= 400.0
    rng = np.random.default_rng(0)
    return tracker.init(model, Gaussian(mean, 900.0 * np.eye(n)), rng)


def measurements(model: Model, runs: int) -> Array:
    """Measurements (n_z, T, M), of which that of the third step is missing."""
    rng = np.random.default_rng(runs)
    x = np.zeros((len(model.motion.components), len(INTERVALS), runs))
    x[0] = -400.0
    x += rng.normal(scale=10.0, size=x.shape)
    z = model.sensor.measurement(x, FIRST).mean.copy()
    z[:, 2] = np.nan
    return z


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("runs", [1, 20])
def test_estimates_and_scores_have_the_bytes_of_single_steps(name: str, runs: int) -> None:
    tracker, motion, sensor = CASES[name]
    model = model_of(motion, sensor)
    z = measurements(model, runs)
    rng = np.random.default_rng(0)
    state = first_state(tracker, model, runs)
    steps = tracker.all_steps(model, state, z, FIRST)
    assert steps is not None
    assert steps.together is not None
    together = steps.together()
    scores = tracker.log_likelihood(together)
    assert scores is not None
    for i in range(len(INTERVALS)):
        state = tracker.step(model, state, z[:, i], FIRST + i, rng)
        estimate = tracker.estimate(state)
        assert steps.estimate.mean[:, i].tobytes() == estimate.mean.tobytes()
        # One covariance may serve all runs, in all steps or only in one by one.
        cov = with_trailing(estimate.cov, 1, leading=2)
        expected, cov_of_steps = np.broadcast_arrays(cov, steps.estimate.cov[:, :, i])
        np.testing.assert_array_equal(cov_of_steps, expected)
        np.testing.assert_array_equal(together.prediction.mean[:, i], state.prediction.mean)
        np.testing.assert_array_equal(scores[i], tracker.log_likelihood(state))
        np.testing.assert_array_equal(steps.diagnostics["nis"][i], state.nis)


@pytest.mark.parametrize("name", CASES)
def test_steps_side_by_side_have_an_interval_each(name: str) -> None:
    tracker, motion, sensor = CASES[name]
    model = model_of(motion, sensor)
    runs = 2
    z = measurements(model, runs)
    rng = np.random.default_rng(0)
    state = first_state(tracker, model, runs)
    steps = tracker.all_steps(model, state, z, FIRST)
    assert steps is not None
    assert steps.before is not None
    index = np.array([1, 3, 5])
    numbers = (FIRST + index).tolist()
    joined = Model(put_side_by_side(model.motion, numbers, runs), sensor)
    z_of_steps = z[:, index].reshape(len(z), -1)
    after = tracker.step(joined, steps.before(index), z_of_steps, FIRST, rng)
    scores = np.reshape(np.asarray(tracker.log_likelihood(after)), (len(index), runs))
    for row, i in enumerate(index.tolist()):
        alone = tracker.step(model, steps.state(i - 1), z[:, i], FIRST + i, rng)
        np.testing.assert_array_equal(scores[row], tracker.log_likelihood(alone))


def test_a_motion_that_is_not_linear_is_left_to_single_steps() -> None:
    model = model_of(UnknownTurn(q=0.1, turn_walk_deg_s=1.0), POSITIONS)
    z = measurements(model, 1)
    assert UKF().all_steps(model, first_state(UKF(), model, 1), z, FIRST) is None
