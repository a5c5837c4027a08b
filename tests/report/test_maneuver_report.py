"""Figures and tables of the maneuvering target, from a small experiment with a grid."""

import numpy as np
import pytest

from tests.commands import ran
from tests.conftest import EXPERIMENT_FILES, shipped, track
from trackbench import api
from trackbench.evaluation.simulated_runs import simulate
from trackbench.filters.kf import KF
from trackbench.report.plotting import file_formats
from trackbench.report.tables_and_figures import Results
from trackbench.scenarios.base import Scenario

CONFIG = """
name: small
seed: 3
runs: 12
verdict_seeds: 1
scenario:
  kind: tracking
  last: 200
  target:
    kind: legs
    launch: {x: 2000, y: 10000, vy: -15}
    settle: 20
    legs: [{start: 80, end: 120, ax: 0.4, ay: -0.3}]
  sensor: {kind: position, sigma: 100}
  start: two-scan
  assume: {motion: {kind: cv, q: 0}}
  score: {steps: [20, null]}
filters:
  KF: {kind: kf, assume: {motion: {kind: cv, q: 0}}}
  Adaptive: {kind: adaptive-kf, preset: seconds, nmf: {q: 0}, mf: {q: 1e-4}}
  Never: {kind: adaptive-kf, detector: {eta: 1e9}, nmf: {q: 0}, mf: {q: 1e-4}}
  IMM:
    kind: imm
    motions: [{kind: cv, q: 0}, {kind: ca, q: 1e-4}]
    transition: [[0.99, 0.01], [0.01, 0.99]]
grid: {"filters.KF.assume.motion.q & filters.Adaptive.nmf.q & filters.Never.nmf.q": [0, 0.01, 1]}
tables:
  differences:
    kind: differences
    against: KF
    columns: {Run: rmse_position, Nothing: mode}
  claims:
    kind: claims
    claims:
      adaptive: {less: Adaptive, than: KF, metric: rmse_position}
      backwards: {less: KF, than: Adaptive, metric: rmse_position}
      same: {less: Never, than: KF, metric: rmse_position}
  consistency: {kind: consistency}
figures:
  truth: {kind: track}
  tracks: {kind: track, filters: [KF, IMM], runs: 5}
  mean: {kind: mean-and-std, filters: [KF, IMM]}
  sweep: {kind: rmse-vs-parameter, title: Sweep}
"""


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Results:
    done = ran(tmp_path_factory.mktemp("maneuver"), CONFIG, formats=("png",))
    assert not done.failed
    return done.results


def test_every_file_is_there(results: Results) -> None:
    for name in ("truth", "tracks", "mean", "sweep"):
        assert (results.folder / f"figures/{name}.png").stat().st_size > 5000
    for name in ("differences", "claims", "consistency"):
        assert (results.folder / f"tables/{name}.md").is_file()


def simulated(results: Results) -> Scenario:
    return api.prepare(results.folder / "config.yaml", api.Options()).points[0].scenario


def drawn(results: Results, name: str) -> "object":
    return results.parts("figures")[name].draw(results)


def test_sweep_draws_the_summary_and_marks_the_least(results: Results) -> None:
    figure = drawn(results, "sweep")
    (ax,) = figure.axes
    frame = results.summary
    frame = frame[(frame["metric"] == "mean(rmse_position)") & (frame["filter"] == "KF")]
    line = next(a for a in ax.lines if a.get_label() == "KF")
    np.testing.assert_allclose(line.get_ydata(), frame["value"])
    x = line.get_xdata()
    assert 0.0 < x[0] < 0.01  # zero stands to the left of the least positive value
    marks = [a for a in ax.lines if a.get_marker() == "o"]
    assert any(m.get_ydata()[0] == frame["value"].min() for m in marks)
    imm = next(a for a in ax.lines if a.get_label() == "IMM")
    assert len(set(imm.get_ydata())) == 1
    file_formats.close(figure)


def test_mean_and_std_are_equations_13_and_14(results: Results) -> None:
    """Recomputed from the tracks of the same twelve runs."""
    data = simulate(simulated(results), 3, 0, 12)
    found = track(simulated(results), KF(), 12, seed=3)
    e = (data.truth - found.mean)[[0, 2]]
    mean = e.mean(axis=2)
    std = np.sqrt(np.square(e).mean(axis=2) - mean**2)
    figure = drawn(results, "mean")
    for ax, expected in zip(figure.axes, (*mean, *std), strict=True):
        line = next(a for a in ax.lines if a.get_label() == "KF")
        # per_step.csv has six significant digits
        np.testing.assert_allclose(line.get_ydata(), expected, rtol=6e-6, atol=1e-6)
        assert len([p for p in ax.patches if p.get_label() == "Maneuvers"]) == 1
    file_formats.close(figure)


def test_track_shows_the_truth_and_the_wanted_runs(results: Results) -> None:
    figure = drawn(results, "tracks")
    truth = results.shown["point0/truth"]
    for ax, label in zip(figure.axes, ("KF", "IMM"), strict=True):
        assert ax.get_title() == label
        lines = [a for a in ax.lines if a.get_label() == "Truth"]
        np.testing.assert_allclose(lines[0].get_xdata(), truth[0, :, 0] / 1000.0)
        estimates = [a for a in ax.lines if len(a.get_xdata()) == truth.shape[1]]
        assert len(estimates) == 5 + 1
    file_formats.close(figure)


def test_the_kept_tracks_are_the_estimates_to_a_dot_of_the_page(results: Results) -> None:
    found = track(simulated(results), KF(), 12, seed=3)
    kept = results.shown["point0/mean/KF"]
    positions = [0, 2]
    assert kept.dtype == np.float32
    assert np.isnan(kept[[1, 3]]).all()  # no figure draws a velocity
    off = np.abs(kept[positions] - found.mean[positions][..., : kept.shape[-1]]).max()
    assert 0.0 < off < np.ptp(found.mean[positions]) / 2000
    assert "point0/measurements" not in results.shown


def table(results: Results, name: str) -> "object":
    return results.parts("tables")[name].table(results)


def test_claims_are_sorted_into_what_holds_and_what_fails(results: Results) -> None:
    got = table(results, "claims")
    assert got.value_headers == ["0", "0.01", "1"]
    notes = dict(note.rstrip(".").split(": ", 1) for note in got.notes)
    assert notes["adaptive"].startswith("holds at 0; inconclusive at 0.01")
    assert notes["backwards"].endswith("fails at 0")
    assert notes["same"] == "inconclusive at 0, 0.01, 1"  # one filter computed in two ways


def test_differences_are_paired(results: Results) -> None:
    got = table(results, "differences")
    runs = results.runs(results.points()[0])
    d = runs["Adaptive", "rmse_position"] - runs["KF", "rmse_position"]
    row = got.keys.index(["0.0", "Adaptive"])
    assert got.cells[row][0].estimate.value == pytest.approx(d.mean())
    assert got.cells[row][0].estimate.stderr == pytest.approx(d.std(ddof=1) / np.sqrt(12))
    assert got.cells[row][1].runs == 0  # the Kalman filter has no mode
    never = got.keys.index(["1.0", "Never"])
    assert got.cells[never][0].estimate == (0.0, 0.0)


def test_consistency_counts_steps_in_the_band(results: Results) -> None:
    got = table(results, "consistency")
    cells = dict(zip(map(tuple, got.keys), got.cells, strict=True))
    anees, share, anis, _ = (cell.estimate.value for cell in cells["0.0", "KF"])
    assert anees > 2.0
    assert share < 0.7
    assert anis > 0.7
    good = [cell.estimate.value for cell in cells["0.0", "IMM"]]
    assert good[3] > 0.85
    assert "95 % band of ANIS over 12 runs" in got.notes[1]


def test_shipped_configs_are_good() -> None:
    """Each has a seed of its own, so that what is chosen in one is judged on other runs."""
    loaded = [shipped(name) for name in EXPERIMENT_FILES if name.startswith("adaptive-kf")]
    assert all(experiment.points for experiment in loaded)
    names = {e.settings.name: e.settings.seed for e in loaded}
    assert names.pop("adaptive-kf-tuned-paths") == names["adaptive-kf-tuned"]  # one training
    assert len({*names.values()}) == len(names)
    assert all(e.settings.runs % e.settings.verdict_seeds == 0 for e in loaded)
