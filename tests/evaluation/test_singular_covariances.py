"""NEES of singular covariances: the distance in their range, of as many degrees as their rank."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.conftest import track
from trackbench.core.singular_nees import component_size, distance_in_range
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.exact_errors import exact_series, why_not_exact
from trackbench.evaluation.per_run_metrics import over_windows
from trackbench.evaluation.run_blocks_side_by_side import run_block
from trackbench.filters.gauss_hermite_filter import GHKF
from trackbench.filters.imm import IMM
from trackbench.filters.iplf import IPLF
from trackbench.filters.kf import KF
from trackbench.filters.ukf import CKF, UKF
from trackbench.models.assume import Assume
from trackbench.models.motions.kinematic import WhiteAcceleration
from trackbench.models.motions.map_or_ode import MapMotion
from trackbench.models.sensors.function import FunctionSensor
from trackbench.models.sensors.position import PositionSensor
from trackbench.scenarios.starts.gaussian import GaussianStart
from trackbench.scenarios.targets.driven import Driven
from trackbench.scenarios.tracking import Tracking

RUNS = 400
KNOWN_VELOCITY = Tracking(
    target=Driven(motion=WhiteAcceleration(q=1.0)),
    sensor=PositionSensor(sigma=10.0),
    start=GaussianStart(sigma=(10.0, 0.0, 10.0, 0.0)),
    last=20,
)
F, Q = np.array([[0.9, 0.1, 0.0], [-0.2, 0.8, 0.1], [0.0, 0.1, 0.7]]), np.diag([0.1, 0.2, 0.3])
H, R = np.array([[1.0, 0.5, -0.3], [-0.4, 1.0, 0.6]]), np.full((2, 2), 0.2)
NAMES = ("a", "b", "c")


def _terms(rows: Any, names: tuple[str, ...]) -> dict[str, str]:
    return {
        name: " + ".join(f"({c})*{x}" for c, x in zip(row, NAMES, strict=True))
        for name, row in zip(names, rows.tolist(), strict=True)
    }


def _motion(F: Any) -> MapMotion:
    return MapMotion(components=NAMES, next=_terms(F, NAMES), Q=(0.1, 0.2, 0.3))


SINGULAR_R = Tracking(
    target=Driven(motion=_motion(F), initial={}),
    sensor=FunctionSensor(h=_terms(H, ("u", "v")), R=((0.2, 0.2), (0.2, 0.2))),
    start=GaussianStart(sigma=(1.0, 2.0, 0.5)),
    last=15,
)


EXACT_SUM = Tracking(  # b + c is measured without noise; c of the prior is known
    target=Driven(
        motion=MapMotion(
            components=NAMES,
            next={"a": "a + b", "b": "0.9*b + 0.1*c", "c": "0.8*c"},
            Q=(0.0, 0.3, 0.2),
        ),
        initial={"a": 1.0, "b": 2.0, "c": 3.0},
    ),
    sensor=FunctionSensor(h={"u": "a", "v": "b + c"}, R=((1.0, 0.0), (0.0, 0.0))),
    start=GaussianStart(sigma=(1.0, 2.0, 0.0)),
    last=20,
)


@pytest.mark.parametrize(
    "tracker",
    [KF(), UKF(), UKF(noise="additive"), CKF(), GHKF(), IPLF(), IPLF(form="square-root")],
)
def test_an_exact_sum_of_components(tracker: Any) -> None:
    """Variances of a from a scalar recursion: b + c is known, so the error of c is that of -b."""
    aa, ab, bb, expected = 1.0, 0.0, 4.0, [1.0]
    for error_of_c in [0.0] + [-1.0] * 19:  # per error of b; of the prior c is known
        of_b, of_c = 0.9 + 0.1 * error_of_c, 0.8 * error_of_c
        # predict a, b and c
        A, AB, AC = aa + 2 * ab + bb, of_b * (ab + bb), of_c * (ab + bb)
        B, BC, C = of_b**2 * bb + 0.3, of_b * of_c * bb, of_c**2 * bb + 0.2
        # measure v = b + c without noise, then a with variance 1
        AV, BV, V = AB + AC, B + BC, B + 2 * BC + C
        A, AB, B = A - AV * AV / V, AB - AV * BV / V, B - BV * BV / V
        aa, ab, bb = A - A * A / (A + 1), AB - A * AB / (A + 1), B - AB * AB / (A + 1)
        expected.append(aa)
    output = track(EXACT_SUM, tracker, RUNS, covariances=1)
    assert output.cov is not None
    np.testing.assert_allclose(output.cov[0, 0, :, 0], expected, rtol=1e-6)
    # NEES of rank 2: five standard errors
    nees = output.nees.mean(axis=1) / 3.0
    np.testing.assert_allclose(nees, 1.0, rtol=0, atol=5.0 * np.sqrt(1.0 / RUNS))


def _measuring(h: dict[str, str], R: Any) -> Tracking:
    return replace(EXACT_SUM, sensor=FunctionSensor(h=h, R=R))


def test_a_redundant_component_is_refused_by_name() -> None:
    """S of u, v and u + v has no inverse if the third noise is the sum of the others as well."""
    h = {"u": "1000*a", "v": "b + c", "w": "1000*a + b + c"}
    redundant = _measuring(h, ((1.0, 0.0, 1.0), (0.0, 0.0, 0.0), (1.0, 0.0, 1.0)))
    assert "`w` is a combination" in KF().conflicts(redundant)[""]
    same = MapMotion(components=NAMES, next={x: x for x in NAMES}, Q=(0.1, 0.2, 0.3))
    imm = IMM(motions=(same, same), transition=((0.9, 0.1), (0.1, 0.9)))
    assert "singular" in imm.conflicts(redundant)["filter"]
    assert (
        why_not_exact(BlockTask(redundant, KF(), 1, 0, 1, 1)) == "its estimates leave the numbers"
    )
    # Any noise of its own, however small, makes the component one more measurement.
    for R in ((1.0, 0.0, 1e-16), (1e-16, 1e-16, 1e-16)):
        assert KF().conflicts(_measuring(h, R)) == {}


@pytest.mark.filterwarnings("error")
def test_a_series_without_values_has_no_mean() -> None:
    means = over_windows({"squared_a": np.full((3, 2), np.nan)}, {"": np.ones(3, bool)}, ())
    assert np.isnan(means["rmse_a"]).all()


@pytest.mark.parametrize("tracker", [KF(), UKF()])
def test_a_known_velocity_has_no_part_in_the_nees(tracker: Any) -> None:
    found = track(KNOWN_VELOCITY, tracker, RUNS)
    # chi-square of 2 M degrees at the first step, of 4 M at others: five standard errors
    for k, n in ((0, 2), (1, 4), (20, 4)):
        assert abs(found.nees[k].mean() / 4.0 - 1.0) < 5.0 * np.sqrt(2.0 / (n * RUNS))
    assert (found.diagnostics["unused_nees"][0] == 2.0).all()
    assert not found.diagnostics["unused_nees"][1:].any()


@pytest.mark.parametrize("of_model", [1.0, 0.8])
def test_a_measurement_without_noise_leaves_one_degree_less(of_model: float) -> None:
    """The mean NEES is the trace of ``P^+ E[e e']``, by the Moore-Penrose inverse."""
    A = of_model * F
    task = BlockTask(SINGULAR_R, KF(), 1, 0, RUNS, RUNS, assume=Assume(motion=_motion(A)))
    values = exact_series(task)["nees"]
    P, joint = np.diag([1.0, 4.0, 0.25]), np.zeros((6, 6))
    joint[:3, :3] = P
    for nees in values[1:]:
        predicted = A @ P @ A.T + Q
        K = predicted @ H.T @ np.linalg.inv(H @ predicted @ H.T + R)
        rest = np.eye(3) - K @ H
        P = rest @ predicted @ rest.T + K @ R @ K.T
        move = np.block([[F, np.zeros((3, 3))], [K @ H @ F, rest @ A]])
        noise, seen = np.vstack([np.eye(3), K @ H]), np.vstack([np.zeros((3, 2)), K])
        joint = move @ joint @ move.T + noise @ Q @ noise.T + seen @ R @ seen.T
        error = np.hstack([-np.eye(3), np.eye(3)])
        square = error @ joint @ error.T
        expected = np.trace(np.linalg.pinv(P, rcond=1e-10, hermitian=True) @ square)
        assert nees / 3.0 == pytest.approx(expected / 2.0, rel=1e-8)


def test_the_runs_agree_with_the_exact_mean() -> None:
    task = BlockTask(SINGULAR_R, KF(), 1, 0, RUNS, RUNS)
    result = run_block(task)
    nees = result.per_run["nees"] / 3.0
    assert np.isfinite(nees).all()
    assert abs(nees.mean() - 1.0) < 5.0 * nees.std() / np.sqrt(RUNS)
    assert result.steps["unused_nees"].total[-1] == RUNS
    # outside a region that one in a million steps leaves
    assert result.per_run["outside_region"].mean() < 1e-3


def test_an_error_outside_the_range_is_infinite() -> None:
    P = np.array([[4.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 0.0]])
    errors = np.array([[2.0, 1.0, 0.0], [2.0, 1.1, 0.0], [0.0, 0.0, 1e-3], [0.0, 0.0, 1e-13]]).T
    squared, rank = distance_in_range(errors, P, np.ones((3, 4)))
    np.testing.assert_array_equal(squared, [1.0, np.inf, np.inf, 0.0])
    assert rank is not None
    np.testing.assert_array_equal(rank, [1, 3, 3, 1])


@pytest.mark.parametrize("variance", [0.0, 1e-26])
@pytest.mark.parametrize(
    ("truth", "estimate", "expected"),
    [
        (50.0, 49.0, np.inf),
        (0.0, 50.0, np.inf),  # beside a truth of zero the estimate tells what is rounding
        (50.0, 50.0 - 1e-11, 0.0),
        (50.0, np.nan, np.nan),
    ],
)
def test_equal_particles_have_no_spread_but_rounding(
    truth: float, estimate: float, expected: float, variance: float
) -> None:
    """Particles that are all equal have a variance of 0 or, by rounding of their mean, of some 1e-26."""
    x = np.array([[truth]])
    mean = np.array([[estimate]])
    squared, _ = distance_in_range(mean - x, np.array([[variance]]), component_size(x, mean))
    np.testing.assert_array_equal(squared, expected)


def test_a_regular_covariance_has_full_rank() -> None:
    P = np.diag([1e-10, 1.0, 1e10])
    squared, rank = distance_in_range(np.array([[1e-5], [1.0], [1e5]]), P, np.ones((3, 1)))
    assert rank is None
    assert squared == pytest.approx(3.0)
