"""ANEES and ANIS by the components that are used: measured, accepted and not known exactly."""

from pathlib import Path

import numpy as np
import pytest

from tests.commands import ran
from trackbench.errors import UserError
from trackbench.statistics.consistency_bands import anees_band

RATES = """
name: rates
seed: 14
runs: 100
scenario:
  kind: tracking
  T: 0.2
  last: 100
  target: {kind: driven, motion: {kind: cwna, q: 0.5}, launch: {x: 100, y: 50, vx: 1, vy: 2}}
  sensor:
    - {kind: position, sigma: 5, outliers: {share: OUTLIERS, times: 50}}
    - {kind: velocity, sigma: 0.5, period: 5}
  start: {kind: gaussian, sigma: [5, 0, 5, 0]}
  score: {marginals: [position]}
filters:
  KF: {kind: kf}
  Gated: {kind: kf, gate: 0.999}
  IMM:
    kind: imm
    filter: {kind: ekf, gate: 0.999}
    motions: [{kind: cwna, q: 0.5}, {kind: cwna, q: 0.6}]
    transition: [[0.9, 0.1], [0.1, 0.9]]
metrics: [rmse_position, nees, nees_position, nis, anis, innovations, autocorrelation_1, log_score]
tables:
  c: {kind: consistency}
  k: {kind: consistency, filters: [KF]}
  i: {kind: innovations}
figures:
  whole: {kind: anees}
  part: {kind: anees, metric: anees_position, n_x: 2}
"""


def test_missing_components_have_no_part_in_the_nis(tmp_path: Path) -> None:
    results = ran(tmp_path, RATES.replace("OUTLIERS", "0")).results
    steps = results.columns("per_step", {}).where(filter="KF")
    nis, unused = steps.where(metric="nis"), steps.where(metric="unused_nis")
    # Both sensors measure at every fifth step, the first alone at others.
    assert unused["value"].tolist() == [0.0 if k % 5 == 0 else 2.0 for k in range(1, 101)]
    # ANIS at a step is chi-square of 100 n degrees over 100 n: five standard errors.
    n = 4.0 - unused["value"]
    assert (np.abs(nis["value"] / n - 1.0) < 5.0 * np.sqrt(2.0 / (100 * n))).all()
    row = results.tables["c"].cells[0]
    anees, of_anees, anis, of_anis, *_ = (cell.estimate.value for cell in row)
    assert abs(anees - 1.0) < 0.1
    assert abs(anis - 1.0) < 0.1
    # The NIS of steps are independent: 95 % of 100, and four standard errors.
    assert abs(of_anis - 0.95) < 4.0 * np.sqrt(0.95 * 0.05 / 100)
    assert of_anees > 0.5  # errors of successive steps are alike
    low, high = anees_band(1, 200)
    assert f"{low:.3f} to {high:.3f} at a step of 200 components" in results.tables["k"].notes[1]


def test_what_a_gate_refuses_is_counted_beside_the_nis(tmp_path: Path) -> None:
    results = ran(tmp_path, RATES.replace("OUTLIERS", "0.04")).results
    table = results.tables["c"]
    assert table.value_headers[-1] == "Refused a run"
    runs = results.runs({})
    for label in ("Gated", "IMM"):
        row = table.cells[[keys[-1] for keys in table.keys].index(label)]
        # 4 % of 100 position measurements are outliers of 50 times the error: most are refused.
        assert 3.0 < row[-1].estimate.value < 5.0
        assert abs(row[2].estimate.value - 1.0) < 0.1
        assert abs(runs[label, "anis"].mean() - 1.0) < 0.1
        # Each refused measurement has its components taken from the count: 240 in all.
        lost = 240.0 - runs[label, "innovations"]
        assert (lost >= 2.0 * runs[label, "gated"]).all()
        assert (lost <= 4.0 * runs[label, "gated"]).all()
    assert runs["KF", "anis"].mean() > 10.0


@pytest.mark.parametrize(("figure", "number"), [("whole: {kind: anees", 2), ("anees_position", 4)])
def test_another_number_of_components_is_refused(tmp_path: Path, figure: str, number: int) -> None:
    text = RATES.replace("OUTLIERS", "0").replace(", n_x: 2", "")
    with pytest.raises(UserError, match=rf"n_x: {number} components, and .* is of {6 - number}"):
        ran(tmp_path, text.replace(figure, f"{figure}, n_x: {number}"))


def test_the_figures_have_a_band_for_each_step(tmp_path: Path) -> None:
    results = ran(tmp_path, RATES.replace("OUTLIERS", "0")).results
    for name, first, later in (("whole", 2, 4), ("part", 2, 2)):
        (ax,) = results.figure(name).axes
        bands = [c for c in ax.collections if len(c.get_paths())]
        if first == later:
            assert not bands  # one straight band
            continue
        corners = bands[0].get_paths()[0].vertices
        for x, n in ((0.0, first), (50.0, later)):
            low, high = anees_band(n, 100)
            found = sorted(set(corners[corners[:, 0] == x, 1]))
            assert found[0] == pytest.approx(low)
            assert found[-1] == pytest.approx(high)
