"""The number that is made small, held against numpy and the statistics it is made of."""

import numpy as np
import pytest

from trackbench.config.tuning_objective import Objective, bad_terms
from trackbench.statistics.sample_statistics import STATISTICS
from trackbench.tuning.record_of_trials import Trial

SIZES = {"": 4, "position": 2}


@pytest.fixture
def per_run(rng: np.random.Generator) -> dict[str, np.ndarray]:
    runs = {
        "rmse_position": rng.gamma(4.0, 2.0, 50),
        "nees": rng.chisquare(8.0, 50),
        "nees_position": rng.chisquare(1.0, 50),
        "log_score": rng.normal(-3.0, 1.0, 50),
        "ess": rng.random(50),
        "bias_x": rng.normal(-1.0, 1.0, 50),
        "lost": np.zeros(50),
    }
    runs["lost"][7] = 1.0
    for name in runs.keys() - {"lost"}:
        runs[name][7] = np.nan
    return runs


@pytest.mark.parametrize("statistic", sorted(STATISTICS))
def test_a_statistic_is_that_of_the_summary(per_run: dict[str, np.ndarray], statistic: str) -> None:
    score = Objective.of(f"{statistic}(rmse_position)", SIZES).score(per_run)
    found = per_run["rmse_position"][~np.isnan(per_run["rmse_position"])]
    value, stderr = STATISTICS[statistic](found)
    assert score.lost == 1
    assert score.value == value
    assert score.stderr == pytest.approx(stderr, rel=0.02)


def test_anees_is_its_distance_to_one(per_run: dict[str, np.ndarray]) -> None:
    above = Objective.of("anees", SIZES).score(per_run)
    assert above.value == pytest.approx(np.nanmean(per_run["nees"]) / 4 - 1)
    below = Objective.of("anees_position", SIZES).score(per_run)
    assert below.value == pytest.approx(1 - np.nanmean(per_run["nees_position"]) / 2)


def test_a_log_score_is_made_large(per_run: dict[str, np.ndarray]) -> None:
    for metric in ("log_score", "mean(log_score)"):
        score = Objective.of(metric, SIZES).score(per_run)
        assert score.value == pytest.approx(-np.nanmean(per_run["log_score"]))


@pytest.mark.parametrize("statistic", ["mean", "median"])
def test_what_is_better_larger_is_made_large_and_a_bias_none(
    per_run: dict[str, np.ndarray], statistic: str
) -> None:
    numpy = {"mean": np.nanmean, "median": np.nanmedian}[statistic]
    ess = Objective.of(f"{statistic}(ess)", SIZES).score(per_run)
    assert ess.value == pytest.approx(-numpy(per_run["ess"]))
    bias = Objective.of(f"{statistic}(bias_x)", SIZES).score(per_run)
    assert numpy(per_run["bias_x"]) < 0.0
    assert bias.value == pytest.approx(-numpy(per_run["bias_x"]))


def test_the_error_of_a_sum_sees_how_its_terms_go_together(
    per_run: dict[str, np.ndarray], rng: np.random.Generator
) -> None:
    """Against repeated batches of runs."""
    objective = Objective.of({"rms(rmse_position)": 2.0, "mean(rmse_position)": -1.0}, SIZES)

    def batch() -> dict[str, np.ndarray]:
        return {"rmse_position": rng.gamma(4.0, 2.0, 200), "lost": np.zeros(200)}

    scores = [objective.score(batch()) for _ in range(400)]
    spread = np.std([s.value for s in scores], ddof=1)
    assert np.mean([s.stderr for s in scores]) == pytest.approx(spread, rel=0.12)  # 3 deviations


def test_fewer_lost_runs_come_first() -> None:
    objective = Objective.of("mean(rmse)", {"": 1})
    small = objective.score({"rmse": np.array([1.0, np.nan]), "lost": np.array([0.0, 1.0])})
    large = objective.score({"rmse": np.array([9.0, 9.0]), "lost": np.zeros(2)})
    none = objective.score({"rmse": np.full(2, np.nan), "lost": np.ones(2)})
    ranked = sorted([none, small, large], key=lambda score: Trial.of({}, score).rank)
    assert ranked == [large, small, none]


def test_what_is_no_statistic_over_runs() -> None:
    assert not list(bad_terms({"rms(rmse)": 1.0, "anees": 2.0, "log_score[k<=30]": 0.5}))
    assert [word for word, _ in bad_terms({"rmse@20": 1.0, "cpu_s_per_run": 1.0})] == [
        "rmse@20",
        "cpu_s_per_run",
    ]
    (bad,) = bad_terms("rms(log_score[k<=30])")  # the larger a score, the smaller its square may be
    assert bad[1].endswith("take mean(log_score[k<=30])")
