import numpy as np
import pytest

from trackbench.core.angles import wrap_angle
from trackbench.models.sensors.range_azimuth import RangeAzimuth

SENSOR = RangeAzimuth(sigma_range=0.2, sigma_azimuth_mrad=2.0)


def test_jacobian_against_central_differences(rng: np.random.Generator) -> None:
    x = 1e5 * rng.standard_normal((4, 50))
    H = SENSOR.jacobian(x, 0)
    for i in range(4):
        step = np.zeros((4, 1))
        step[i] = 0.5
        slope = SENSOR.innovation(SENSOR.polar(x + step), SENSOR.polar(x - step))
        np.testing.assert_allclose(H[:, i], slope, rtol=1e-4, atol=1e-9)


def test_angles_are_wrapped_to_the_half_open_turn() -> None:
    angle = np.array([0.0, np.pi, -np.pi, 3 * np.pi, -3 * np.pi, 2 * np.pi - 0.1, 7.0])
    expected = [0.0, np.pi, np.pi, np.pi, np.pi, -0.1, 7.0 - 2 * np.pi]
    np.testing.assert_allclose(wrap_angle(angle), expected, atol=1e-12)
    # Angles among which none is outside are left alone, to the last bit what wrapping gives.
    alone = np.concatenate([wrap_angle(angle[i : i + 1]) for i in range(len(angle))])
    np.testing.assert_array_equal(alone, wrap_angle(angle))
    assert np.isnan(wrap_angle(np.array([np.nan, 4.0]))).tolist() == [True, False]
    assert wrap_angle(np.empty(0)).shape == (0,)
    nu = SENSOR.innovation(np.array([[1.0], [3.1]]), np.array([[1.0], [-3.1]]))
    assert nu[1, 0] == pytest.approx(6.2 - 2 * np.pi)
