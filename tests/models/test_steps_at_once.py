"""A sensor that does not move measures many steps in one call, with the bytes of single steps."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from trackbench.models.sensors.base import SensorBase
from trackbench.models.sensors.bearing import Bearing
from trackbench.models.sensors.landmark import Landmark
from trackbench.models.sensors.platform import Platform
from trackbench.models.sensors.position import PositionSensor
from trackbench.models.sensors.range_azimuth import RangeAzimuth
from trackbench.models.sensors.stacked import StackedSensor
from trackbench.models.sensors.steps_at_once import SensorOfSteps, is_equal_at_every_step
from trackbench.results.drawn_sensors_and_measurements import measured_positions

PATH = Platform(steps=(0, 9), x=(0.0, 90.0), y=(0.0, 0.0))
RADAR = RangeAzimuth(sigma_range=20.0, sigma_azimuth_mrad=5.0, at=(10.0, -3.0))
MOVING = RangeAzimuth(sigma_range=20.0, sigma_azimuth_mrad=5.0, platform=PATH)
LANDMARK = Landmark(at=(3.0, 4.0), sigma_range=0.1, state=("px", "vx", "py", "vy"))


class Drifting(RangeAzimuth):
    """A plugin's radar, whose range grows from step to step."""

    def measurement(self, x: Any, k: int) -> Any:
        measured = super().measurement(x, k)
        measured.mean[0] += k
        return measured


@pytest.mark.parametrize(
    ("sensor", "calls"),
    [
        (PositionSensor(sigma=2.0), 1),
        (Bearing(sigma_mrad=3.0), 1),
        (RADAR, 1),
        (LANDMARK, 1),
        (MOVING, 5),
        (Drifting(sigma_range=20.0, sigma_azimuth_mrad=5.0), 5),
        (StackedSensor((RADAR, MOVING)), 5),
    ],
)
def test_many_steps_are_measured_as_each_of_them(
    sensor: SensorBase, calls: int, monkeypatch: Any, rng: np.random.Generator
) -> None:
    assert is_equal_at_every_step(sensor) == (calls == 1)
    x = rng.normal(scale=100.0, size=(4, 9, 5 * 2))
    steps = range(3, 8)
    expected = [sensor.measurement(x[..., 2 * i : 2 * i + 2], k).mean for i, k in enumerate(steps)]
    many = SensorOfSteps(sensor, steps)
    measure = type(sensor).measurement
    called = []

    def count(self: Any, x: Any, k: int) -> Any:
        called.append(k)
        return measure(self, x, k)

    monkeypatch.setattr(type(sensor), "measurement", count)
    np.testing.assert_array_equal(many.measurement(x, 7).mean, np.concatenate(expected, axis=-1))
    assert len(called) == calls


@pytest.mark.parametrize("sensor", [RADAR, MOVING])
def test_measured_positions_are_those_of_each_step(
    sensor: RangeAzimuth, rng: np.random.Generator
) -> None:
    scenario: Any = SimpleNamespace(true_sensor=sensor, steps=np.arange(2, 8))
    z = rng.normal(loc=1.0, scale=0.1, size=(2, 5, 3))
    z[:, 1, 2] = np.nan
    positions = measured_positions(scenario, z)
    assert positions is not None
    for i, k in enumerate(range(3, 8)):
        np.testing.assert_array_equal(positions[:, i], sensor.located(z[:, i], k).mean)
