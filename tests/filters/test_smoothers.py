"""Smoothers of Gaussian filters against printed numbers of another program and exact cases."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.conftest import ROOT, make_filter
from tests.filters.test_unequal_steps import INTERVALS, least_squares, smoothed_moments
from trackbench import api
from trackbench.config.load import load
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.run_filter import run_filter
from trackbench.filters.smoother_keys import FixedLag
from trackbench.report.tables_and_figures import Results

pytestmark = pytest.mark.usefixtures("no_report")

PENDULUM = ROOT / "experiments" / "data"
CONFIG = f"""name: pendulum
scenario:
  kind: tracking
  T: 0.01
  target:
    kind: measured
    measurements: {PENDULUM}/pendulum-measurements.csv
    truth: {PENDULUM}/pendulum-truth.csv
    state: [angle, rate]
  assume:
    motion:
      kind: map
      components: [angle, rate]
      parameters: {{g: 9.81, q: 0.01}}
      next: {{angle: angle + rate*T, rate: rate - g*sin(angle)*T}}
      Q: [[q*T**3/3, q*T**2/2], [q*T**2/2, q*T]]
  sensor: {{kind: function, h: {{z: sin(angle)}}, R: 0.1}}
  start: {{kind: given, mean: {{}}, sigma: [1, 1]}}
filters:
  EKF: {{kind: ekf}}
  ERTS: {{kind: ekf, smooth: true}}
  UKF: {{kind: ukf, noise: additive, kappa: 1}}
  URTS: {{kind: ukf, noise: additive, kappa: 1, smooth: true}}
  CKF: {{kind: ckf}}
  CRTS: {{kind: ckf, smooth: true}}
  GHKF: {{kind: ghkf, order: 5}}
  GHRTS: {{kind: ghkf, order: 5, smooth: true}}
metrics: [rmse_angle]
"""
PRINTED = {
    "EKF": 0.16830859061153763,
    "ERTS": 0.057446202494837,
    "UKF": 0.09524392,
    "URTS": 0.03661756,
    "CKF": 0.11419660,
    "CRTS": 0.04064624,
    "GHKF": 0.09980624,
    "GHRTS": 0.03710182,
}
LINEAR = """name: linear
runs: 300
seed: 5
scenario:
  kind: tracking
  last: 30
  target: {kind: driven, motion: {kind: cwna, q: 1}, launch: {x: 10, vx: 1}}
  sensor: {kind: position, sigma: 5}
  start: {kind: gaussian, sigma: [5, 1, 5, 1]}
filters: {KF: {kind: kf}, RTS: {kind: kf, smooth: true}, OTHER: {kind: ekf, smooth: true}}
metrics: [rmse_position, nees]
"""


def per_run(text: str, folder: Path) -> dict[Any, np.ndarray]:
    (folder / "c.yaml").write_text(text)
    options = api.Options(engine="serial", quiet=True, out=folder / "out")
    return dict(Results(api.run(folder / "c.yaml", options).folder).runs({}))


def test_the_printed_errors_of_the_pendulum(tmp_path: Path) -> None:
    """Sarkka & Svensson's notebooks pendulum_{ekf,ukf,ckf,ghkf}.ipynb."""
    (tmp_path / "c.yaml").write_text(CONFIG)
    point = load(tmp_path / "c.yaml").points[0]
    for label, printed in PRINTED.items():
        task = BlockTask(
            point.scenario, point.filters[label], seed=1, index=0, width=1, runs_used=1
        )
        errors = run_filter(task, task.data).mean[0, 1:, 0] - task.data.truth[0, 1:, 0]
        assert np.sqrt(np.mean(errors**2)) == pytest.approx(printed, abs=0.6e-8), label


@pytest.mark.parametrize("lag", [None, 2])
@pytest.mark.parametrize("fading", [1.0, 1.2])
@pytest.mark.parametrize("kind", ["kf", "ekf", "ukf", "ckf", "ghkf", "iekf", "iplf"])
def test_a_linear_model_has_one_smoother(kind: str, fading: float, lag: int | None) -> None:
    """Least squares of all states, at unequal steps and with gaps."""
    smooth: Any = True if lag is None else FixedLag(lag=lag)
    *found, _, P = smoothed_moments(make_filter(kind, smooth=smooth, fading=fading))
    exact = least_squares([1.0] * len(INTERVALS), lag, fading, P)
    for a, b in zip(found, exact, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-6, atol=1e-6)


def test_the_last_steps_of_a_lag_are_those_of_all_measurements(tmp_path: Path) -> None:
    """A lag as long as the run is no limit, a shorter one gives larger errors, none the filter's."""
    runs = per_run(
        LINEAR.replace("OTHER: {kind: ekf, smooth: true}", "OTHER: {kind: kf, smooth: {lag: 30}}, "
                       "SHORT: {kind: kf, smooth: {lag: 2}}, NO: {kind: kf, smooth: false}"),
        tmp_path,
    )  # fmt: skip
    rmse = {label: values for (label, metric), values in runs.items() if metric == "rmse_position"}
    np.testing.assert_allclose(rmse["OTHER"], rmse["RTS"], rtol=1e-12)
    np.testing.assert_array_equal(rmse["NO"], rmse["KF"])
    assert rmse["RTS"].mean() < rmse["SHORT"].mean() < rmse["KF"].mean()
