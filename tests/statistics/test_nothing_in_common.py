"""Numbers without a value in common: no comparison is equal, and no ratio is a number."""

from math import nan

import numpy as np
import pytest

from trackbench.metrics import METRICS
from trackbench.report.findings.candidates import Candidate
from trackbench.report.findings.ranking import ranking_of
from trackbench.report.folder_comparison.tests_and_verdicts import rows_of
from trackbench.report.suite.scores import Ratio
from trackbench.report.tables.tuning import _notes_on_results
from trackbench.statistics.compare_all_pairs import compare_all
from trackbench.statistics.comparison import Comparison, Sample, compare, compare_estimates
from trackbench.statistics.correlated_series import series_mean
from trackbench.statistics.estimates import RunEstimate

STEPS = 100
RNG = np.random.default_rng(5)
NUMBERS = RNG.normal(size=STEPS)
NOTHING = np.full(STEPS, nan)


def recorded(steps: np.ndarray) -> Sample:
    value = np.nanmean(steps) if np.isfinite(steps).any() else nan
    return Sample.from_values(np.array([value]), "mean", steps)


def halves() -> tuple[Sample, Sample]:
    """Return a sample of the first half of the steps and one of the second."""
    is_first = np.arange(STEPS) < STEPS // 2
    return recorded(np.where(is_first, NUMBERS, nan)), recorded(np.where(is_first, nan, NUMBERS))


def test_steps_without_a_value_are_not_compared() -> None:
    assert compare(recorded(NOTHING), recorded(NOTHING)) is None
    assert compare(recorded(NUMBERS), recorded(NOTHING)) is None
    assert compare(*halves()) is None
    assert not compare_all({"a": recorded(NOTHING), "b": recorded(NOTHING)})


def test_one_common_step_may_be_equal() -> None:
    one = np.where(np.arange(STEPS) == 7, NUMBERS, nan)
    comparison = compare(recorded(one), recorded(one))
    assert comparison is not None
    assert comparison.is_equal


def test_a_difference_without_runs_is_not_equal() -> None:
    no_runs = RunEstimate(value=0.0, stderr=0.0, influences=np.empty(0), runs=0)
    comparison = Comparison(no_runs, no_runs, no_runs, nan)
    assert not comparison.is_equal
    assert not Comparison(no_runs, no_runs, no_runs._replace(value=nan), nan).is_measured


def test_the_mean_of_nothing_is_no_number() -> None:
    assert np.isnan(series_mean(NOTHING).value)
    assert np.isnan(series_mean(NOTHING).z)


def test_filters_of_disjoint_steps_have_no_best() -> None:
    candidates = [
        Candidate(label=label, point={}, lost=np.zeros(1), sample=sample)
        for label, sample in zip("ab", halves(), strict=True)
    ]
    ranking = ranking_of(candidates, "rmse_position")
    assert ranking.best is None
    assert ranking.conflict is not None
    assert ranking.conflict.common_runs == 0
    assert all(np.isfinite(candidate.overall.value) for candidate in ranking.order)


@pytest.mark.parametrize("paired", [True, False])
@pytest.mark.parametrize("metric", ["rmse_position", "diverged"])
def test_folders_that_do_not_measure_a_metric_have_no_row(metric: str, paired: bool) -> None:
    assert metric.partition("_")[0] in METRICS
    key = ({}, "KF", metric)
    nothing = Sample(np.full(6, nan))
    number = Sample(np.ones(6))
    for a, b in ((nothing, nothing), (nothing, number), (number, nothing)):
        assert not [*rows_of(key, a, b, paired=paired, is_exact=False)]
    stored = RunEstimate(value=nan, stderr=nan, influences=None, runs=0)
    assert not [*rows_of(key, stored, stored, paired=paired, is_exact=False)]
    assert [*rows_of(key, number, number, paired=paired, is_exact=False)]


def test_two_errors_of_zero_have_the_ratio_one() -> None:
    zeros = Sample(np.zeros(8))
    comparison = compare(zeros, zeros)
    assert comparison is not None
    assert Ratio.of(comparison) == Ratio(value=1.0, low=1.0, high=1.0)


def test_a_gain_that_is_not_measured_is_not_called_insignificant() -> None:
    nothing = RunEstimate(value=nan, stderr=nan, influences=np.full(1, nan), runs=1)
    gain = compare_estimates(nothing, nothing)
    (note,) = _notes_on_results(gain, gain)
    assert note.startswith("the gain is not measured")
