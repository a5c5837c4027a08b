"""Recorded data: the same numbers as simulated ones, gaps, no truth, and files with mistakes."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tests.papers import merwe_text
from trackbench import api
from trackbench.experiment.planning.digest import block_key
from trackbench.experiment.planning.plan import make_plan
from trackbench.experiment.problems import UserError
from trackbench.experiment.reading.config import load

LIKE = merwe_text(T=12, R=0.1)
CONFIG = """
name: mine
seed: 4
{runs}
block: 4
scenario:
  kind: recorded
  like: {like}
  measurements: data/m.csv
  {truth}
filters:
  UKF: {{kind: ukf}}
  EKF: {{kind: ekf}}
  PF: {{kind: pf, N: 50}}
  Exact: {{kind: grid}}
tables:
  t: {{kind: metrics, columns: {{RMSE: rms(rmse), NIS: mean(nis)}}}}
"""


def write(folder: Path, like: str = LIKE, truth: str = "truth: data/t.csv", runs: str = "") -> Path:
    path = folder / "mine.yaml"
    path.write_text(CONFIG.format(like=like, truth=truth, runs=runs))
    return path


def run(config: Path, out: Path, **options: object) -> api.Report:
    return api.run(config, out=out, workers=1, quiet=True, formats=(), **options)


@pytest.fixture
def simulated(tmp_path: Path) -> Path:
    """A simulated batch of 6 runs, and the same data as CSV files."""
    text = CONFIG.format(like=LIKE, truth="", runs="runs: 6")
    start, end = text.index("scenario:"), text.index("filters:")
    (tmp_path / "sim.yaml").write_text(text[:start] + f"scenario: {LIKE}\n" + text[end:])
    out = run(tmp_path / "sim.yaml", tmp_path / "sim", save_tracks=True).folder
    with np.load(out / "tracks.npz") as tracks:
        (tmp_path / "data").mkdir()
        for name, values, steps in (
            ("m", tracks["measurements"], tracks["steps"][1:]),
            ("t", tracks["truth"], tracks["steps"]),
        ):
            _, T, M = values.shape
            frame = {
                "run": np.repeat(np.arange(M) + 3, T),  # any numbers, in order
                "step": np.tile(steps, M),
                "z" if name == "m" else "x": values[0].T.ravel(),
            }
            pd.DataFrame(frame).to_csv(tmp_path / "data" / f"{name}.csv", index=False)
    return out


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


def test_without_truth_there_are_no_errors_but_nis(simulated: Path, tmp_path: Path) -> None:
    report = run(write(tmp_path, truth=""), tmp_path / "rec", save_tracks=True)
    assert not report.failed
    assert not report.notes
    metrics = set(report.per_run["metric"])
    assert "nis" in metrics
    assert not {m for m in metrics if m.startswith(("rmse", "nees", "distance"))}
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


def test_a_prior_of_ones_own(simulated: Path, tmp_path: Path) -> None:
    text = "prior_mean: [1.5]\n  prior_sigma: [0.5]"
    path = write(tmp_path, truth=text)
    path.write_text(path.read_text().replace("  Exact: {kind: grid}\n", ""))
    report = run(path, tmp_path / "rec", save_tracks=True)
    assert not report.failed
    with np.load(report.folder / "tracks.npz") as tracks:
        np.testing.assert_allclose(tracks["mean/UKF"][:, 0], 1.5)
        np.testing.assert_allclose(tracks["cov/UKF"][:, :, 0], 0.25)


GOOD = "run,step,z\n0,2,1.0\n0,3,1.1\n1,2,0.9\n"


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ("", "1:1: scenario: no column run; the columns must be run,step,z"),
        ("run,step,z\n", "1:1: scenario: has no rows"),
        (GOOD.replace("run,step,z", "run,step,y"), "1:1: scenario: no column z; the columns"),
        (GOOD.replace("run,step,z", "run,z,z"), "1:1: scenario: no column step"),
        ("run,step,z,z\n0,2,1,1\n", "1:1: scenario: two columns z"),
        (GOOD.replace("1.1", "high"), "3:1: scenario: z: 'high' is not a number"),
        (GOOD.replace("1.1", "inf"), "3:1: scenario: z: 'inf' is not a finite number"),
        (GOOD.replace("0,3,", "0,2.5,"), "3:1: scenario: step: '2.5' is not a whole number"),
        (GOOD.replace("0,3,", "-1,3,"), "3:1: scenario: run: '-1' is not a whole number"),
        (GOOD.replace("0,3,", "0,2,"), "3:1: scenario: run 0: step 2 is there twice"),
        (GOOD + "1,5,1\n1,4,1\n", "6:1: scenario: run 1: step 4 comes after step 5"),
        (GOOD.replace("0,3,", "0,1,"), "3:1: scenario: run 0: step 1 comes after step 2"),
        (GOOD.replace("0,2,", "0,1,"), "2:1: scenario: run 0: step 1 is not one of 2 to 12"),
        (GOOD.replace("0,3,", "0,13,"), "3:1: scenario: run 0: step 13 is not one of 2 to 12"),
        (GOOD + "1,3\n", "5:1: scenario: 2 cells under 3 columns"),
        (GOOD + "\n1,x,3\n", "6:1: scenario: step: 'x' is not a whole number"),
        ("\0\1\2", "1:1: scenario: no"),
        (b"\xff\xfe\x00", "1:1: scenario: is not a text file in UTF-8"),
    ],
)
def test_files_with_mistakes(tmp_path: Path, content: str | bytes, expected: str) -> None:
    (tmp_path / "data").mkdir()
    data = tmp_path / "data" / "m.csv"
    data.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(UserError) as caught:
        load(write(tmp_path, truth=""))
    lines = str(caught.value).splitlines()
    assert len(lines) == 1
    assert lines[0].startswith(f"{data}:{expected}"), lines[0]


def test_every_mistake_in_a_file_is_said(tmp_path: Path) -> None:
    (tmp_path / "data").mkdir()
    data = tmp_path / "data" / "m.csv"
    data.write_text("run,step,z\n0,2,a\n0,3,b\n0,3,1\n0,3,1\n")
    with pytest.raises(UserError) as caught:
        load(write(tmp_path, truth=""))
    found = [line.removeprefix(f"{data}:").split(":")[0] for line in str(caught.value).splitlines()]
    assert found == ["2", "3", "5"]


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("measurements: data/m.csv", "measurements: data/no.csv", "no.csv:1:1: scenario: no such"),
        (f"like: {LIKE}", "", "scenario.like: this key is required"),
        ('"R": 0.1', '"R": -1', "scenario.like.sensor.R: -1 is not greater than 0"),
        ('"tracking"', '"traking"', "did you mean tracking?"),
        ("truth: data/t.csv", "truth: data/t.csv\n  prior_mean: [1.0]", "go together"),
        (
            "truth: data/t.csv",
            "truth: data/t.csv\n  prior_mean: [1, 2]\n  prior_sigma: [1, 2]",
            "the prior needs 1 numbers: x",
        ),
        ("truth: data/t.csv", "thruth: data/t.csv", "unknown key; did you mean truth?"),
        ("measurements: data/m.csv", "measurements: 3", "3 is not a word"),
        (f"like: {LIKE}", "like: nowhere.yaml", "8:9: scenario.like: cannot read"),
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


def test_truth_of_a_run_without_measurements(simulated: Path, tmp_path: Path) -> None:
    with (tmp_path / "data" / "t.csv").open("a") as file:
        file.write("99,1,1.0\n")
    with pytest.raises(UserError, match="run 99 has no measurements in"):
        load(write(tmp_path))


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
    assert block_key(first, first.used) != block_key(second, second.used)


def test_like_from_a_file(simulated: Path, tmp_path: Path) -> None:
    (tmp_path / "data" / "like.yaml").write_text(LIKE)
    one = run(write(tmp_path, like="data/like.yaml"), tmp_path / "one").per_run
    two = run(write(tmp_path), tmp_path / "two").per_run
    pd.testing.assert_frame_equal(one, two)
