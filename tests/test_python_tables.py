"""Measurements and truth from Python: arrays, data frames, and the tracks as arrays."""

import shutil
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import trackbench
from trackbench.commands.read_experiment import prepare
from trackbench.core.arrays import Array
from trackbench.verify.verify_folder import verify

SCENARIO: dict[str, Any] = {
    "kind": "tracking",
    "T": 2,
    "target": {"kind": "measured"},
    "sensor": {"kind": "position", "sigma": 50},
    "start": {"kind": "given", "mean": [9000, 0, 0, 90], "sigma": [100, 10, 100, 10]},
    "assume": {"motion": {"kind": "cwna", "q": 1}},
}
CONFIG = {"name": "rec", "scenario": SCENARIO, "filters": {"KF": {"kind": "kf"}}}
run = partial(trackbench.run, quiet=True, engine="serial", formats=(), save_tracks=True)
FRAME = pd.DataFrame(
    {"run": [7] * 4 + [8] * 4, "time": [0.0, 2, 4, 6] * 2, "x": np.arange(8.0), "y": 1.0}
)


def drawn(runs: int, steps: int) -> Array:
    """Draw measurements (runs, steps, 2) of straight flight, one of them missing."""
    rng = np.random.default_rng(1)
    path = np.stack([np.full(steps, 9000.0), 180.0 * np.arange(1.0, steps + 1)], axis=-1)
    z = path + 50.0 * rng.standard_normal((runs, steps, 2))
    z[1, 3] = np.nan
    return z


def one_axis(z: Array, mean: list[float], sigma: list[float]) -> Array:
    """Run a Kalman filter of one axis over one run (steps,); return positions and variances."""
    x, P, out = np.array(mean), np.diag(np.square(sigma)), []
    F, Q = np.array([[1.0, 2.0], [0.0, 1.0]]), np.array([[8 / 3, 2.0], [2.0, 2.0]])
    for measured in z:
        x, P = F @ x, F @ P @ F.T + Q
        if np.isfinite(measured):
            K = P[:, 0] / (P[0, 0] + 50.0**2)
            x, P = x + K * (measured - x[0]), P - np.outer(K, P[0])
        out.append([x[0], P[0, 0]])
    return np.array(out)


def test_an_array_of_runs_and_its_tracks(tmp_path: Path) -> None:
    z = drawn(3, 20)
    report = run(CONFIG, measurements=z, out=tmp_path / "a")
    tracks = report.tracks()
    assert tracks["components"].tolist() == ["px", "vx", "py", "vy"]
    assert tracks["measured"].tolist() == ["x", "y"]
    assert tracks["times"].tolist() == [2.0 * k for k in range(21)]
    np.testing.assert_array_equal(tracks["measurements"], z.transpose(2, 1, 0))
    assert np.isnan(tracks["truth"]).all()
    for axis, mean in enumerate(([9000.0, 0.0], [0.0, 90.0])):
        for m in range(3):
            expected = one_axis(z[m, :, axis], mean, [100.0, 10.0])
            found = tracks["mean/KF"][2 * axis, 1:, m], tracks["cov/KF"][2 * axis, 2 * axis, 1:, m]
            np.testing.assert_allclose(np.transpose(found), expected, rtol=1e-9)


def test_the_folder_is_complete_and_verified(tmp_path: Path) -> None:
    run(CONFIG, measurements=np.ma.masked_invalid(drawn(3, 9)), out=tmp_path / "a")
    assert verify(tmp_path / "a", 2) == verify(tmp_path / "a", 3) == []
    # The folder alone reruns elsewhere: every file is the same.
    shutil.copytree(tmp_path / "a", tmp_path / "b")
    shutil.rmtree(tmp_path / "a" / "run")
    run(tmp_path / "b" / "config.yaml", out=tmp_path / "b")
    for path in (p for p in (tmp_path / "a").rglob("*") if p.is_file() and p.suffix != ".html"):
        assert path.read_bytes() == (tmp_path / "b" / path.relative_to(tmp_path / "a")).read_bytes()
    table = tmp_path / "b" / "measurements.csv"
    table.write_text(table.read_text().replace("0,1,9", "0,1,8"))
    assert "measurements.csv was changed" in verify(tmp_path / "b", 3)[0]
    other = {**CONFIG, "scenario": {**SCENARIO, "T": 1}}
    (tmp_path / "c").mkdir()
    (tmp_path / "c" / "measurements.csv").write_text("mine\n")
    with pytest.raises(trackbench.UserError, match="no run wrote this file"):
        run(other, measurements=FRAME, out=tmp_path / "c")


def test_a_data_frame_is_the_file_that_it_would_be(tmp_path: Path) -> None:
    """Columns and units are those of the config; a named index is a column."""
    times = pd.Timestamp("2026-01-01T10:00") + pd.to_timedelta(FRAME["time"], "s")
    frame = FRAME.assign(run=FRAME["run"], east=FRAME["x"] / 1000, t=times).drop(columns=["x"])
    target = {"kind": "measured", "columns": {"x": "east", "time": "t"}, "units": {"x": "km"}}
    truth = FRAME.assign(px=FRAME["x"] + 1, py=3.0, t=times)[["run", "t", "px", "py"]]
    frame.to_csv(tmp_path / "m.csv", index=False)
    truth.to_csv(tmp_path / "t.csv", index=False)
    files = {"measurements": str(tmp_path / "m.csv"), "truth": str(tmp_path / "t.csv")}
    config = {**CONFIG, "scenario": {**SCENARIO, "target": target}}
    stored = {**CONFIG, "scenario": {**SCENARIO, "target": {**target, **files}}}
    a = run(stored, out=tmp_path / "a")
    columns = {name: truth[name].tolist() for name in truth}
    b = run(config, measurements=frame.set_index("t"), truth=columns, out=tmp_path / "b")
    for name in ("per_run.csv", "per_step.csv", "summary.csv", "tracks.npz"):
        assert (a.folder / name).read_bytes() == (b.folder / name).read_bytes()
    assert np.isfinite(b.tracks()["truth"][0, 1:]).all()


def test_a_table_for_each_sensor_and_a_truth_in_an_array(tmp_path: Path) -> None:
    z, both = drawn(2, 5), [SCENARIO["sensor"], {"kind": "position", "sigma": 5}]
    config = {**CONFIG, "scenario": {**SCENARIO, "sensor": both}}
    truth = np.concatenate([z, z], axis=-1)[..., [0, 2, 1, 3]]
    report = run(config, measurements=[z, z + 1.0], truth=truth, out=tmp_path / "a")
    one = run(config, measurements=np.concatenate([z, z + 1.0], axis=-1), out=tmp_path / "b")
    np.testing.assert_array_equal(report.tracks()["mean/KF"], one.tracks()["mean/KF"])
    np.testing.assert_array_equal(report.tracks()["truth"][:, 1:], truth.transpose(2, 1, 0))
    assert verify(tmp_path / "a", 1) == []


KINDS = "a pandas data frame, a mapping of columns, or a numpy array"


def with_cell(column: str, cell: object) -> pd.DataFrame:
    frame = FRAME.astype(object)
    frame.loc[2, column] = cell
    return frame


@pytest.mark.parametrize(
    ("table", "line"),
    [
        (drawn(2, 4)[..., :1], "measurements: has the shape (2, 4, 1); allowed: (steps, 2) or "
         "(runs, steps, 2), of x, y"),
        (np.array([["a", "b"]]), "measurements: is an array of <U1; allowed: whole numbers and floats"),
        ([[1, 2]], f"measurements: is of the type list; allowed: {KINDS}"),
        ({"x": [1], "y": [1, 2]}, "measurements: all arrays must be of the same length"),
        (with_cell("time", np.nan), "measurements, row 2: scenario: time: '' is not a time"),
        (with_cell("x", "abc"), "measurements, row 2: scenario: x: 'abc' is not a number"
         ": correct it, or empty the cell if nothing was measured"),
        (with_cell("y", np.inf), "measurements, row 2: scenario: y: 'inf' is not a finite number"
         ": correct it, or empty the cell if nothing was measured"),
        (FRAME.rename(columns={"x": "q"}), "measurements: scenario: no column x; there are run, "
         "time, q, y (see `columns`)"),
        (FRAME[:0], "measurements: scenario: has no rows"),
        ([], "measurements=: scenario.target.measurements: 0 files for 1 sensor"),
        ([FRAME, FRAME], "measurements=: scenario.target.measurements: 2 files for 1 sensor"),
    ],
)  # fmt: skip
def test_a_mistake_is_one_line(table: object, line: str) -> None:
    with pytest.raises(trackbench.UserError) as error:
        prepare(CONFIG, trackbench.Options(measurements=table))
    assert str(error.value) == line


def test_only_a_measured_target_takes_them() -> None:
    config = {**CONFIG, "scenario": {**SCENARIO, "target": {"kind": "legs"}}}
    with pytest.raises(trackbench.UserError, match=r"is \{kind: measured\}, and this one is legs$"):
        prepare(config, trackbench.Options(measurements=FRAME))
    bare = {key: value for key, value in SCENARIO.items() if key != "target"}
    whole = prepare({**CONFIG, "scenario": bare}, trackbench.Options(measurements=FRAME))
    assert whole.settings.runs == 2
