"""Runs' shares of averages over time: their mean is the number, their spread its error."""

import numpy as np
import pytest

from trackbench.evaluation.lost_runs import NOT_LOST, TOO_FAR
from trackbench.evaluation.metric_expression import measure
from trackbench.evaluation.result_over_all_runs import FilterResult
from trackbench.evaluation.run_contributions import (
    series_of,
    statistic_of,
    time_mean_shares,
    with_shares,
)
from trackbench.evaluation.series_sums import step_sums
from trackbench.evaluation.summary_rows import summary_rows
from trackbench.statistics import sample_statistics as st

STEPS, RUNS = 30, 200


def correlated(shape, rng, memory=0.95):
    """Squared errors (..., STEPS, M) that are as correlated in time as a track's."""
    e = [rng.standard_normal(shape)]
    for _ in range(STEPS - 1):
        e.append(memory * e[-1] + np.sqrt(1 - memory**2) * rng.standard_normal(shape))
    scale = np.linspace(1.0, 3.0, STEPS)[:, None]
    return np.square(np.stack(e, axis=-2) * scale)


def time_mean(squared):
    return np.sqrt(np.nanmean(squared, axis=-1)).mean(axis=-1)


def test_shares_are_the_delete_one_jackknife():
    squared = correlated((40,), np.random.default_rng(11))
    shares = time_mean_shares(squared, np.ones(40, dtype=bool))
    assert shares.mean() == pytest.approx(time_mean(squared), rel=1e-14)
    left_out = [time_mean(np.delete(squared, m, axis=1)) for m in range(40)]
    pseudo = 40 * time_mean(squared) - 39 * np.array(left_out)
    # They differ by the second order of the square root, which falls with the number of runs.
    np.testing.assert_allclose(shares, pseudo, atol=np.ptp(pseudo) / 20)


def test_lost_runs_and_missing_steps_have_no_part():
    squared = correlated((60,), np.random.default_rng(12))
    found = np.ones(60, dtype=bool)
    found[[3, 7]] = False
    squared[4:9, 10] = np.nan
    squared[0] = np.nan  # known exactly: no run has an error there
    shares = time_mean_shares(squared, found)
    assert np.array_equal(np.isnan(shares), ~found)
    kept = squared[1:, found]
    assert shares[found].mean() == pytest.approx(time_mean(kept), rel=1e-14)
    moved = np.array(squared)
    moved[20, 10] *= 1.001
    change = time_mean(moved[1:, found]) - time_mean(kept)
    influence = (time_mean_shares(moved, found) - shares)[10] / found.sum()
    assert influence == pytest.approx(change, rel=0.05)  # the others' shares move, too, by the mean


def test_the_standard_error_is_that_of_repetitions():
    rng = np.random.default_rng(13)
    squared = np.stack([correlated((RUNS,), rng) for _ in range(600)])
    values = time_mean(squared)
    everyone = np.ones(RUNS, dtype=bool)
    errors = [st.mean(time_mean_shares(one, everyone)).stderr for one in squared[:100]]
    spread = values.std(ddof=1)
    # 600 repetitions know their spread to 1 / sqrt(1200) = 3 %, 100 errors their mean to less.
    assert np.mean(errors) == pytest.approx(spread, rel=0.1)
    of_steps = np.sqrt(squared.var(axis=2) / RUNS) / (2 * np.sqrt(squared.mean(axis=2)))
    bound = of_steps.mean()
    assert bound > 1.15 * spread  # what was given before


def test_the_summary_takes_the_error_of_the_shares():
    squared = correlated((RUNS,), np.random.default_rng(14))
    lost = np.full(RUNS, NOT_LOST)
    lost[5] = TOO_FAR
    kept = {"squared_x": np.where(lost == NOT_LOST, squared, np.nan)}
    result = FilterResult({"lost": lost}, {"squared_x": step_sums(squared, lost)}, kept, None, [])
    windows = {"": np.ones(STEPS, dtype=bool)}
    asked = ["rmse_x@4", "rmse_x@last", "time-mean(rmse_x)", "time-mean(rmse_y)", "rmse_x@99"]
    shared = with_shares(result, map(measure, asked), windows, range(STEPS), {"": 1})
    assert list(shared.per_run) == ["lost", "rmse_x@4", "rmse_x@last", "time-mean(rmse_x)"]
    before, after = (
        {row.metric: row for row in summary_rows(r, {"": 1}, windows)} for r in (result, shared)
    )
    row = after["time-mean(rmse_x)"]
    assert row.value == before["time-mean(rmse_x)"].value
    shares = shared.per_run["time-mean(rmse_x)"]
    assert row.stderr == st.mean(shares[lost == NOT_LOST]).stderr < before[row.metric].stderr
    found = squared[:, lost == NOT_LOST]
    assert after["rms(rmse_x@4)"].value == pytest.approx(np.sqrt(found[4].mean()))
    assert after["rms(rmse_x@last)"].value == pytest.approx(np.sqrt(found[-1].mean()))
    assert "mean(time-mean(rmse_x))" not in after
    read_back = summary_rows(FilterResult(shared.per_run, {}, {}, None, []), {"": 1}, {})
    again = {r.metric: r for r in read_back}["time-mean(rmse_x)"]
    assert again.value == pytest.approx(row.value, rel=1e-14)
    assert again[2:] == row[2:]


@pytest.mark.parametrize(
    ("expression", "series", "statistic"),
    [
        ("time-mean(rmse)", "squared", "mean"),
        ("time-mean(rmse_mean_range[late])", "squared_mean_range", "mean"),
        ("rmse_position@400", "squared_position", "rms"),
        ("rmsd@last", "rmsd", "rms"),
        ("bias_x@3", "error_x", "mean"),
        ("anees_position@3", "nees_position", "mean"),
        ("ess@3", "ess", "mean"),
        ("std_x@3", "error_x", "std"),
        ("time-mean(nees)", None, None),
        ("median(nees)@3", None, None),
        ("efficiency@3", None, None),
        ("mean(rmse)", None, None),
    ],
)
def test_which_series_an_expression_needs(expression, series, statistic):
    assert series_of(measure(expression)) == series
    assert statistic_of(measure(expression)) == statistic


def test_shares_have_the_unit_of_the_errors():
    squared, found = correlated((40,), np.random.default_rng(14)), np.ones(40, dtype=bool)
    for unit in (1e-4, 1e4):
        shares = time_mean_shares(unit**2 * squared, found)
        np.testing.assert_allclose(shares, unit * time_mean_shares(squared, found), rtol=1e-10)
