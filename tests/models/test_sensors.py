"""Every registered sensor: its Jacobian, its errors, and what is true of it that no filter is told."""

from typing import Any

import numpy as np
import pytest

from trackbench.core.arrays import Array
from trackbench.core.random_streams import RunStreams
from trackbench.field_types import InvalidKeyError
from trackbench.models.likelihood import log_likelihood
from trackbench.models.sensors.base import Outliers, SensorBase
from trackbench.models.sensors.bearing import Bearing
from trackbench.models.sensors.function import FunctionSensor
from trackbench.models.sensors.platform import Platform
from trackbench.models.sensors.position import PositionInSpace, PositionSensor, VelocitySensor
from trackbench.models.sensors.range import Range
from trackbench.models.sensors.range_azimuth import PolarPosition, RangeAzimuth, RangeAzimuthDoppler
from trackbench.models.sensors.range_azimuth_elevation import RangeAzimuthElevation
from trackbench.models.sensors.stacked import StackedSensor
from trackbench.registry import kinds

PATH = Platform(steps=(0, 10, 20), x=(0.0, 500.0, 0.0), y=(-200.0, 100.0, 300.0))
SENSORS: list[Any] = [
    PositionSensor(sigma=3.0),
    PositionInSpace(sigma=3.0),
    VelocitySensor(sigma=0.3),
    PolarPosition(sigma_range=5.0, sigma_azimuth_mrad=4.0),
    RangeAzimuth(sigma_range=5.0, sigma_azimuth_mrad=4.0, at=(100.0, -300.0)),
    RangeAzimuth(sigma_range=5.0, sigma_azimuth_mrad=4.0, platform=PATH),
    RangeAzimuthDoppler(sigma_range=5.0, sigma_azimuth_mrad=4.0, sigma_range_rate=0.3),
    Bearing(sigma_mrad=10.0, platform=PATH),
    Range(sigma=5.0, at=(100.0, -300.0)),
    RangeAzimuthElevation(
        sigma_range=5.0, sigma_azimuth_mrad=4.0, sigma_elevation_mrad=6.0, at=(10.0, 20.0, -30.0)
    ),
    StackedSensor(
        (Bearing(sigma_mrad=10.0), RangeAzimuth(sigma_range=5.0, sigma_azimuth_mrad=4.0))
    ),
]


def states(runs: int = 5) -> Array:
    rng = np.random.default_rng(3)
    x = rng.normal(0.0, 1500.0, (6, runs))
    x[1::2] *= 0.02
    return x


def named(sensor: Any) -> str:
    return type(sensor).__name__


@pytest.mark.parametrize("sensor", SENSORS, ids=named)
def test_jacobian_against_differences(sensor: Any) -> None:
    x = states()
    H = np.broadcast_to(np.atleast_3d(sensor.jacobian(x, 7)), (len(sensor.components), *x.shape))
    numeric = SensorBase.jacobian(sensor, x, 7)
    scale = np.abs(numeric).max()
    np.testing.assert_allclose(H, numeric, rtol=1e-6, atol=1e-8 * scale)


@pytest.mark.parametrize("sensor", SENSORS, ids=named)
def test_observed_has_the_moments_of_the_measurement(sensor: Any) -> None:
    runs = 4000
    x = np.repeat(states(1), runs, axis=1)
    rng = RunStreams(1, range(runs))
    n_z = len(sensor.components)
    z = sensor.measure(x, 3, rng.standard_normal((n_z, runs)), rng)
    seen = sensor.measurement(x, 3)
    nu = sensor.innovation(z, seen.mean)
    R = seen.cov if seen.cov.ndim == 2 else seen.cov[..., 0]
    sigma = np.sqrt(np.diagonal(R))
    assert np.abs(nu.mean(axis=1) / sigma).max() < 4.5 / np.sqrt(runs)
    # the standard error of a sample correlation is 1 / sqrt(runs), of a variance sqrt(2 / runs)
    assert np.abs((np.cov(nu) - R) / np.outer(sigma, sigma)).max() < 4.5 * np.sqrt(2 / runs)


def observed(sensor: SensorBase, runs: int = 20_000, k: int = 0, certain: bool = False) -> Array:
    rng = RunStreams(2, range(runs))
    noise = rng.standard_normal((len(sensor.components), runs))
    return sensor.measure(np.zeros((4, runs)), k, noise, rng, certain=certain)


def test_bias_and_outliers_are_of_the_measurements_alone() -> None:
    plain = PositionSensor(sigma=2.0)
    biased = PositionSensor(sigma=2.0, bias=(3.0, -1.0))
    np.testing.assert_allclose(
        observed(biased), observed(plain) + np.array([[3.0], [-1.0]]), rtol=1e-12, atol=1e-12
    )
    np.testing.assert_array_equal(biased.R, plain.R)
    spoilt = PositionSensor(sigma=2.0, outliers=Outliers(share=0.1, times=20.0))
    far = np.abs(observed(spoilt)).max(axis=0) > 12.0  # six deviations
    # a tenth has forty metres; both axes are hit together
    expected = 0.1 * (1.0 - 0.2358**2)  # P(|N(0, 1)| < 0.3) = 0.2358 on both axes
    assert abs(far.mean() - expected) < 4.5 * np.sqrt(expected / 20_000)


def test_students_t_has_its_tail() -> None:
    from scipy.stats import t

    tailed = PositionSensor(sigma=2.0, outliers=Outliers(degrees=3))
    z = observed(tailed)[0] / 2.0
    for edge in (1.0, 3.0, 6.0):
        expected = 2.0 * t.sf(edge, 3)
        assert abs((np.abs(z) > edge).mean() - expected) < 4.5 * np.sqrt(expected / 20_000)


def test_detection_period_and_offset() -> None:
    sensor = PositionSensor(sigma=2.0, detection=0.8, period=3, offset=1)
    seen = ~np.isnan(observed(sensor, k=4)).any(axis=0)
    assert abs(seen.mean() - 0.8) < 4.5 * np.sqrt(0.16 / 20_000)
    assert np.isnan(observed(sensor, runs=10, k=3)).all()
    assert not np.isnan(observed(sensor, runs=10, k=3, certain=True)).any()


def test_a_platform_moves_between_its_waypoints() -> None:
    assert PATH.place(-1) == (0.0, -200.0)
    assert PATH.place(5) == (250.0, -50.0)
    assert PATH.place(10) == (500.0, 100.0)
    assert PATH.place(99) == (0.0, 300.0)


def test_information_is_that_of_the_sensors_together() -> None:
    x = states(1)[:4, 0]
    one = RangeAzimuth(sigma_range=5.0, sigma_azimuth_mrad=4.0, detection=0.5)
    two = PositionSensor(sigma=30.0, period=2)
    both = StackedSensor((one, two))
    H, R = one.jacobian(x[:, None], 0)[..., 0], one.R
    np.testing.assert_allclose(
        one.information(x, 0, certain=True), H.T @ np.linalg.inv(R) @ H, rtol=1e-10
    )
    expected = 0.5 * H.T @ np.linalg.inv(R) @ H
    np.testing.assert_allclose(both.information(x, 1), expected, rtol=1e-10)
    expected[[0, 2], [0, 2]] += 1 / 900
    np.testing.assert_allclose(both.information(x, 2), expected, rtol=1e-10)


def test_a_missing_component_counts_for_nothing() -> None:
    both = StackedSensor((PositionSensor(sigma=3.0), Bearing(sigma_mrad=10.0)))
    x, z = states()[:4], np.array([[10.0], [20.0], [0.4]]) * np.ones((3, 5))
    z[2, 1], z[:2, 2], z[:, 3] = np.nan, np.nan, np.nan
    found = log_likelihood(both, z, x, 0)
    position, bearing = (
        log_likelihood(sensor, z[rows], x, 0)
        for sensor, rows in zip(both.sensors, both.rows, strict=True)
    )
    expected = [position[0] + bearing[0], position[1], bearing[2], 0.0, position[4] + bearing[4]]
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_half_a_scan_weighs_particles_by_the_other_half() -> None:
    """A radar tells a cloud's residuals its own way: a range without an azimuth, and the reverse."""
    radar = RangeAzimuth(sigma_range=10.0, sigma_azimuth_mrad=5.0)
    cloud = np.random.default_rng(1).normal(0.0, 20.0, (4, 3, 6))
    cloud[[0, 2]] += np.array([3000.0, 2000.0])[:, None, None]
    z = np.array([[3600.0, np.nan, np.nan], [np.nan, 0.58, np.nan]])
    r, a = radar.polar(cloud)
    sigma = radar.sigma_range, radar.sigma_azimuth
    expected = np.zeros((3, 6))
    for run, (off, s) in enumerate(((3600.0 - r[0], sigma[0]), (0.58 - a[1], sigma[1]))):
        expected[run] = -0.5 * np.square(off / s) - np.log(s * np.sqrt(2.0 * np.pi))
    np.testing.assert_allclose(log_likelihood(radar, z, cloud, 0), expected, rtol=1e-9)


def test_every_kind_is_tried_here() -> None:
    tried = {type(s) for s in SENSORS}
    scalar = {"scalar", "square-then-line"}
    others = {"function", "landmark"}  # in test_equations and test_landmark
    assert {cls for kind, cls in kinds("sensors").items() if kind not in scalar | others} <= tried


@pytest.mark.parametrize(
    ("h", "angles"),
    [
        ("atan2(py, px)", ("a",)),
        ("-atan2(py, px)", ("a",)),
        ("pi/2 - atan2(py, px)", ("a",)),
        ("atan2(py - 3, px) - vx/9", ("a",)),
        ("atan2(py, sqrt(px**2 + vx**2))", ()),
        ("180/pi*atan2(py, sqrt(px**2 + vx**2))", ()),
        ("3*atan2(px, 2)", ()),
        ("sin(atan2(py, px))", ()),
        ("px + py", ()),
    ],
)
def test_an_outermost_atan2_is_an_angle(h: str, angles: tuple[str, ...]) -> None:
    """The innovation across the cut is that of the wrapped difference, unless `angles` is empty."""
    names = ("px", "vx", "py", "vy")
    sensor = FunctionSensor(h={"a": h}, R=1e-4).for_state(names)
    assert sensor.angles == angles
    z, z_pred = np.array([[3.1, 0.2]]), np.array([[-3.1, 0.1]])
    wrapped = 6.2 - 2.0 * np.pi if angles else 6.2
    np.testing.assert_allclose(sensor.innovation(z, z_pred), [[wrapped, 0.1]], atol=1e-14)
    plain = FunctionSensor(h={"a": h}, R=1e-4, angles=()).for_state(names)
    np.testing.assert_array_equal(plain.innovation(z, z_pred), z - z_pred)


@pytest.mark.parametrize("h", ["atan2(py, px)*180/pi", "1e3*atan2(py, px)", "5 - atan2(py, px)/pi"])
def test_an_angle_in_another_unit_is_rejected_with_the_key_to_write(h: str) -> None:
    names = ("px", "vx", "py", "vy")
    with pytest.raises(InvalidKeyError, match=r"only angles in rad wrap.*`angles: \[\]`") as raised:
        FunctionSensor(h={"a": h}, R=1e-4).for_state(names)
    assert raised.value.path == ("h", "a")
    assert FunctionSensor(h={"a": h}, R=1e-4, angles=()).for_state(names).angles == ()
