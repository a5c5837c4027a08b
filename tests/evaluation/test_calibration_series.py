"""Where the truth is in what a filter says: the exact one is calibrated, a too certain one is not."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.special import digamma
from scipy.stats import chi2, norm

from tests.conftest import make_filter, track
from tests.linear_problem import LINEAR
from tests.papers import merwe
from trackbench.core.arrays import Array
from trackbench.evaluation.block_task import BlockTask, Kind
from trackbench.evaluation.calibration_series import LEVELS, bars
from trackbench.evaluation.likelihood_ratio import likelihood_ratio
from trackbench.evaluation.noncredibility import noncredibility
from trackbench.evaluation.run_blocks_side_by_side import run_block
from trackbench.evaluation.uniformity_tests import at_step, over_steps
from trackbench.filters.base import AnyFilter
from trackbench.models.assume import Assume
from trackbench.models.motions.kinematic import WhiteAcceleration
from trackbench.scenarios.tracking import Tracking
from trackbench.statistics.sample_statistics import mean

ALL: tuple[Kind, ...] = ("calibration", "ranks", "crps")
RUNS = 2000
TENTH_OF_Q = Assume(motion=WhiteAcceleration(q=0.1))


def series(scenario: Tracking, tracker: AnyFilter, runs: int, **keys: object) -> dict[str, Array]:
    return track(scenario, tracker, runs, predictive_metrics=ALL, **keys).diagnostics


@cache
def kalman(seed: int, assume: Assume | None = None) -> dict[str, Array]:
    """The Kalman filter, of 2000 runs that start where its prior says."""
    return series(LINEAR, make_filter("kf"), RUNS, seed=seed, assume=assume)


def shares(found: dict[str, Array], quantity: str) -> Array:
    return np.stack([found[bar][1:].mean(axis=0) for bar in bars(quantity)])


def test_of_a_gaussian_by_its_estimate() -> None:
    found = track(LINEAR, make_filter("kf"), 20, covariances=20, predictive_metrics=ALL)
    plain = track(LINEAR, make_filter("kf"), 20)
    assert np.array_equal(found.mean, plain.mean)
    said = found.diagnostics
    np.testing.assert_allclose(said["pit_nees"], chi2.cdf(found.nees, 4), atol=1e-12)
    for p in LEVELS:
        within = found.nees <= chi2.ppf(p / 100, 4)
        np.testing.assert_array_equal(said[f"coverage_{p}"], within)
    assert found.cov is not None
    truth = _truth(20)
    z = (truth[1] - found.mean[1]) / np.sqrt(found.cov[1, 1])
    np.testing.assert_allclose(said["pit_vx"], norm.cdf(z), atol=1e-12)
    np.testing.assert_array_equal(
        sum(b * said[bar] for b, bar in enumerate(bars("vx"))), np.floor(10 * norm.cdf(z))
    )


def _truth(runs: int) -> Array:
    task = BlockTask(LINEAR, make_filter("kf"), 1, 0, runs, runs, runs_with_tracks=runs)
    tracks = run_block(task).tracks
    assert tracks is not None
    return tracks.truth


@pytest.mark.parametrize("seed", [1, 2])
def test_the_kalman_filter_is_calibrated_and_with_a_tenth_of_q_it_is_not(seed: int) -> None:
    for quantity in ("px", "vx", "py", "vy", "nees"):
        right, wrong = kalman(seed), kalman(seed, TENTH_OF_Q)
        last = at_step(right[f"pit_{quantity}"][-1])
        assert min(last.p, last.p_distance, over_steps(shares(right, quantity)).p) > 1e-3
        last = at_step(wrong[f"pit_{quantity}"][-1])
        assert max(last.p, last.p_distance, over_steps(shares(wrong, quantity)).p) < 1e-6


@pytest.mark.parametrize("level", LEVELS)
def test_coverage_is_its_level(level: int) -> None:
    right = kalman(1)[f"coverage_{level}"].mean(axis=0)
    assert abs(right.mean() - level / 100) < 4 * right.std() / np.sqrt(RUNS)
    wrong = kalman(1, TENTH_OF_Q)[f"coverage_{level}"].mean(axis=0)
    assert wrong.mean() < level / 100 - 10 * wrong.std() / np.sqrt(RUNS)


def test_noncredibility_is_zero_if_consistent_and_positive_if_too_certain() -> None:
    right, wrong = (kalman(1, a)["nci"].mean(axis=0) for a in (None, TENTH_OF_Q))
    assert abs(right.mean()) < 4 * right.std() / np.sqrt(RUNS)
    assert wrong.mean() > 10 * wrong.std() / np.sqrt(RUNS)


@pytest.mark.parametrize("name", ["coverage_90", "crps_px", "nci", "pit_px"])
def test_standard_errors_are_the_spread_of_batches(name: str) -> None:
    """40 batches of 50 runs: their means' spread is known to 1 / sqrt(78)."""
    values = kalman(2)[name][1:].mean(axis=0)
    batches = values.reshape(40, 50)
    said = np.sqrt(np.mean([mean(batch).stderr ** 2 for batch in batches]))
    assert batches.mean(axis=1).std(ddof=1) == pytest.approx(said, rel=4 / np.sqrt(78))


@pytest.mark.parametrize("n", range(1, 8))
def test_noncredibility_is_taken_from_the_mean_log_of_a_chi_square(n: int) -> None:
    expected = 10 * np.log10(3.0) - 10 / np.log(10) * (np.log(2) + digamma(n / 2))
    assert noncredibility(np.array(3.0), n) == pytest.approx(expected, rel=1e-12)


def test_the_score_of_the_exact_filter_is_the_lowest() -> None:
    """By 2000 common runs; a score that is proper tells who knows the truth's law."""
    right, wrong = (kalman(1, a)["crps_px"][1:].mean(axis=0) for a in (None, TENTH_OF_Q))
    difference = wrong - right
    assert difference.mean() > 4 * difference.std() / np.sqrt(RUNS)
    # E CRPS of N(m, s^2) at a draw from it is s / sqrt(pi) (Gneiting & Raftery 2007, section 4.2).
    cov = track(LINEAR, make_filter("kf"), 1, covariances=1).cov
    assert cov is not None
    expected = np.sqrt(cov[0, 0, 1:, 0] / np.pi).mean()
    assert abs(right.mean() - expected) < 4 * right.std() / np.sqrt(RUNS)


def test_the_exact_posterior_of_a_scalar_is_calibrated() -> None:
    """It has no Gaussian's shape: half its mass may be on either side of zero."""
    found = series(merwe(R=0.5, T=3), make_filter("grid", nodes=40), RUNS)
    for quantity in ("x", "nees"):
        last = at_step(found[f"pit_{quantity}"][-1])
        assert min(last.p, last.p_distance) > 1e-3
        assert np.isnan(found[f"pit_{quantity}"][0]).all()  # the first state is known


@pytest.mark.parametrize(("N", "calibrated"), [(19, False), (999, True)])
def test_a_cloud_is_calibrated_if_it_is_large(N: int, calibrated: bool) -> None:
    scenario, told = replace(LINEAR, last=1), ("calibration", "ranks")
    found = track(scenario, make_filter("pf", N=N), 300, predictive_metrics=told).diagnostics
    p = min(at_step(found["pit_nees"][-1]).p, over_steps(shares(found, "px")).p)
    assert (p > 1e-3) == calibrated


def test_regions_of_few_particles_hold_what_they_can() -> None:
    """A truth beyond all 19 is in no region of 99 %."""
    found = series(replace(LINEAR, last=2), make_filter("enkf", N=19), 300)
    beyond = found["pit_nees"] > 19.4 / 20
    assert beyond.any()
    assert not found["coverage_99"][beyond].any()
    assert found["coverage_99"][~beyond].all()


@pytest.mark.parametrize("N", [10, 19])
def test_an_ensemble_of_draws_is_calibrated(N: int) -> None:
    """The first state's members and the truth are draws from one prior, in four components."""
    told: tuple[Kind, ...] = ("calibration", "ranks")
    found = track(LINEAR, make_filter("enkf", N=N), RUNS, predictive_metrics=told).diagnostics
    for p in LEVELS:
        share = (p * N // 100 + 1) / (N + 1)
        error = np.sqrt(share * (1 - share) / RUNS)
        assert abs(found[f"coverage_{p}"][0].mean() - share) < 4 * error
    nci = found["nci"][0]
    assert abs(nci.mean()) < 4 * nci.std() / np.sqrt(RUNS)
    for quantity in ("px", "nees"):
        test = at_step(found[f"pit_{quantity}"][0])
        shares = np.stack([found[bar][0] for bar in bars(quantity)])
        assert min(test.p, test.p_distance, over_steps(shares).p) > 1e-3


def ratio(kind: str, runs: int, **keys: object) -> Array:
    task = BlockTask(
        replace(LINEAR, last=4), make_filter(kind, **keys), 1, 0, runs, runs,
        reference=make_filter("kf"), predictive_metrics=("score", "likelihood_ratio"),
    )  # fmt: skip
    return run_block(task).per_run["likelihood_ratio"]


def test_evidence_of_a_particle_filter_is_unbiased() -> None:
    of_pf = ratio("pf", 1000, N=100)
    assert abs(of_pf.mean() - 1) < 4 * of_pf.std() / np.sqrt(1000)
    assert of_pf.std() > 0.1
    batches = of_pf.reshape(20, 50)
    said = np.sqrt(np.mean([mean(batch).stderr ** 2 for batch in batches]))
    assert batches.mean(axis=1).std(ddof=1) == pytest.approx(said, rel=4 / np.sqrt(38))
    np.testing.assert_allclose(ratio("kf", 20), 1.0)


def test_evidence_by_hand() -> None:
    own = np.array([[np.nan, np.nan], [-1.0, -2.0], [np.nan, -3.0], [-2.0, -np.inf]])
    exact = np.array([[np.nan, np.nan], [-1.5, -1.0], [np.nan, -3.5], [-2.0, -1.0]])
    expected = [[np.nan] * 2, np.exp([0.5, -1.0]), np.exp([0.5, -0.5]), [np.exp(0.5), 0.0]]
    found = likelihood_ratio({"log_likelihood": own}, {"log_likelihood": exact})
    np.testing.assert_allclose(found["likelihood_ratio"], expected)
    assert likelihood_ratio({"log_likelihood": own}, {}) == {}
