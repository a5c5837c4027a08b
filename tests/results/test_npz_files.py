"""Very long and very many runs: their numbers are arrays, with the content of the CSV files."""

import json

import numpy as np
import pandas as pd
import pytest

import trackbench
from tests.report.forging import reseal
from trackbench.results import write_npz
from trackbench.verify.compare_files import compare_frames
from trackbench.verify.verify_folder import verify

CONFIG = {
    "name": "long",
    "seed": 1,
    "runs": 3,
    "grid": {"scenario.last": [8, 12]},
    "scenario": {
        "kind": "tracking",
        "first": 1,
        "last": 8,
        "T": 1,
        "target": {
            "kind": "driven",
            "motion": {"kind": "cv", "q": 1},
            "launch": {"x": 10, "vx": 1},
        },
        "sensor": {"kind": "position", "sigma": 2},
        "start": "two-scan",
    },
    "filters": {"KF": {"kind": "kf"}, "EKF": {"kind": "ekf"}},
    "bound": "bound",
    "tables": {"errors": {"kind": "metrics", "columns": {"RMSE": "mean(rmse_position)"}}},
    "figures": {"rmse": {"kind": "rmse-vs-time", "metric": "rmse_position"}},
}


@pytest.fixture
def folders(tmp_path, monkeypatch):
    """The same experiment with rows, and as if its runs were very long."""
    reports = []
    for name, most in (("rows", 10_000), ("arrays", 5)):
        monkeypatch.setattr(write_npz, "LONG_RUN", most)
        out = tmp_path / name
        reports.append(
            trackbench.run(CONFIG, out=out, engine="serial", formats=["svg"], quiet=True)
        )
    return tmp_path, *reports


def test_arrays_have_the_content_of_the_rows(folders) -> None:
    folder, rows, arrays = folders
    assert (folder / "rows/per_step.csv").is_file()
    assert not (folder / "arrays/per_step.csv").exists()
    assert "per_step.npz" in json.loads((folder / "arrays/manifest.json").read_text())["files"]
    keys = ["scenario.last", "filter", "metric", "step"]
    frames = [report.per_step.sort_values(keys, ignore_index=True) for report in (rows, arrays)]
    pd.testing.assert_frame_equal(*frames, check_dtype=False, rtol=1e-5)
    assert (frames[0]["filter"] == "bound").any()


def test_tables_and_figures_are_the_same(folders) -> None:
    folder, *_ = folders
    for name in ("tables/errors.csv", "summary.csv", "per_run.csv", "paired.csv"):
        assert (folder / "rows" / name).read_bytes() == (folder / "arrays" / name).read_bytes()
    assert (folder / "arrays/figures/rmse.svg").is_file()


def test_the_run_says_where_the_steps_are(folders) -> None:
    _, rows, arrays = folders
    assert any("per_step.npz has the numbers of all 10 steps" in note for note in arrays.notes)
    assert not any("per_step.npz" in note for note in rows.notes)


def test_a_shorter_run_removes_the_arrays(folders, monkeypatch) -> None:
    folder, *_ = folders
    monkeypatch.setattr(write_npz, "LONG_RUN", 10_000)
    trackbench.run(CONFIG, out=folder / "arrays", engine="serial", formats=["svg"], quiet=True)
    assert not (folder / "arrays/per_step.npz").exists()
    assert (folder / "arrays/per_step.csv").is_file()


def test_arrays_of_equal_runs_are_the_same_bytes(folders, monkeypatch) -> None:
    folder, _, arrays = folders
    before = (folder / "arrays/per_step.npz").read_bytes()
    again = trackbench.run(
        CONFIG, out=folder / "again", engine="serial", formats=["svg"], quiet=True
    )
    assert (folder / "again/per_step.npz").read_bytes() == before
    assert not [*compare_frames("per_step.npz", arrays.per_step, again.per_step)]


def test_numbers_beyond_short_ones_stay_exact() -> None:
    positions = np.arange(3)
    assert write_npz._spread(np.array([1.0, 2.5, np.inf]), positions, 4).dtype == np.float32
    huge = write_npz._spread(np.array([1.0, 1e300, 1e-300]), positions, 4)
    assert huge.tolist()[:3] == [1.0, 1e300, 1e-300]


@pytest.fixture
def many(tmp_path, monkeypatch):
    """The same experiment with rows, and as if its runs were very many."""
    reports = []
    for name, most in (("rows", 20_000), ("arrays", 2)):
        monkeypatch.setattr(write_npz, "MANY_RUNS", most)
        out = tmp_path / name
        reports.append(
            trackbench.run(CONFIG, out=out, engine="serial", formats=["svg"], quiet=True)
        )
    return tmp_path, *reports


def test_arrays_of_runs_have_the_content_of_the_rows(many) -> None:
    folder, rows, arrays = many
    assert not (folder / "arrays/per_run.csv").exists()
    assert "per_run.npz" in json.loads((folder / "arrays/manifest.json").read_text())["files"]
    stored = [trackbench.load(folder / name).per_run for name in ("rows", "arrays")]
    pd.testing.assert_frame_equal(*stored, check_dtype=False, rtol=1e-6)
    assert any("per_run.npz has the numbers of all 3 runs" in note for note in arrays.notes)
    assert not any("per_run.npz" in note for note in rows.notes)


def test_arrays_of_runs_serve_tables_and_comparisons(many) -> None:
    folder, *_ = many
    tables = [pd.read_csv(folder / name / "tables/errors.csv") for name in ("rows", "arrays")]
    pd.testing.assert_frame_equal(*tables, rtol=1e-5)
    assert (folder / "rows/summary.csv").read_bytes() == (
        folder / "arrays/summary.csv"
    ).read_bytes()
    loaded = trackbench.load(folder / "arrays")
    assert loaded.results.has_runs
    assert [*loaded.results.runs(loaded.results.points()[0])]


def test_verification_names_the_file_of_arrays(many) -> None:
    folder = many[0] / "arrays"
    with np.load(folder / "per_run.npz") as archive:
        arrays = dict(archive)
    changed = {name: values + 1.0 for name, values in arrays.items()}
    write_npz.write_arrays(folder / "per_run.npz", changed)
    reseal(folder)
    lines = verify(folder, runs=1)
    assert any(line.startswith("per_run.npz: KF: ") for line in lines), lines
    fewer = {name: values[:2] for name, values in arrays.items()}
    write_npz.write_arrays(folder / "per_run.npz", fewer)
    reseal(folder)
    assert verify(folder, runs=1)[-1].startswith("per_run.npz: has not as many runs")
