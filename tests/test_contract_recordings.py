"""The contract on the problem of a recording, whose few runs give priors and gaps to many draws."""

from pathlib import Path

import numpy as np
import pytest

from tests.planted import HandEKF, with_bug
from trackbench.config.load import load
from trackbench.contract.problems import ModelDraws, WholeExperiment
from trackbench.contract.run_contract import check_filter
from trackbench.core.random_streams import RunStreams

EXPERIMENTS = Path(__file__).parents[1] / "experiments"

BEARING = """
name: passing
scenario:
  kind: tracking
  T: 1
  target: {kind: measured, measurements: bearings.csv}
  assume: {motion: {kind: cwna, q: 0.5}}
  sensor: {kind: range-azimuth, sigma_range: 10, sigma_azimuth_mrad: 5}
  start: {kind: given, mean: {px: -1000, vx: 1, py: 60, vy: -10}, sigma: [20, 5, 20, 5]}
filters: {EKF: {kind: ekf}}
"""


def accusations(bug: str, problem: ModelDraws) -> dict[str, str]:
    """Reason of each check that calls the filter bad, by the name of the check."""
    cls = with_bug(HandEKF, bug)
    findings = check_filter(cls, cls(), on=problem)
    return {finding.check: finding.why for finding in findings if finding.verdict == "bad"}


def passing_target(folder: Path) -> ModelDraws:
    """Problem of one recorded run whose azimuth crosses pi after six steps; two rows are empty."""
    rng = np.random.default_rng(5)
    rows = ["time,range,azimuth"]
    for step in range(1, 31):
        x = -1000.0 + step
        y = 60.0 - 10.0 * step
        distance = np.hypot(x, y) + 10.0 * rng.standard_normal()
        azimuth = np.arctan2(y, x) + 0.005 * rng.standard_normal()
        cells = f"{distance:.17g},{azimuth:.17g}"
        if step in (9, 10):
            cells = ","
        rows.append(f"{step},{cells}")
    (folder / "bearings.csv").write_text("\n".join(rows) + "\n")
    (folder / "on.yaml").write_text(BEARING)
    return ModelDraws(base=load(folder / "on.yaml").points[0].scenario)


def test_draws_repeat_the_gaps_of_the_recorded_run(tmp_path: Path) -> None:
    problem = passing_target(tmp_path)
    data = problem.simulate(RunStreams(1, range(6)), 6)
    gaps = np.isnan(data.measurements)
    assert np.flatnonzero(gaps[0, :, 0]).tolist() == [8, 9]
    assert (gaps == gaps[..., :1]).all()
    assert np.isfinite(data.truth).all()
    assert len(set(data.truth[0, -1])) == 6
    assert WholeExperiment(base=problem.base).recorded_runs == 1


@pytest.mark.parametrize("path", ["bayesian-filtering/car-track.yaml", "beyond/ais.yaml"])
def test_a_right_filter_is_good_on_a_shipped_recording(path: str) -> None:
    scenario = load(EXPERIMENTS / path).points[0].scenario
    assert not accusations("", ModelDraws(base=scenario))


def test_a_bearing_that_is_not_wrapped_is_found_on_a_recording(tmp_path: Path) -> None:
    problem = passing_target(tmp_path)
    assert not accusations("", problem)
    reasons = accusations("no wrap", problem)
    assert any("azimuth" in why for why in reasons.values()), reasons
