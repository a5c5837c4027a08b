"""A filter that keeps the first interval's constants is found on a config's problem, too."""

from pathlib import Path

import pytest

from tests.conftest import shipped
from trackbench.config.load import load
from trackbench.config.plugins_of_config import load_file
from trackbench.contract.checks import CHECKS
from trackbench.contract.problems import ModelDraws
from trackbench.contract.run_contract import run_check
from trackbench.registry import kinds

FILTER = '''
import numpy as np

from trackbench.adapters.per_run import PerRun


class Constants(PerRun, kind="constants"):
    """Constant velocity in the plane, q 25 m^2/s^3, sigma 20 m."""

    def start(self, mean, cov):
        self.mean, self.cov, self.FQ = np.array(mean), np.array(cov), None

    def step(self, z, dt):
        if WHEN:
            f = np.array([[1, dt], [0, 1]])
            q = 25 * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
            self.FQ = np.kron(np.eye(2), f), np.kron(np.eye(2), q)
        F, Q = self.FQ
        THEN
        m, P = F @ self.mean, F @ self.cov @ F.T + Q
        if z is not None and not np.isnan(z).any():
            H = np.kron(np.eye(2), [[1, 0]])
            S = H @ P @ H.T + 400 * np.eye(2)
            K = P @ H.T @ np.linalg.inv(S)
            m, P = m + K @ (z - H @ m), P - K @ S @ K.T
        self.mean, self.cov = m, P
        return m, P
'''
SHIPPED = {
    "position": {"kf": "{kind: kf}", "enkf": "{kind: enkf}"},
    "radar": {"ekf": "{kind: ekf}", "ukf": "{kind: ukf}", "pf": "{kind: pf, N: 1000}"},
}
ON = """name: on
seed: 3
runs: 100
scenario:
  kind: tracking
  T: 2
  last: 50
  target: {kind: driven, motion: {kind: cwna, q: 25}, launch: {x: 1500, y: -700, vx: 150, vy: -90}}
  sensor: {kind: position, sigma: 20, detection: 0.8}
  start: {kind: gaussian, sigma: [20, 10, 20, 10]}
filters:
"""


RIGHT_F = "F = np.kron(np.eye(2), np.array([[1, dt], [0, 1]]))"
ITS_ERRORS = "fits at equal intervals and not at unequal ones: distance "
ITS_ESTIMATES = "is the EKF at equal intervals and not at unequal ones: the mean is off by "


@pytest.mark.parametrize(
    ("when", "then", "why"),
    [
        ("False", "", ITS_ERRORS),
        ("not z is None", "", ITS_ERRORS),
        ("False", RIGHT_F, ITS_ESTIMATES),
        ("False", f"{RIGHT_F}; Q = Q * dt / 2", ITS_ESTIMATES),
        ("True", "", ""),
    ],
)
def test_a_filter_of_the_first_interval_is_found(
    when: str, then: str, why: str, tmp_path: Path
) -> None:
    text = FILTER.replace("WHEN", f"self.FQ is None or ({when})").replace("THEN", then)
    (tmp_path / "mine.py").write_text(text)
    (tmp_path / "on.yaml").write_text(f"{ON}  KF: {{kind: kf}}\n")
    load_file(tmp_path / "mine.py")
    problem = ModelDraws(base=load(tmp_path / "on.yaml").points[0].scenario)
    found = run_check(*CHECKS["interval"], kinds("filters")["constants"](), problem)
    assert found.verdict == ("bad" if why else "good")
    assert found.why.startswith(why)


@pytest.mark.parametrize("sensor", SHIPPED)
def test_filters_of_the_package_use_each_interval(sensor: str, tmp_path: Path) -> None:
    text = ON + "".join(f"  {kind}: {keys}\n" for kind, keys in SHIPPED[sensor].items())
    if sensor == "radar":
        text = text.replace(
            "{kind: position, sigma: 20, detection: 0.8}",
            "{kind: range-azimuth, sigma_range: 20, sigma_azimuth_mrad: 3}",
        )
    (tmp_path / "on.yaml").write_text(text)
    point = load(tmp_path / "on.yaml").points[0]
    name, check = CHECKS["interval"]
    findings = [
        run_check(name, check, tracker, ModelDraws(base=point.assumed_scenario(label)))
        for label, tracker in point.filters.items()
    ]
    verdicts = [finding.verdict for finding in findings]
    assert "bad" not in verdicts, findings
    assert verdicts.count("good") >= len(verdicts) - 1


def test_a_filter_that_runs_nowhere_refuses_no_intervals(tmp_path: Path) -> None:
    """A filter of four components ends with an error on the pendulum, whatever the intervals."""
    (tmp_path / "mine.py").write_text(FILTER.replace("WHEN", "True").replace("THEN", ""))
    load_file(tmp_path / "mine.py")
    problem = ModelDraws(base=shipped("pendulum").points[0].scenario)
    found = run_check(*CHECKS["interval"], kinds("filters")["constants"](), problem)
    assert (found.verdict, found.why) == (
        "left out",
        "the filter does not run at equal intervals, either",
    )
