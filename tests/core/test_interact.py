"""The IMM of constant linear motions, also with a radar, in one call: the bytes of its steps."""

from collections.abc import Iterator

import numpy as np
import pytest

from trackbench.core import compiled
from trackbench.core.distributions import Gaussian
from trackbench.filters.base import Steps
from trackbench.filters.imm import IMM, ModelBank
from trackbench.filters.ukf import UKF
from trackbench.models.base import Model
from trackbench.models.motions.kinematic import (
    ConstantAcceleration,
    ConstantVelocity,
    WhiteAcceleration,
)
from trackbench.models.sensors.position import PositionSensor, ScalarSensor
from trackbench.models.sensors.range_azimuth import RangeAzimuth

pytestmark = pytest.mark.skipif(compiled.kernels is None, reason="there are no C kernels")
RNG = np.random.default_rng(0)
TWO = ((0.95, 0.05), (0.02, 0.98))
FORGETFUL = ((1.0, 0.0, 0.0), (0.5, 0.5, 0.0), (0.3, 0.0, 0.7))
IMMS = {
    "two": IMM(motions=(WhiteAcceleration(q=0.02), WhiteAcceleration(q=2.0)), transition=TWO),
    "three": IMM(
        motions=(ConstantVelocity(q=0.01), ConstantVelocity(q=1.0), WhiteAcceleration(q=9.0)),
        transition=FORGETFUL,
        initial=(0.0, 0.2, 0.8),
    ),
    "acceleration": IMM(
        motions=(ConstantAcceleration(q=0.01), ConstantAcceleration(q=1.0)), transition=TWO
    ),
}


def model_of(n_z: int = 2) -> Model:
    """A planar target, or one along a line."""
    if n_z == 1:
        return Model(WhiteAcceleration(q=1.0).sampled(0.7, axes=1), ScalarSensor(sigma=2.0))
    return Model(WhiteAcceleration(q=1.0).sampled(0.7), PositionSensor(sigma=3.0))


def bytes_of(tracker: IMM, state: ModelBank) -> Iterator[bytes]:
    """Yield the bytes of all numbers of a state; NaN all have one payload."""
    arrays = [state.weights, state.predicted_weights, state.nis]
    arrays += tracker.diagnostics(state).values()
    for gaussian in (*state.states, state.prediction, tracker.estimate(state)):
        arrays += [gaussian.mean, gaussian.cov]
    arrays += [a for innovation in state.innovations for a in (innovation.nu, innovation.S)]
    arrays.append(tracker.log_likelihood(state))
    for array in arrays:
        yield np.where(np.isnan(array), np.nan, array).tobytes()


def first_state(tracker: IMM, model: Model, runs: int, cov: np.ndarray) -> ModelBank:
    mean = np.random.default_rng(runs).normal(scale=10.0, size=(len(cov), runs))
    return tracker.init(model, Gaussian(mean, cov), RNG)


@pytest.mark.parametrize("name", IMMS)
@pytest.mark.parametrize("runs", [1, 50, 700])
def test_states_have_the_bytes_of_single_steps(name: str, runs: int) -> None:
    tracker, model = IMMS[name], model_of()
    z = np.random.default_rng(runs).normal(scale=30.0, size=(2, 12, runs))
    z[:, [0, 7, 11]] = np.nan  # steps without a measurement, the last among them
    z[0, 4] = np.nan
    z[1, 9] = 1e5  # the densities of both models are below the numbers
    for cov in (9.0 * np.eye(4), np.diag([4.0, 0.0, 1e-9, 0.0]), np.zeros((4, 4))):
        first = first_state(tracker, model, runs, cov)
        steps = tracker.all_steps(model, first, z, 1)
        assert steps is not None
        state = first
        for i in range(z.shape[1]):
            state = tracker.step(model, state, z[:, i], i + 1, RNG)
            assert list(bytes_of(tracker, steps.state(i))) == list(bytes_of(tracker, state))
        assert list(bytes_of(tracker, steps.state(-1))) == list(bytes_of(tracker, state))


@pytest.mark.parametrize("name", IMMS)
@pytest.mark.parametrize("runs", [1, 50, 700])
def test_a_radar_has_the_bytes_of_single_steps(name: str, runs: int) -> None:
    tracker = IMMS[name]
    radar = RangeAzimuth(sigma_range=20.0, sigma_azimuth_mrad=30.0, at=(300.0, 5.0))
    model = Model(WhiteAcceleration(q=1.0).sampled(0.7), radar)
    # Targets on both sides of the jump of the azimuth by 2 pi.
    x = np.random.default_rng(runs).normal(scale=20.0, size=(4, 12, runs))
    z = radar.measurement(x, 1).mean
    assert runs == 1 or np.ptp(z[1]) > 6.0
    z[:, [0, 7, 11]] = np.nan  # steps without a measurement, the last among them
    z[0, 4] = np.nan
    z[1, 5] = np.nan
    for cov in (9.0 * np.eye(4), np.diag([4.0, 0.0, 1e-9, 0.0])):
        first = first_state(tracker, model, runs, cov)
        steps = tracker.all_steps(model, first, z, 1)
        assert steps is not None
        state = first
        for i in range(z.shape[1]):
            state = tracker.step(model, state, z[:, i], i + 1, RNG)
            assert list(bytes_of(tracker, steps.state(i))) == list(bytes_of(tracker, state))


def test_one_measured_component() -> None:
    tracker, model = IMMS["two"], model_of(1)
    first = first_state(tracker, model, 3, np.eye(2))
    z = np.random.default_rng(1).normal(size=(1, 5, 3))
    z[:, 2] = np.nan
    steps = tracker.all_steps(model, first, z, 1)
    assert steps is not None
    state = first
    for i in range(5):
        state = tracker.step(model, state, z[:, i], i + 1, RNG)
        assert list(bytes_of(tracker, steps.state(i))) == list(bytes_of(tracker, state))


def test_all_steps_together_and_the_states_before_them() -> None:
    tracker, model = IMMS["two"], model_of()
    first = first_state(tracker, model, 2, np.eye(4))
    z = np.random.default_rng(1).normal(size=(2, 5, 2))
    steps = tracker.all_steps(model, first, z, 1)
    assert steps is not None
    together = steps.together()
    for i in range(5):
        alone = steps.state(i)
        likelihood = tracker.log_likelihood(together)[i]
        assert likelihood.tobytes() == tracker.log_likelihood(alone).tobytes()
        assert together.prediction.cov[:, :, i].tobytes() == alone.prediction.cov.tobytes()
    before = steps.before(np.array([0, 3]))
    for place, state in ((slice(0, 2), first), (slice(2, 4), steps.state(2))):
        np.testing.assert_array_equal(before.weights[:, place], state.weights)
        for a, b in zip(before.states, state.states, strict=True):
            np.testing.assert_array_equal(a.mean[:, place], b.mean)
            np.testing.assert_array_equal(a.cov[:, :, place], b.cov)


def test_what_is_left_to_single_steps() -> None:
    tracker, model = IMMS["two"], model_of()
    first = first_state(tracker, model, 5, np.eye(4))
    z = np.zeros((2, 3, 5))
    assert isinstance(tracker.all_steps(model, first, z, 1), Steps)
    some_missing = np.where(np.arange(5) == 2, np.nan, z)
    assert tracker.all_steps(model, first, some_missing, 1) is None
    assert tracker.all_steps(model, first, np.full(z.shape, np.inf), 1) is None
    mixed = IMM(motions=(ConstantVelocity(q=1.0), ConstantAcceleration(q=1.0)), transition=TWO)
    assert mixed.all_steps(model, first_state(mixed, model, 5, np.eye(4)), z, 1) is None
    for other in ({"gate": 0.99}, {"fading": 1.1}, {"form": "square-root"}):
        changed = IMM(motions=tracker.motions, transition=TWO, filter=type(tracker.filter)(**other))
        assert changed.all_steps(model, first, z, 1) is None
    unscented = IMM(motions=tracker.motions, transition=TWO, filter=UKF())
    assert unscented.all_steps(model, first, z, 1) is None
