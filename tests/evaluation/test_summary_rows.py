"""Rows of summary.csv and per_step.csv against numpy on the runs themselves."""

import numpy as np
import pytest

from trackbench.evaluation.bound_rows import bound_summary
from trackbench.evaluation.lost_runs import NOT_LOST
from trackbench.evaluation.per_step_columns import step_columns
from trackbench.evaluation.result_over_all_runs import FilterResult
from trackbench.evaluation.series_sums import SeriesSums, StepSums, step_sums


def test_a_bound_has_no_error_no_runs_and_loses_none() -> None:
    bound, late = np.array([3.0, 1.0, 2.0]), np.array([False, True, True])
    rows = bound_summary({"position": bound}, {"": np.ones(3, bool), "late": late})
    found = {row.metric: row[1:] for row in rows}
    expected = {
        "rms(rmse_position)": np.sqrt(14 / 3),
        "time-mean(rmse_position)": 2.0,
        "rms(rmse_position[late])": np.sqrt(2.5),
        "time-mean(rmse_position[late])": 1.5,
    }
    assert {name: row[0] for name, row in found.items()} == pytest.approx(expected)
    for _, stderr, runs, lost in found.values():
        assert np.isnan(stderr)
        assert (runs, lost) == (0, 0)


@pytest.mark.parametrize("steps_of_piece", [1, 2, 3])
def test_sums_by_pieces_have_the_bits_of_sums_of_all_steps(steps_of_piece: int) -> None:
    """The sum of a single step of zeros with a sign has the sign, and that of several steps has not."""
    rows = np.full((3, 2), -0.0)
    whole = step_sums(rows, np.full(2, NOT_LOST))
    sums = SeriesSums({"": np.ones(3, bool)}, ())
    for first in range(0, 3, steps_of_piece):
        sums.add("error_x", rows[first : first + steps_of_piece], first)
    for by_pieces, of_all in zip(sums.over_runs()["error_x"], whole, strict=True):
        assert by_pieces.tobytes() == of_all.tobytes()


def test_metrics_of_a_step_are_means_over_its_runs(rng: np.random.Generator) -> None:
    nees, error = rng.chisquare(4, (2, 30)), rng.normal(1.0, 2.0, (2, 30))
    sums = {
        name: StepSums(x.sum(axis=1), np.square(x).sum(axis=1), np.full(2, 30))
        for name, x in (("nees", nees), ("error_x", error))
    }
    found = {
        metric: np.stack([*estimates, columns.runs], axis=1)
        for columns in step_columns(FilterResult({}, sums, {}, None, []), {"": 4, "x": 1})
        for metric, estimates in columns.metrics.items()
    }
    root = np.sqrt(30)
    for i in range(2):
        anees, off = nees[i] / 4, error[i]
        assert found["anees"][i] == pytest.approx((anees.mean(), anees.std(ddof=1) / root, 30))
        assert found["bias_x"][i] == pytest.approx((off.mean(), off.std(ddof=1) / root, 30))
        assert found["std_x"][i] == pytest.approx((off.std(), off.std() / np.sqrt(60), 30))
