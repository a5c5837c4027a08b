"""Motions with more than position and velocity, against closed forms and matrix exponentials."""

import numpy as np
import pytest
from scipy.linalg import expm

from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.core.random_streams import block_stream
from trackbench.models.augmented_priors import augment_prior
from trackbench.models.motions.coordinated_turn import CoordinatedTurn, UnknownTurn
from trackbench.models.motions.kinematic import ConstantAcceleration, ConstantVelocity
from trackbench.models.motions.singer import Singer
from trackbench.models.sensors.range_azimuth import RangeAzimuth
from trackbench.models.two_scan_prior import TwoPoint

STATES = np.array(
    [[100.0, 200.0, -50.0], [20.0, -3.0, 0.0], [5.0, 7.0, 9.0], [1.0, 8.0, -4.0], [0.1, -1e-9, 0.0]]
)


def van_loan(A: Array, density: Array, T: float) -> tuple[Array, Array]:
    """F and Q of dx = A x dt + dw over T seconds (Van Loan 1978)."""
    n = len(A)
    block = np.block([[-A, density], [np.zeros((n, n)), A.T]])
    phi = expm(block * T)
    F = phi[n:, n:].T
    return F, F @ phi[:n, n:]


@pytest.mark.parametrize("tau", [0.3, 2.0, 30.0])
@pytest.mark.parametrize("T", [0.1, 1.0, 5.0])
def test_singer_against_the_matrix_exponential(tau: float, T: float) -> None:
    axis = Singer(sigma=1.7, tau=tau).axis(T)
    A = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0 / tau]])
    F, Q = van_loan(A, np.diag([0.0, 0.0, 2.0 * 1.7**2 / tau]), T)
    np.testing.assert_allclose(axis.F, F, rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(axis.Q, Q, rtol=1e-6)  # the exponential has no more digits here


def test_singer_over_a_short_interval_keeps_its_digits() -> None:
    """To leading order the position's variance is 2 sigma^2 / tau T^5 / 20, times 1 - T / (2 tau) ..."""
    Q = Singer(sigma=1.0, tau=1e4).axis(1e-2).Q
    assert Q[0, 0] == pytest.approx(2e-4 * 1e-10 / 20 * (1 - 1e-6 * 5 / 6), rel=1e-10)


def test_unknown_turn_moves_as_a_known_one() -> None:
    w = 3.0
    known = CoordinatedTurn(turn_rate_deg_s=w, q=0.5).sampled(2.0)
    unknown = UnknownTurn(q=0.5, turn_walk_deg_s=1.0).sampled(2.0)
    x = STATES.copy()
    x[4] = np.deg2rad(w)
    moved = unknown.transition(x, 1)
    np.testing.assert_allclose(moved.mean[:4], known.F @ x[:4], rtol=1e-12)
    np.testing.assert_array_equal(moved.mean[4], x[4])
    np.testing.assert_array_equal(unknown.Q[:4, :4], known.Q)


@pytest.mark.parametrize("rate", [0.4, 0.049, 1e-3, 1e-7, 0.0])
def test_unknown_turns_jacobian_against_differences(rate: float) -> None:
    motion = UnknownTurn(q=0.5, turn_walk_deg_s=1.0).sampled(2.0)
    x = STATES.copy()
    x[4] = rate
    F = motion.jacobian(x, 1)
    for i in range(5):
        h = 1e-4 if i < 4 else 1e-5
        ahead, behind = x.copy(), x.copy()
        ahead[i] += h
        behind[i] -= h
        slope = (motion.transition(ahead, 1).mean - motion.transition(behind, 1).mean) / (2 * h)
        np.testing.assert_allclose(F[:, i], slope, rtol=1e-7, atol=1e-7)


def test_axes_and_names() -> None:
    space = ConstantAcceleration(q=1.0).sampled(1.0, axes=3)
    assert space.components == ("px", "vx", "py", "vy", "pz", "vz", "ax", "ay", "az")
    assert space.extra_std == (0.1, 0.1, 0.1)
    plane = ConstantAcceleration(q=1.0).sampled(1.0)
    np.testing.assert_array_equal(space.F[:4, :4], plane.F[:4, :4])
    np.testing.assert_array_equal(
        space.Q[np.ix_([4, 5, 8], [4, 5, 8])], plane.Q[np.ix_([0, 1, 4], [0, 1, 4])]
    )
    assert ConstantVelocity(q=1.0).sampled(1.0, axes=1).components == ("px", "vx")
    with pytest.raises(ValueError, match="in the plane"):
        UnknownTurn(q=0.5, turn_walk_deg_s=1.0).sampled(1.0, axes=3)


def test_extended_priors() -> None:
    runs = 6
    moments = Gaussian(np.ones((4, runs)), np.diag([4.0, 1.0, 4.0, 1.0]))
    assert augment_prior(moments, ()) is moments
    wide = augment_prior(moments, (0.5,))
    np.testing.assert_array_equal(wide.mean[4], 0.0)
    np.testing.assert_array_equal(np.diagonal(wide.cov), [4.0, 1.0, 4.0, 1.0, 0.25])
    radar = RangeAzimuth(sigma_range=10.0, sigma_azimuth_mrad=5.0)
    first = np.array([[5000.0], [0.3]]) * np.ones((2, runs))
    scans = TwoPoint(radar, first, first + np.array([[30.0], [0.01]]), 2.0, 0.1)
    wide = augment_prior(scans, (0.5,))
    x = wide.sample(block_stream(1, 0), 40_000)
    spread = np.array([np.cov(x[:, m]) for m in range(runs)])
    exact = np.moveaxis(wide.cov, -1, 0)
    scale = np.sqrt(np.einsum("mii,mjj->mij", exact, exact))
    assert np.abs((spread - exact) / scale).max() < 4.5 * np.sqrt(2 / 40_000)
    alone = scans.log_prob(x[:4]) - 0.5 * (x[4] / 0.5) ** 2 - np.log(0.5 * np.sqrt(2 * np.pi))
    np.testing.assert_allclose(wide.log_prob(x), alone, rtol=1e-9)
