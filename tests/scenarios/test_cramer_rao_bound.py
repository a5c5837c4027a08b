"""The posterior Cramer-Rao bound against least squares, the Kalman filter and scalar programs."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.conftest import random_covariance
from tests.papers import banana
from trackbench.config.load import load
from trackbench.core import kalman
from trackbench.core.distributions import Gaussian
from trackbench.core.linalg import largest_deviation
from trackbench.errors import UserError
from trackbench.models.motions.kinematic import WhiteAcceleration
from trackbench.scenarios.cramer_rao_bound import posterior_cramer_rao


def test_bound_is_the_kalman_covariance_of_a_linear_problem(rng: np.random.Generator) -> None:
    motion, H, R = (
        WhiteAcceleration(q=0.3).sampled(0.5),
        rng.standard_normal((2, 4)),
        random_covariance(rng, 2),
    )
    P = random_covariance(rng, 4)
    information = [H.T @ np.linalg.inv(R) @ H] * 20
    bounds = posterior_cramer_rao(P, motion.F, motion.Q, information)
    state = Gaussian(np.zeros((4, 1)), P[..., None])
    for k in range(21):
        np.testing.assert_allclose(bounds[..., k], state.cov[..., 0], rtol=1e-7)
        predicted = kalman.predict(state, motion.F, motion.Q)
        state, _ = kalman.update(predicted, np.zeros((2, 1)), H, R)


def test_bound_without_process_noise_is_least_squares() -> None:
    """Without noise the bound is the inverse of the summed information, carried along."""
    scenario = banana(q=0.0, scans=30, range_km=100.0)
    x, F = scenario.target.path(scenario._timeline), scenario.model.motion.F
    R_inverse = np.diag([1 / 0.2**2, 1 / 2e-3**2])
    J = np.zeros((4, 4))
    for k in range(30):
        back = np.linalg.matrix_power(np.linalg.inv(F), 29 - k)
        H = scenario.model.sensor.jacobian(x[:, k], 0) @ back
        J += H.T @ R_inverse @ H
    exact = np.linalg.inv(J)
    bounds = scenario.bounds()
    assert bounds["position"][-1] == pytest.approx(np.sqrt(exact[0, 0] + exact[2, 2]), rel=1e-4)
    assert bounds["velocity"][-1] == pytest.approx(np.sqrt(exact[1, 1] + exact[3, 3]), rel=1e-4)


@pytest.mark.parametrize("n", [1, 2, 3])
def test_no_direction_deviates_by_more(n: int, rng: np.random.Generator) -> None:
    """Of one and two components it is the largest eigenvalue's root; of three it may be more."""
    A = rng.standard_normal((n, n))
    cov = A @ A.T
    largest = np.sqrt(np.linalg.eigvalsh(cov)[-1])
    if n < 3:
        assert largest_deviation(cov) == pytest.approx(largest)
    else:
        assert largest <= largest_deviation(cov) <= np.sqrt(3.0) * largest


CUBE = """scenario:
  kind: tracking
  last: 12
  target: {kind: driven, motion: {kind: ar1, phi: %s, q: %s}}
  sensor: {kind: function, h: {z: %s}, R: 0.5}
  start: {kind: gaussian, sigma: [%s]}
"""


def scenario_of(text: str, tmp_path: Path) -> Any:
    """The scenario of a config with a bound."""
    path = tmp_path / "bound.yaml"
    path.write_text(f"name: bound\n{text}bound: PCRLB\nfilters: {{PF: {{kind: pf}}}}\n")
    return load(path).points[0].scenario


def test_bound_of_a_driven_target_has_the_expected_information(tmp_path: Path) -> None:
    """z = x^3 / 10 of a normal x: E[h'^2] / R = 0.09 E[x^4] / R = 0.27 V^2 / R (Tichavsky, eq. 34)."""
    scenario = scenario_of(CUBE % (0.95, 1.0, "x**3/10", 1.0), tmp_path)
    V, P, expected = 1.0, 1.0, [1.0]
    for _ in range(12):
        V, predicted = 0.95**2 * V + 1.0, 0.95**2 * P + 1.0
        P = 1.0 / (1.0 / predicted + 0.27 * V * V / 0.5)
        expected.append(np.sqrt(P))
    (bound,) = scenario.bounds().values()
    without = np.array([next(iter(b.values())) for b in scenario.bounds_without_batch()])
    B = len(without)
    stderr = np.sqrt((B - 1) / B * ((without - without.mean(axis=0)) ** 2).sum(axis=0))
    assert bound[0] == 1.0
    assert (stderr[1:] < 0.05 * bound[1:]).all()
    # Ten batches leave the standard error a t distribution of nine degrees of freedom.
    assert (np.abs(bound - expected)[1:] < 5.0 * stderr[1:]).all()


def test_bound_of_one_information_is_not_simulated(tmp_path: Path) -> None:
    """A linear sensor has it along all paths, and without noise there is one path."""
    linear = scenario_of(CUBE % (0.95, 1.0, "2*x", 1.0), tmp_path)
    for scenario in (linear, banana(q=0.0, scans=30, range_km=100.0)):
        assert scenario.bounds()
        assert scenario.bounds_without_batch() == ()


ACCELERATED = """scenario:
  kind: tracking
  last: 15
  target: {kind: driven, motion: {kind: %s}}
  sensor: {kind: position, sigma: 2}
  start: {kind: gaussian, sigma: [3, 1, 3, 1]}
"""


@pytest.mark.parametrize("motion", ["ca, q: 0.1", "singer, tau: 8, sigma: 2"])
def test_the_bound_of_an_accelerated_target_is_the_kalman_covariance(
    tmp_path: Path, motion: str
) -> None:
    """The acceleration is no part of the truth, but of what a filter has to estimate."""
    scenario = scenario_of(ACCELERATED % motion, tmp_path)
    sampled = scenario.target.own_motion.sampled(1.0, 2)
    assert sampled.components[4:] == ("ax", "ay")
    P = np.diag([9.0, 1.0, 9.0, 1.0, *np.square(sampled.extra_std)])
    H = np.zeros((2, 6))
    H[0, 0] = H[1, 2] = 1.0
    expected = [np.sqrt(18.0)]
    for _ in range(15):
        P = sampled.F @ P @ sampled.F.T + sampled.Q
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + 4.0 * np.eye(2))
        P = P - K @ H @ P
        expected.append(np.sqrt(P[0, 0] + P[2, 2]))
    np.testing.assert_allclose(scenario.bounds()["position"], expected, rtol=1e-9)


def test_an_accelerated_target_seen_in_angles_has_about_the_bound_of_its_filter(
    tmp_path: Path,
) -> None:
    """Along drawn paths: far off, the information about the position hardly changes with the path."""
    sensor = "{kind: range-azimuth, sigma_range: 2, sigma_azimuth_mrad: 0.002, at: [-1e6, 0]}"
    text = (ACCELERATED % "ca, q: 0.1").replace("{kind: position, sigma: 2}", sensor)
    seen = scenario_of(text, tmp_path)
    assert len(seen.bounds_without_batch()) == 10
    linear = scenario_of(ACCELERATED % "ca, q: 0.1", tmp_path)
    np.testing.assert_allclose(seen.bounds()["position"], linear.bounds()["position"], rtol=1e-3)


def test_two_scans_of_an_accelerated_target_have_no_bound(tmp_path: Path) -> None:
    text = ACCELERATED % "ca, q: 0.1"
    with pytest.raises(UserError, match="depend on the target's acceleration"):
        scenario_of(text.replace("gaussian, sigma: [3, 1, 3, 1]", "two-scan"), tmp_path)


def test_a_first_state_that_is_not_drawn_from_the_prior_is_noted(tmp_path: Path) -> None:
    """The errors of a filter were a seventh below the bound, without a word."""
    drawn = scenario_of(ACCELERATED % "cwna, q: 1", tmp_path)
    assert drawn.bound_caution == ""
    given = "given, mean: [0, 0, 0, 0], sigma"
    fixed = scenario_of((ACCELERATED % "cwna, q: 1").replace("gaussian, sigma", given), tmp_path)
    assert "errors may be below the bound" in fixed.bound_caution


NEAR = """scenario:
  kind: tracking
  last: 40
  target: {kind: driven, motion: {kind: cwna, q: 1}, launch: {x: 400, y: %s, vx: -20, vy: 0}}
  sensor: {kind: range-azimuth, sigma_range: 50, sigma_azimuth_mrad: 5}
  start: {kind: gaussian, sigma: [30, 2, 30, 2]}
"""


def test_information_without_a_mean_is_noted(tmp_path: Path) -> None:
    """E[1 / r^2] is not finite if a target may pass over its radar; 100 km away it is."""
    near, far = (scenario_of(NEAR % y, tmp_path) for y in (0, 100_000))
    assert "10 of 10000 simulated paths carry" in near.bound_caution
    assert far.bound_caution == ""
    over = NEAR.replace("motion: {kind: cwna, q: 1}, ", "").replace("driven", "legs") % 0
    over += "  assume: {motion: {kind: cwna, q: 1}}\n"
    assert "at step 20 the path passes over a sensor" in scenario_of(over, tmp_path).bound_caution
    # The information x^4 of a normal x has a mean and a long tail.
    assert scenario_of(CUBE % (0.95, 1.0, "x**3/10", 1.0), tmp_path).bound_caution == ""
