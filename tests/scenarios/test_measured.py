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
from trackbench.execution.cache import block_key
from trackbench.execution.plan import make_plan

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
    whole = run(write(tmp_path), tmp_path / "all").per_run.set_index(["filter", "metric"])
    some = run(write(tmp_path, f"{TRUTH}, runs: [7, 3]"), tmp_path / "some").per_run
    for label in ("UKF", "EKF", "Exact"):
        before, now = whole.loc[(label, "rmse")], some[some["filter"] == label]
        now = now[now["metric"] == "rmse"]["value"].tolist()
        assert now == [before[before["run"] == m]["value"].item() for m in (4, 0)]
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


GOOD = "run,step,z\n0,2,1.0\n0,3,1.1\n1,2,0.9\n"


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ("", "1:1: scenario: is empty"),
        ("run,step,z\n", "1:1: scenario: has no rows"),
        (
            GOOD.replace("run,step,z", "run,step,y"),
            "1:1: scenario: no column z; there are run, step",
        ),
        (
            GOOD.replace("step", "tick"),
            "1:1: scenario: no column time or step; there are run, tick",
        ),
        ("run,step,z,z\n0,2,1,1\n", "1:1: scenario: two columns z"),
        (GOOD.replace("1.1", "high"), "3:1: scenario: z: 'high' is not a number"),
        (GOOD.replace("1.1", "inf"), "3:1: scenario: z: 'inf' is not a finite number"),
        (GOOD.replace("0,3,", "0,2.5,"), "3:1: scenario: step: '2.5' is not a whole number"),
        (GOOD.replace("0,3,", ",3,"), "3:1: scenario: run: is missing"),
        (GOOD.replace("0,3,", "0,2,"), "3:1: scenario: run 0: step 2 is there twice, and not"),
        (GOOD + "1,3\n", "5:1: scenario: 2 cells under 3 columns"),
        (
            GOOD.replace("0,3,", "0,700000000000,"),
            "3:1: scenario: step: '700000000000' is not less than",
        ),
        (GOOD + "\n1,x,3\n", "6:1: scenario: step: 'x' is not a whole number"),
        (
            GOOD.replace("step", "time").replace(",3,", ",,"),
            "3:1: scenario: time: '' is not a time",
        ),
        (
            "time,z\n2020-01-01T10:00,1\n2020-01-01 25:00,2\n",
            "3:1: scenario: time: '2020-01-01 25:00' is not a time in ISO 8601",
        ),
        ("time,z\n0,1\n1.7e18,2\n", "3:1: scenario: time: 1.7e+18 s is no time; say its unit"),
        ("step,z\n1,1\n200000,2\n", "1:1: scenario: gives 200001 steps, more than 100000"),
        ("\0\1\2", "1:1: scenario: is not a text file"),
        (b"\xff\xfe\x00", "1:1: scenario: is not a text file"),
    ],
)
def test_files_with_mistakes(tmp_path: Path, content: str | bytes, expected: str) -> None:
    (tmp_path / "data").mkdir()
    data = tmp_path / "data" / "m.csv"
    data.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(UserError) as caught:
        load(write(tmp_path, more=""))
    lines = str(caught.value).splitlines()
    assert len(lines) == 1
    assert lines[0].startswith(f"{data}:{expected}"), lines[0]


def test_every_mistake_in_a_file_is_said(tmp_path: Path) -> None:
    (tmp_path / "data").mkdir()
    data = tmp_path / "data" / "m.csv"
    data.write_text("run,step,z\n0,2,a\n0,3,b\n0,3,1\n0,3\n")
    with pytest.raises(UserError) as caught:
        load(write(tmp_path, more=""))
    found = [line.removeprefix(f"{data}:").split(":")[0] for line in str(caught.value).splitlines()]
    assert found == ["2", "3", "5"]


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        (
            "measurements: data/m.csv",
            "measurements: data/no.csv",
            "no.csv:1:1: scenario: no such",
        ),
        ("measurements: data/m.csv", "measurements: data/n*.csv", "no file has such a name"),
        (TRUTH, ", truth_gap: 2", "scenario.target.truth_gap: there is no truth"),
        ("sigma: [0.75]", "sigma: [1, 2]", "scenario.start.sigma: 2 numbers for x"),
        (TRUTH, ", thruth: data/t.csv", "unknown key; did you mean truth?"),
        (TRUTH, ", columns: {w: q}", "target.columns.w: there is no w; known: run, time"),
        (TRUTH, ", units: {z: cubits}", "target.units.z: 'cubits' is not one of m, km"),
        ("begin: 1", "first: 1", "scenario.first: the recorded data say it"),
        ("begin: 1", "last: 13", "scenario.last: what is recorded is measured in steps 2 to 12"),
        ("start: {kind: given, mean: [1.0], sigma: [0.75]}", "start: known", "or as `given`"),
        ('"R": 0.1', '"R": 0.1, "detection": 0.5', "are of simulated measurements"),
    ],
)
def test_configs_with_mistakes(
    simulated: Path, tmp_path: Path, old: str, new: str, expected: str
) -> None:
    path = write(tmp_path)
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    with pytest.raises(UserError) as caught:
        load(path)
    assert expected in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


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
