"""Filters by draws and by splits on a linear model, where the Kalman filter is exact."""

from itertools import product
from typing import Any

import numpy as np
import pytest

from tests.conftest import make_filter
from tests.papers import merwe, seen_as
from trackbench.core.distributions import Gaussian
from trackbench.core.random_streams import RunStreams, block_stream
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.run_filter import run_filter
from trackbench.evaluation.simulated_runs import simulate
from trackbench.filters.ensemble_base import Ensemble
from trackbench.filters.kf import KF
from trackbench.filters.multiple_model_pf import _spreads
from trackbench.filters.particle_flow import _step_lengths
from trackbench.filters.ukf import CKF
from trackbench.models.base import Model
from trackbench.models.motions.coordinated_turn import UnknownTurn
from trackbench.models.motions.kinematic import WhiteAcceleration
from trackbench.models.motions.map_or_ode import MapMotion
from trackbench.models.sensors.function import FunctionSensor
from trackbench.models.sensors.position import PositionSensor
from trackbench.models.sensors.range_azimuth import RangeAzimuth
from trackbench.scenarios.starts.gaussian import GaussianStart
from trackbench.scenarios.targets.driven import Driven
from trackbench.scenarios.targets.initial_state import Launch
from trackbench.scenarios.tracking import Tracking

SLOW, QUICK = WhiteAcceleration(q=0.5), WhiteAcceleration(q=40.0)
TARGET = Driven(motion=SLOW, launch=Launch(x=900.0, y=700.0, vx=-5.0, vy=4.0))
START = GaussianStart(sigma=(60.0, 4.0, 60.0, 4.0))
SENSOR = PositionSensor(sigma=20.0, detection=0.7)
LINEAR = Tracking(target=TARGET, sensor=SENSOR, start=START, last=8)
RADAR = RangeAzimuth(sigma_range=5.0, sigma_azimuth_mrad=4.0)
RUNS, N = 40, 1000


def followed(scenario: Tracking, tracker: Any, runs: int) -> tuple[np.ndarray, np.ndarray]:
    """Means (n, K, M) and covariances (n, n, K, M) of the steps after the first state."""
    task = BlockTask(scenario, tracker, seed=1, index=0, width=runs, runs_used=runs)
    got = run_filter(task, simulate(scenario, 1, 0, runs), covariances=runs)
    assert got.cov is not None
    return got.mean[:, 1:], got.cov[:, :, 1:]


def in_deviations(kind: str, **keys: Any) -> tuple[np.ndarray, np.ndarray]:
    """Errors (n, K, M) of the mean, in posterior deviations, and ratios of the variances."""
    exact, cov = followed(LINEAR, KF(), RUNS)
    mean, other = followed(LINEAR, make_filter(kind, **keys), RUNS)
    variance = np.einsum("iikm->ikm", cov)
    return (mean - exact) / np.sqrt(variance), np.einsum("iikm->ikm", other) / variance


@pytest.mark.parametrize(
    ("kind", "keys", "spread"),
    [
        ("enkf", {"N": N}, 2.0),  # draws, perturbed, and the gain's error
        ("gpf", {"N": N}, 8.0),  # a fifth of N draws is effective, and later steps remember
        ("edh", {"N": N, "steps": 200}, 2.0),
    ],
)
def test_draws_tell_what_the_kalman_filter_knows(
    kind: str, keys: dict[str, Any], spread: float
) -> None:
    errors, ratios = in_deviations(kind, **keys)
    assert np.sqrt(np.mean(errors**2)) < spread / np.sqrt(N)
    of_runs = errors.mean(axis=2) / errors.std(axis=2, ddof=1) * np.sqrt(RUNS)
    assert np.abs(of_runs).max() < 5.0  # 32 means of 40 errors each, none biased
    assert np.abs(ratios.mean() - 1.0) < 3.0 * spread / np.sqrt(N)


def test_a_gaussian_that_is_split_is_the_same_gaussian() -> None:
    errors, ratios = in_deviations("gaussian-sum", split=15, kept=300, merge_within=0.0)
    assert np.abs(errors).max() < 0.01
    assert np.abs(ratios - 1.0).max() < 0.01


def test_a_line_through_the_posterior_is_the_line() -> None:
    errors, ratios = in_deviations("iplf")
    assert np.abs(errors).max() < 1e-9
    assert np.abs(ratios - 1.0).max() < 1e-9


def test_the_first_line_is_the_cubature_filter() -> None:
    scenario = Tracking(target=TARGET, sensor=RADAR, start=START, last=8)
    one, cubature = (followed(scenario, f, 5) for f in (make_filter("iplf", iterations=1), CKF()))
    for a, b in zip(one, cubature, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-7)


def test_the_next_lines_are_the_papers() -> None:
    """Garcia-Fernandez et al. 2015, algorithm 1, of a scalar: three points, no matrix."""
    model, z, over = merwe().model, 2.4, (1.5, 0.6)
    predicted_mean, predicted_var = over
    m, P = over
    R = float(model.sensor.measurement(np.array([[m]]), 5).cov[0, 0])

    def h(x: float) -> float:
        return float(model.sensor.measurement(np.array([[x]]), 5).mean[0, 0])

    for _ in range(4):
        points = [m - P**0.5, m + P**0.5]  # the cubature rule in one dimension
        seen = [h(x) for x in points]
        at = sum(seen) / 2
        slope = sum((x - m) * (y - at) for x, y in zip(points, seen, strict=True)) / 2 / P
        rest = sum((y - at) ** 2 for y in seen) / 2 - slope * slope * P
        S = slope * slope * predicted_var + R + rest
        gain = predicted_var * slope / S
        m, P = (
            predicted_mean + gain * (z - at - slope * (predicted_mean - m)),
            predicted_var - gain * gain * S,
        )

    class Still:
        """A motion that leaves the state where it is."""

        components = model.motion.components

        def transition(self, x: np.ndarray, k: int) -> Gaussian:
            return Gaussian(x, np.zeros((1, 1)))

    tracker = make_filter("iplf", iterations=4)
    state = Gaussian(np.array([[over[0]]]), np.array([[[over[1]]]]))
    got, _ = tracker.update(Model(Still(), model.sensor), state, np.array([[z]]), 5)
    np.testing.assert_allclose([got.mean.item(), got.cov.item()], [m, P], rtol=1e-10)


def exact_jumps(z: np.ndarray, start: tuple[np.ndarray, np.ndarray], T: np.ndarray) -> Any:
    """Mean and covariance of a jump Markov linear model by all sequences of its motions."""
    motions, H, R = [m.sampled(1.0) for m in (SLOW, QUICK)], np.eye(4)[[0, 2]], 400.0 * np.eye(2)
    ends = []
    for sequence in product(range(2), repeat=z.shape[1]):
        m, P = start
        log_w = np.log(0.5)  # of the motion that is followed at the start
        before = None
        for k, j in enumerate(sequence):
            log_w += np.log(0.5 * T[0, j] + 0.5 * T[1, j] if before is None else T[before, j])
            log_w -= np.log(0.5) if before is None else 0.0
            before = j
            F, Q = motions[j].F, motions[j].Q
            m, P = F @ m, F @ P @ F.T + Q
            if np.isfinite(z[0, k]):
                S, nu = H @ P @ H.T + R, z[:, k] - H @ m
                K = P @ H.T @ np.linalg.inv(S)
                log_w -= 0.5 * (nu @ np.linalg.solve(S, nu) + np.log(np.linalg.det(S)))
                m, P = m + K @ nu, P - K @ S @ K.T
        ends.append((log_w, m, P))
    w = np.exp([e[0] for e in ends] - np.max([e[0] for e in ends]))
    w /= w.sum()
    mean = sum(a * e[1] for a, e in zip(w, ends, strict=True))
    cov = sum(a * (e[2] + np.outer(e[1] - mean, e[1] - mean)) for a, e in zip(w, ends, strict=True))
    return mean, cov


def test_particles_that_jump_know_all_sequences_of_motions() -> None:
    scenario = Tracking(target=TARGET, sensor=SENSOR, start=START, last=5)
    T = np.array([[0.8, 0.2], [0.3, 0.7]])
    tracker = make_filter(
        "mmpf", N=20000, motions=(SLOW, QUICK), transition=tuple(map(tuple, T)), bandwidth_scale=0.0
    )
    got, covs = followed(scenario, tracker, 8)
    data = simulate(scenario, 1, 0, 8)
    for run in range(8):
        prior = data.prior.mean[:, run], data.prior.cov.reshape(4, 4, -1)[..., 0]
        mean, cov = exact_jumps(data.measurements[:, :, run], prior, T)
        sd = np.sqrt(np.diag(cov))
        # A mean of some 20000 / 10 effective draws, eight runs of four components: five deviations.
        assert np.abs((got[:, -1, run] - mean) / sd).max() < 5.0 / np.sqrt(2000)
        assert np.abs(np.diag(covs[..., -1, run]) / sd**2 - 1.0).max() < 5.0 * np.sqrt(2 / 2000)


def test_a_particle_enters_a_motion_with_what_is_unknown_there() -> None:
    turning = UnknownTurn(q=0.1, turn_walk_deg_s=1e-6, initial_std_deg_s=2.0)
    tracker = make_filter(
        "mmpf",
        N=5000,
        motions=(SLOW, turning),
        transition=((0, 1), (0, 1)),
        initial=(1, 0),
        bandwidth_scale=0.0,
    )
    data, rng = LINEAR.simulate(RunStreams(1, range(4)), 4), np.random.Generator(np.random.SFC64(1))
    state = tracker.init(LINEAR.model, data.prior, rng)
    assert (state.particles.x[4] == 0.0).all()  # in the first motion there is no rate
    unseen = np.full((2, 4), np.nan)
    turned = tracker.step(LINEAR.model, state, unseen, 1, rng)
    rates = np.rad2deg(turned.particles.x[4])
    np.testing.assert_allclose(rates.std(axis=1), 2.0, rtol=5.0 / np.sqrt(2 * 5000))
    later = np.rad2deg(tracker.step(LINEAR.model, turned, unseen, 2, rng).particles.x[4])
    np.testing.assert_allclose(np.sort(later), np.sort(rates), atol=1e-4)


def test_each_motion_has_the_weight_and_covariance_of_its_particles(
    rng: np.random.Generator,
) -> None:
    x, w, mode = rng.standard_normal((4, 1, 9)), np.arange(9.0)[None] / 36.0, np.arange(9)[None] % 2
    models = [Model(m.sampled(1.0), SENSOR) for m in (SLOW, QUICK)]
    for j, found in enumerate(_spreads(models, x, mode, w)):
        weights = w[0, mode[0] == j]
        np.testing.assert_allclose(found.share, weights.sum())
        expected = np.cov(x[:, 0, mode[0] == j], aweights=weights, ddof=0)
        np.testing.assert_allclose(found.cov[..., 0], expected)


def test_a_split_start_may_have_more_components_than_the_target() -> None:
    scenario = Tracking(target=TARGET, sensor=RADAR, start=START, last=8)
    seen = seen_as(scenario, UnknownTurn(q=0.5, turn_walk_deg_s=0.1))
    split, _ = followed(seen, make_filter("gaussian-sum", split=9), 20)
    whole, cov = followed(seen, CKF(), 20)
    errors = (split - whole)[[0, 2]] / np.sqrt(np.einsum("iikm->ikm", cov)[[0, 2]])
    assert np.sqrt(np.mean(errors**2)) < 0.3


@pytest.mark.parametrize("steps", [1, 3, 29])
def test_the_steps_of_a_flow_grow_by_a_fifth_and_fill_its_time(steps: int) -> None:
    """Li & Coates 2017, section V: pseudo-time runs from zero to one."""
    lengths = np.array(_step_lengths(steps))
    assert lengths.sum() == pytest.approx(1.0)
    np.testing.assert_allclose(lengths[1:] / lengths[:-1], 1.2)


def stepped(x: np.ndarray, z: float, R: float, **keys: Any) -> np.ndarray:
    """Members (M, N) of a scalar that stays, after one measurement of it."""
    still = MapMotion(components=("x",), next={"x": "x"}, Q=0.0).sampled(1.0)
    model = Model(still, FunctionSensor(h={"z": "x"}, R=R, state=("x",)))
    runs, N = x.shape
    tracker = make_filter("enkf", N=N, **keys)
    state = Ensemble(x[None], np.full(runs, np.nan))
    return np.asarray(tracker.step(model, state, np.full((1, runs), z), 1, block_stream(1, 0)).x[0])


@pytest.mark.parametrize("N", [2, 5])
@pytest.mark.parametrize("centered", [False, True])
def test_centered_errors_help_a_small_ensemble(centered: bool, N: int) -> None:
    """Each drawn error has the variance R, and their mean, which adds R / N to the estimate's, none.

    They are found again from x + K (z + e - x), K = P / (P + R), P with divisor N - 1.
    """
    runs, z, R = 20_000, 1.5, 4.0
    x = np.random.default_rng(3).standard_normal((runs, N))
    K = 1.0 / (1.0 + R / x.var(axis=1, ddof=1))[:, None]
    e = (stepped(x, z, R, centered=centered) - x) / K - z + x
    of_runs = np.square(e).mean(axis=1)
    assert abs(of_runs.mean() - R) < 4.5 * of_runs.std() / np.sqrt(runs)
    of_means = np.square(e.mean(axis=1))
    assert (
        abs(of_means.mean() - R / N * (not centered)) < 4.5 * of_means.std() / np.sqrt(runs) + 1e-9
    )


@pytest.mark.parametrize("keys", [{}, {"centered": True}, {"form": "etkf"}])
def test_inflation_is_a_factor_on_the_deviations_after_the_update(keys: dict[str, Any]) -> None:
    x = np.random.default_rng(4).standard_normal((3, 6))
    plain, wide = (stepped(x, 1.0, 2.0, inflation=a, **keys) for a in (1.0, 1.3))
    mean = plain.mean(axis=1, keepdims=True)
    np.testing.assert_allclose(wide, mean + 1.3 * (plain - mean), rtol=1e-12)
