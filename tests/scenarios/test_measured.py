"""Recorded data: the same numbers as simulated ones, gaps, no truth, and files with mistakes."""

import json
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tests.papers import merwe_text
from trackbench import api
from trackbench.config.load import load
from trackbench.errors import UserError
from trackbench.execution.block_key import block_key
from trackbench.execution.plan import make_plan

pytestmark = pytest.mark.usefixtures("no_report")

SIMULATED = json.loads(merwe_text(T=12, R=0.1)) | {"start": {"kind": "gaussian", "sigma": [0.75]}}
MOTION, SENSOR, SCORE = SIMULATED["target"]["motion"], SIMULATED["sensor"], SIMULATED["score"]
CONFIG = """
name: mine
seed: 4
{runs}
block: 4
scenario:
  kind: tracking
  target: {{kind: measured, axes: 0, measurements: data/m.csv{more}}}
  sensor: {sensor}
  start: {{kind: given, mean: [1.0], sigma: [0.75]}}
  begin: 1
  score: {score}
  assume: {{motion: {motion}}}
filters:
  UKF: {{kind: ukf}}
  EKF: {{kind: ekf}}
  PF: {{kind: pf, N: 50}}
  Exact: {{kind: grid, nodes: 16}}
tables:
  t: {{kind: metrics, columns: {{RMSE: rms(rmse), NIS: mean(nis)}}}}
"""
TRUTH = ", truth: data/t.csv"
"""What a target has beside its measurements."""


def write(folder: Path, more: str = TRUTH, runs: str = "") -> Path:
    path = folder / "mine.yaml"
    words = {"sensor": json.dumps(SENSOR), "motion": json.dumps(MOTION), "score": json.dumps(SCORE)}
    text = CONFIG.format(more=more, runs=runs, **words)
    if "truth:" not in more:
        text = text.replace("RMSE: rms(rmse), ", "")
    path.write_text(text)
    return path


def run(config: Path, out: Path, **options: object) -> api.Report:
    return api.run(config, out=out, workers=1, quiet=True, formats=(), **options)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Simulate a batch of 6 runs, and write its data as CSV files."""
    tmp_path = tmp_path_factory.mktemp("recording")
    text = write(tmp_path, runs="runs: 6").read_text()
    start, end = text.index("scenario:"), text.index("filters:")
    scenario = json.dumps(SIMULATED)
    (tmp_path / "sim.yaml").write_text(text[:start] + f"scenario: {scenario}\n" + text[end:])
    out = run(tmp_path / "sim.yaml", tmp_path / "sim", save_tracks=True).folder
    with np.load(out / "tracks.npz") as tracks:
        (tmp_path / "data").mkdir()
        for name, values, steps in (
            ("m", tracks["measurements"], tracks["steps"][1:]),
            ("t", tracks["truth"], tracks["steps"]),
        ):
            _, T, M = values.shape
            frame = {
                "run": np.repeat(np.arange(M) + 3, T),
                "step": np.tile(steps, M),
                "z" if name == "m" else "x": values[0].T.ravel(),
            }
            pd.DataFrame(frame).to_csv(tmp_path / "data" / f"{name}.csv", index=False)
    return tmp_path


@pytest.fixture
def simulated(recording: Path, tmp_path: Path) -> Path:
    """Copy the recording's data to the test's folder, and return the simulation's results."""
    shutil.copytree(recording / "data", tmp_path / "data")
    return recording / "sim"


def test_recorded_data_give_the_numbers_of_the_simulation(simulated: Path, tmp_path: Path) -> None:
    recorded = run(write(tmp_path), tmp_path / "rec").folder
    for name in ("per_run.csv", "per_step.csv", "summary.csv"):
        assert (recorded / name).read_bytes() == (simulated / name).read_bytes(), name
    again = run(recorded / "config.yaml", tmp_path / "again").folder
    assert (again / "per_run.csv").read_bytes() == (recorded / "per_run.csv").read_bytes()


def test_all_runs_are_taken_and_no_more(simulated: Path, tmp_path: Path) -> None:
    assert load(write(tmp_path)).settings.runs == 6
    assert load(write(tmp_path), runs=2).settings.runs == 2
    with pytest.raises(UserError, match="--runs: runs: 7 is more than the 6 recorded runs"):
        load(write(tmp_path), runs=7)


def test_the_runs_that_are_chosen_come_in_their_order(simulated: Path, tmp_path: Path) -> None:
    whole = run(write(tmp_path), tmp_path / "all").per_run
    some = run(write(tmp_path, f"{TRUTH}, runs: [7, 3]"), tmp_path / "some").per_run
    for label in ("UKF", "EKF", "Exact"):
        before, now = (
            rows[(rows["filter"] == label) & (rows["metric"] == "rmse")] for rows in (whole, some)
        )
        expected = [before[before["run"] == m]["value"].item() for m in (4, 0)]
        assert now["value"].tolist() == expected
    with pytest.raises(UserError, match=r"target.runs.0: there is no run '9'; there are 3, 4"):
        load(write(tmp_path, ", runs: [9]"))


def test_without_truth_there_are_no_errors_but_nis(simulated: Path, tmp_path: Path) -> None:
    report = run(write(tmp_path, more=""), tmp_path / "rec", save_tracks=True)
    assert not report.failed
    assert not report.notes
    metrics = set(report.per_run["metric"])
    assert "nis" in metrics
    errors = {m for m in metrics if m.startswith(("rmse", "nees", "rmsd", "diverged"))}
    assert all(m.startswith("rmse_predicted_z") for m in errors)
    assert {"log_score", "anis", "autocorrelation_1"} <= metrics
    before = pd.read_csv(simulated / "per_run.csv")
    nis = before[before["metric"] == "nis"].reset_index(drop=True)
    mine = report.per_run[report.per_run["metric"] == "nis"].reset_index(drop=True)
    pd.testing.assert_frame_equal(mine, nis)
    with np.load(report.folder / "tracks.npz") as tracks, np.load(simulated / "tracks.npz") as old:
        np.testing.assert_array_equal(tracks["mean/UKF"], old["mean/UKF"])


def test_a_gap_is_predicted_over(simulated: Path, tmp_path: Path) -> None:
    """After a gap the filter stands where the motion alone takes it: mean phi1 m + drive."""
    frame = pd.read_csv(tmp_path / "data" / "m.csv")
    gone = (frame["step"] == 6) & (frame["run"] != 5)
    frame.loc[frame["run"] == 4, "z"] = frame["z"].where(~gone, np.nan)  # an empty cell
    frame[~(gone & (frame["run"] != 4))].to_csv(tmp_path / "data" / "m.csv", index=False)
    report = run(write(tmp_path), tmp_path / "rec", save_tracks=True)
    assert not report.failed + report.notes
    with np.load(report.folder / "tracks.npz") as now, np.load(simulated / "tracks.npz") as old:
        for label in ("UKF", "EKF", "Exact"):
            mean, before = now[f"mean/{label}"][0], old[f"mean/{label}"][0]
            i = 5  # step 6
            drive = 1 + np.sin(0.04 * np.pi * 6) + 1.5
            without = [0, 1, 3, 4, 5]
            predicted = 0.5 * mean[i - 1, without] + drive
            np.testing.assert_allclose(mean[i, without], predicted, rtol=1e-7)
            np.testing.assert_allclose(mean[:, 2], before[:, 2], rtol=1e-12)
            assert np.isfinite(mean).all()
            assert not np.allclose(mean[i, without], before[i, without])


def test_a_gap_in_the_truth_is_no_error(simulated: Path, tmp_path: Path) -> None:
    frame = pd.read_csv(tmp_path / "data" / "t.csv")
    frame[frame["step"] != 7].to_csv(tmp_path / "data" / "t.csv", index=False)
    report = run(write(tmp_path), tmp_path / "rec")
    assert not report.failed + report.notes
    before, now = (
        frame[frame["metric"] == "rmse"]
        for frame in (pd.read_csv(simulated / "per_step.csv"), report.per_step)
    )
    assert 7 not in set(now["step"])
    kept = before[before["step"] != 7].reset_index(drop=True)
    pd.testing.assert_frame_equal(now.reset_index(drop=True), kept)


def test_edited_data_are_filtered_again(
    simulated: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TRACKBENCH_CACHE", str(tmp_path / "cache"))
    first = run(write(tmp_path), tmp_path / "rec").per_run
    data = tmp_path / "data" / "m.csv"
    data.write_text(data.read_text().replace("\n3,2,", "\n3,2,1"))
    second = run(write(tmp_path), tmp_path / "rec").per_run
    changed = first["value"] != second["value"]
    assert set(first[changed & first["value"].notna()]["run"]) == {0}


def test_data_edited_after_they_were_read_do_not_name_the_block(
    simulated: Path, tmp_path: Path
) -> None:
    data = tmp_path / "data" / "m.csv"
    first = make_plan(load(write(tmp_path))).unique[0]
    data.write_text(data.read_text().replace("\n3,2,", "\n3,2,1"))
    second = make_plan(load(write(tmp_path))).unique[0]
    assert block_key(first, first.runs_used) != block_key(second, second.runs_used)
