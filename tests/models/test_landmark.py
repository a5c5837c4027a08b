"""The sensor `landmark`: its equations, and states that it cannot measure."""

import numpy as np
import pytest

from trackbench.field_types import InvalidKeyError
from trackbench.models.angle_components import measured_angle_rows
from trackbench.models.numerical_derivatives import central_differences
from trackbench.models.sensors.function import FunctionSensor
from trackbench.models.sensors.landmark import Landmark

STATE = ("px", "py", "heading")


@pytest.mark.parametrize(
    ("sigmas", "h"),
    [
        ({"sigma_range": 0.1}, ["range"]),
        ({"sigma_bearing_mrad": 30.0}, ["bearing"]),
        ({"sigma_range": 0.1, "sigma_bearing_mrad": 30.0}, ["range", "bearing"]),
    ],
)
def test_it_is_its_equations(sigmas: dict[str, float], h: list[str]) -> None:
    equations = {
        "range": "sqrt((8 - px)**2 + (2 - py)**2)",
        "bearing": "atan2(2 - py, 8 - px) - heading",
    }
    variances = {"range": 0.01, "bearing": 0.0009}
    function = FunctionSensor(
        h={name: equations[name] for name in h}, R=tuple(variances[name] for name in h), state=STATE
    )
    landmark = Landmark(at=(8.0, 2.0), **sigmas).for_state(STATE)
    x = np.array([[0.0, 3.0, 12.0, 8.5], [0.0, -4.0, 2.5, 2.0], [0.3, 9.0, -2.0, 3.1]])
    ours, theirs = landmark.measurement(x, 1), function.measurement(x, 1)
    np.testing.assert_allclose(landmark.innovation(ours.mean, theirs.mean), 0.0, atol=1e-12)
    np.testing.assert_allclose(ours.cov, theirs.cov, rtol=1e-12)
    np.testing.assert_allclose(landmark.jacobian(x, 1), function.jacobian(x, 1), atol=1e-12)
    differences = central_differences(
        lambda states: landmark.measurement(states, 1).mean, x, landmark.innovation
    )
    np.testing.assert_allclose(landmark.jacobian(x, 1), differences, atol=1e-8)
    assert measured_angle_rows(landmark) == measured_angle_rows(function)


def test_a_filter_may_have_further_components() -> None:
    landmark = Landmark(at=(8.0, 2.0), sigma_bearing_mrad=30.0).for_state(STATE)
    x = np.array([[0.0], [1.0], [0.3], [5.0]])
    assert landmark.jacobian(x, 1).shape == (1, 4, 1)
    assert landmark.jacobian(x, 1)[0, 3, 0] == 0.0


def test_the_heading_may_have_another_name_and_place() -> None:
    landmark = Landmark(at=(8.0, 2.0), sigma_bearing_mrad=30.0, heading="yaw")
    other = landmark.for_state(("yaw", "px", "v", "py"))
    own = Landmark(at=(8.0, 2.0), sigma_bearing_mrad=30.0).for_state(STATE)
    z = other.measurement(np.array([[0.3], [1.0], [9.0], [2.0]]), 1).mean
    np.testing.assert_array_equal(z, own.measurement(np.array([[1.0], [2.0], [0.3]]), 1).mean)


def test_states_without_a_position_or_a_heading_are_rejected() -> None:
    landmark = Landmark(at=(8.0, 2.0), sigma_range=0.1, sigma_bearing_mrad=30.0)
    with pytest.raises(InvalidKeyError, match=r"no component 'heading'.*the state is px, py, yaw"):
        landmark.for_state(("px", "py", "yaw"))
    with pytest.raises(InvalidKeyError, match=r"the state is x, heading: take `function`"):
        landmark.for_state(("x", "heading"))
    with pytest.raises(ValueError, match="sigma_range, sigma_bearing_mrad, or both"):
        Landmark(at=(8.0, 2.0))
