"""The UKF, and the EKF of a radar, in one call: the bytes of their steps."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from trackbench.core import compiled
from trackbench.core.distributions import Gaussian
from trackbench.filters.ekf import EKF
from trackbench.filters.gaussian_base import GaussianFilter, Tracked
from trackbench.filters.ukf import CKF, UKF
from trackbench.models.base import Model
from trackbench.models.motions.kinematic import (
    ConstantAcceleration,
    ConstantVelocity,
    PerAxis,
    WhiteAcceleration,
)
from trackbench.models.sensors.platform import Platform
from trackbench.models.sensors.position import PositionSensor, ScalarSensor, VelocitySensor
from trackbench.models.sensors.range_azimuth import RangeAzimuth

pytestmark = pytest.mark.skipif(compiled.kernels is None, reason="there are no C kernels")
RNG = np.random.default_rng(0)
ERRORS: dict[str, Any] = {"sigma_range": 20.0, "sigma_azimuth_mrad": 30.0}
RADAR = RangeAzimuth(**ERRORS)
CWNA = WhiteAcceleration(q=1.0)
CASES: dict[str, tuple[GaussianFilter, PerAxis, Any]] = {
    "ukf of a radar": (UKF(), CWNA, RADAR),
    "ukf of a radar at a place, singular noise": (
        UKF(alpha=0.5, beta=2.0, kappa=1.0),
        ConstantVelocity(q=0.3),
        RangeAzimuth(**ERRORS, at=(30.0, -7.0)),
    ),
    "ukf of positions": (UKF(), CWNA, PositionSensor(sigma=3.0)),
    "ukf of velocities, with accelerations": (
        UKF(smooth=True),
        ConstantAcceleration(q=0.1),
        VelocitySensor(sigma=0.5),
    ),
    "ukf along a line": (UKF(), CWNA, ScalarSensor(sigma=2.0)),
    "ekf of a radar": (EKF(), CWNA, RADAR),
    "ekf of a radar at a place, with accelerations": (
        EKF(),
        ConstantAcceleration(q=0.1),
        RangeAzimuth(**ERRORS, at=(30.0, -7.0)),
    ),
}


def model_of(motion: PerAxis, sensor: Any) -> Model:
    axes = 1 if isinstance(sensor, ScalarSensor) else 2
    return Model(motion.sampled(0.7, axes=axes), sensor)


def first_state(tracker: GaussianFilter, model: Model, runs: int, std: float) -> Tracked:
    """State of targets that the radar sees on both sides of the jump of the azimuth by 2 pi."""
    n = len(model.motion.components)
    mean = np.random.default_rng(runs).normal(scale=5.0, size=(n, runs))
    mean[0] -= 400.0
    return tracker.init(model, Gaussian(mean, std * std * np.eye(n)), RNG)


def measurements(model: Model, steps: int, runs: int) -> np.ndarray:
    """Measurements with gaps: of all runs, of some, of one component, and of the last step."""
    rng = np.random.default_rng(runs)
    n = len(model.motion.components)
    x = np.zeros((n, steps, runs))
    x[0] = -400.0
    x += rng.normal(scale=10.0, size=x.shape)
    z = model.sensor.measurement(x, 1).mean.copy()
    z[:, [0, 7, steps - 1]] = np.nan
    z[0, 4] = np.nan
    z[-1, 5, : runs // 2] = np.nan
    return z


def bytes_of(tracker: GaussianFilter, state: Tracked) -> Iterator[bytes]:
    """Yield the bytes of all numbers of a state; NaN all have one payload."""
    innovation = state.innovation
    assert innovation is not None
    arrays = [state.posterior.mean, state.posterior.cov, innovation.nu, innovation.S]
    arrays += [state.nis, tracker.log_likelihood(state)]
    if not tracker.smooths:
        assert state.prediction is not None
        arrays += [state.prediction.mean, state.prediction.cov]
    for array in arrays:
        yield np.where(np.isnan(array), np.nan, array).tobytes()


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("runs", [1, 50, 512])
def test_states_have_the_bytes_of_single_steps(name: str, runs: int) -> None:
    tracker, motion, sensor = CASES[name]
    model = model_of(motion, sensor)
    z = measurements(model, 12, runs)
    for std in (30.0, 1e-3):
        first = first_state(tracker, model, runs, std)
        steps = tracker.all_steps(model, first, z, 1)
        assert steps is not None
        state = first
        for i in range(z.shape[1]):
            state = tracker.step(model, state, z[:, i], i + 1, RNG)
            assert list(bytes_of(tracker, steps.state(i))) == list(bytes_of(tracker, state))
        np.testing.assert_array_equal(steps.diagnostics["nis"][-1], state.nis)
        np.testing.assert_array_equal(steps.estimate.mean[:, -1], state.posterior.mean)


def test_a_radar_sees_targets_across_the_jump_of_its_azimuth() -> None:
    model = model_of(CWNA, RADAR)
    azimuths = measurements(model, 12, 50)[1]
    assert np.nanmin(azimuths) < -3.0
    assert np.nanmax(azimuths) > 3.0


@pytest.mark.parametrize("name", ["ukf of a radar", "ekf of a radar"])
def test_all_steps_together_and_the_states_before_them(name: str) -> None:
    tracker, motion, sensor = CASES[name]
    model = model_of(motion, sensor)
    first = first_state(tracker, model, 2, 30.0)
    steps = tracker.all_steps(model, first, measurements(model, 9, 2), 1)
    assert steps is not None
    assert steps.together is not None
    assert steps.before is not None
    together = steps.together()
    for i in range(9):
        alone = steps.state(i)
        likelihood = tracker.log_likelihood(together)[i]
        np.testing.assert_array_equal(likelihood, tracker.log_likelihood(alone))
        assert together.prediction.cov[:, :, i].tobytes() == alone.prediction.cov.tobytes()
    before = steps.before(np.array([0, 3])).posterior
    for place, state in ((slice(0, 2), first), (slice(2, 4), steps.state(2))):
        np.testing.assert_array_equal(before.mean[:, place], state.posterior.mean)
        np.testing.assert_array_equal(before.cov[:, :, place], state.posterior.cov)


@pytest.mark.parametrize("tracker", [UKF(), EKF()])
def test_what_is_left_to_single_steps(tracker: GaussianFilter) -> None:
    model = model_of(CWNA, RADAR)
    first = first_state(tracker, model, 5, 30.0)
    z = measurements(model, 9, 5)
    assert tracker.all_steps(model, first, z, 1) is not None
    infinite = z.copy()
    infinite[0, 3, 2] = np.inf
    assert tracker.all_steps(model, first, infinite, 1) is None
    if isinstance(tracker, UKF):  # the difference of two covariances loses its digits
        exact = Model(model.motion, PositionSensor(sigma=1e-9))
        assert tracker.all_steps(exact, first, z, 1) is None
    moving = RangeAzimuth(**ERRORS, platform=Platform(steps=(0, 9), x=(0.0, 9.0), y=(0.0, 0.0)))
    assert tracker.all_steps(Model(model.motion, moving), first, z, 1) is None
    many = first_state(tracker, model, 513, 30.0)
    assert tracker.all_steps(model, many, measurements(model, 9, 513), 1) is None
    for keys in ({"gate": 0.99}, {"fading": 1.1}, {"form": "square-root"}):
        changed = type(tracker)(**keys)
        assert changed.all_steps(model, first, z, 1) is None
    for other in (CKF(), UKF(noise="additive"), EKF(order=2)):
        assert other.all_steps(model, first, z, 1) is None


class _OtherUKF(UKF):
    """A filter of a user's, whose `update` must be called."""


class _OtherRadar(RangeAzimuth):
    """A sensor of a user's, whose `measurement` must be called."""


def test_what_users_derive_is_left_to_single_steps() -> None:
    model = model_of(CWNA, RADAR)
    first = first_state(UKF(), model, 2, 30.0)
    z = measurements(model, 9, 2)
    assert _OtherUKF().all_steps(model, first, z, 1) is None
    assert UKF().all_steps(Model(model.motion, _OtherRadar(**ERRORS)), first, z, 1) is None
