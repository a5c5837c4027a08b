"""Numbers that some runs lack: their count in tables, and their errors in summary.csv."""

import numpy as np
import pytest

from tests.commands import ran
from trackbench.report.results import Results

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
        assert row[1].number == pytest.approx(np.nanmean(times), rel=1e-6)
        assert (row[1].tex or "").endswith(f"}} ({known} of 20 runs)") == (0 < known < 20)
        assert "runs" not in row[2].text
    assert any(0 < known < 20 for known in counts.values())
