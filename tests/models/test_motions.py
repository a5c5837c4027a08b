"""The matrices of the motions, against the paper's print and against exact flight."""

import numpy as np
import pytest

from trackbench.help.descriptions import description
from trackbench.models.motions.coordinated_turn import CoordinatedTurn
from trackbench.models.motions.kinematic import (
    ConstantAcceleration,
    ConstantVelocity,
    PerAxis,
    WhiteAcceleration,
)
from trackbench.models.motions.map_or_ode import OdeMotion
from trackbench.models.sensors.position import PositionSensor


@pytest.mark.parametrize("motion", [ConstantVelocity(q=1.0), ConstantAcceleration(q=1.0)])
def test_matrices_beyond_the_numbers_are_no_warning(motion):
    assert not np.isfinite(motion.sampled(1e300).Q).all()


def test_printed_matrices_of_the_adaptive_kf_paper() -> None:
    T = 2.0
    cv = ConstantVelocity(q=3.0, noise_gain="printed").sampled(T)
    ca = ConstantAcceleration(q=3.0, noise_gain="printed").sampled(T)
    G = np.array([[T / 2, 0], [1, 0], [0, T / 2], [0, 1]])
    Gm = np.array([[T**2 / 4, 0], [T / 2, 0], [0, T**2 / 4], [0, T / 2], [1, 0], [0, 1]])
    Phi = np.eye(6)
    Phi[0, 1] = Phi[2, 3] = Phi[1, 4] = Phi[3, 5] = T
    Phi[0, 4] = Phi[2, 5] = T**2 / 2
    np.testing.assert_allclose(cv.F, Phi[:4, :4])
    np.testing.assert_allclose(cv.Q, 3.0 * G @ G.T)
    np.testing.assert_allclose(ca.F, Phi)
    np.testing.assert_allclose(ca.Q, 3.0 * Gm @ Gm.T)


def test_standard_gain_is_an_acceleration_held_for_one_step() -> None:
    """The disturbance column is what a unit acceleration does to a constant-velocity state."""
    T = 0.7
    ca = ConstantAcceleration(q=0.0).axis(T)
    cv = ConstantVelocity(q=1.0).axis(T)
    np.testing.assert_allclose(cv.Q, np.outer(ca.F[:2, 2], ca.F[:2, 2]))
    wiener = ConstantAcceleration(q=1.0).axis(T)
    np.testing.assert_allclose(wiener.Q, np.outer(ca.F[:, 2], ca.F[:, 2]))


def test_white_acceleration_is_the_limit_of_short_steps() -> None:
    """n steps of T/n with held accelerations of variance q n / T tend to the continuous noise."""
    T, n, q = 3.0, 4000, 0.4
    short = ConstantVelocity(q=q * n / T).axis(T / n)
    P = np.zeros((2, 2))
    for _ in range(n):
        P = short.F @ P @ short.F.T + short.Q
    np.testing.assert_allclose(P, WhiteAcceleration(q=q).axis(T).Q, rtol=1e-3)


def test_coordinated_turn_keeps_the_speed_and_closes_the_circle() -> None:
    motion = CoordinatedTurn(turn_rate_deg_s=3.0, q=0.0).sampled(1.0)
    x = start = np.array([10.0, 20.0, -5.0, 7.0])
    for k in range(120):
        x = motion.F @ x
        assert np.hypot(x[1], x[3]) == pytest.approx(np.hypot(20.0, 7.0))
        if k == 29:  # a quarter: x turns to y
            np.testing.assert_allclose(x[[1, 3]], [-7.0, 20.0], atol=1e-9)
    np.testing.assert_allclose(x, start, atol=1e-9)


def test_a_turn_of_no_rate_is_straight() -> None:
    still = CoordinatedTurn(turn_rate_deg_s=0.0, q=0.5).sampled(2.0)
    slow = CoordinatedTurn(turn_rate_deg_s=1e-6, q=0.5).sampled(2.0)
    np.testing.assert_allclose(still.F, ConstantVelocity(q=0.5).sampled(2.0).F)
    np.testing.assert_allclose(slow.F, still.F, atol=1e-7)


def test_position_sensor_sees_both_positions() -> None:
    sensor = PositionSensor(sigma=5.0)
    x = np.arange(6.0)[:, None]
    np.testing.assert_array_equal(sensor.measurement(x, 1).mean[:, 0], [0.0, 2.0])
    np.testing.assert_array_equal(sensor.jacobian(x, 1) @ x, sensor.measurement(x, 1).mean)
    np.testing.assert_array_equal(sensor.R, 25.0 * np.eye(2))


@pytest.mark.parametrize(
    "motion",
    [
        ConstantVelocity(q=2.0),
        ConstantAcceleration(q=2.0),
        WhiteAcceleration(q=2.0),
        CoordinatedTurn(q=2.0, turn_rate_deg_s=3.0),
    ],
)
def test_matrices_are_built_once_and_cannot_be_written(motion: PerAxis | CoordinatedTurn) -> None:
    first = motion.sampled(2.0)
    assert motion.sampled(2.0) is first
    assert motion.sampled(1.0).F[0, 1] != first.F[0, 1]
    for matrix in (first.F, first.Q, PositionSensor(sigma=2.0).R, PositionSensor(sigma=2.0).H()):
        with pytest.raises(ValueError, match="read-only"):
            matrix[0, 0] = 9.0


@pytest.mark.parametrize("substeps", [1, 5])
@pytest.mark.parametrize("T", [0.05, 2.0])
def test_noise_of_a_differential_equation_is_added_once_at_each_step(
    T: float, substeps: int
) -> None:
    ode = OdeMotion(components=("x",), derivative={"x": "-x"}, substeps=substeps, Q=0.01)
    transition = ode.sampled(T).transition(np.zeros(1), 1)
    assert transition.cov.tolist() == [[0.01]]
    assert "added once at each step, not multiplied by T" in description("ode")
