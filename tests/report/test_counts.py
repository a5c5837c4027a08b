"""Numbers that some runs lack: their count in tables, and their errors in summary.csv."""

import numpy as np
import pytest

from tests.commands import ran
from trackbench.report.tables_and_figures import Results
from trackbench.statistics.sample_statistics import rms

LEGS = """
name: legs
runs: 20
scenario:
  kind: tracking
  T: 4
  last: 60
  target:
    kind: legs
    launch: {x: 2000, y: 9000, vy: -15}
    legs: [{start: 60, end: 100, turn_rate_deg_s: 2}]
    settled_error: 60
  sensor: {kind: position, sigma: 50}
  start: {kind: two-scan}
filters:
  Stiff: {kind: kf, assume: {motion: {kind: cwna, q: 1.0e-6}}}
  Slow: {kind: kf, assume: {motion: {kind: cwna, q: 0.01}}}
  Fast: {kind: kf, assume: {motion: {kind: cwna, q: 10}}}
tables:
  t: {kind: metrics, columns: {S: "mean(settling_s[leg 1])", N: "mean(not_settled[leg 1])"}}
"""


@pytest.fixture(scope="module")
def legs(tmp_path_factory) -> Results:
    return ran(tmp_path_factory.mktemp("legs"), LEGS, formats=()).results


def test_a_mean_over_some_runs_names_their_number(legs) -> None:
    counts = {}
    for row in legs.tables["t"].texts().rows:
        times = legs.runs({})[row[0].text, "settling_s[leg 1]"]
        counts[row[0].text] = known = int(np.isfinite(times).sum())
        assert row[1].text.endswith(f" ({known} of 20 runs)") == (0 < known < 20)
        mean = times[np.isfinite(times)].mean() if known else np.nan
        assert row[1].number == pytest.approx(mean, rel=1e-6, nan_ok=True)
        assert (row[1].tex or "").endswith(f"}} ({known} of 20 runs)}}") == (0 < known < 20)
        assert "runs" not in row[2].text
    assert any(0 < known < 20 for known in counts.values())


def test_a_number_that_no_run_has_has_no_error(legs) -> None:
    rows = legs.summary
    missing = rows[rows["value"].isna()]
    assert {*missing["metric"]} >= {"rms(settling_s[leg 1])", "mean(settling_s[leg 1])"}
    assert missing["stderr"].isna().all()
    assert (rows["stderr"] == 0.0).any()  # of what no run or every run has


def test_the_rms_of_zeros_has_no_spread() -> None:
    assert rms(np.zeros(4)) == (0.0, 0.0)
    assert np.isnan(rms(np.empty(0))).all()
