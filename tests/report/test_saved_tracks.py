"""Tracks of every run after `save_tracks`, those of figures without; times of one run alone."""

from pathlib import Path
from typing import Any
from zipfile import ZIP_DEFLATED, ZipFile

import numpy as np
import pytest

from trackbench import api

CONFIG: dict[str, Any] = {
    "name": "t",
    "runs": 50,
    "scenario": {
        "kind": "tracking",
        "last": 30,
        "T": 2,
        "target": {
            "kind": "driven",
            "motion": {"kind": "cwna", "q": 1},
            "launch": {"x": 9000, "vy": 90},
        },
        "sensor": {"kind": "range-azimuth", "sigma_range": 50, "sigma_azimuth_mrad": 3},
        "start": "two-scan",
    },
    "filters": {"EKF": {"kind": "ekf"}},
}


@pytest.fixture(autouse=True)
def _inside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_tracks_are_of_every_run_with_covariance_if_they_were_saved() -> None:
    report = api.run(CONFIG, save_tracks=True, quiet=True, engine="serial", formats=())
    for found in (report.tracks(), api.load(report.folder).tracks()):
        T = len(found["steps"])
        assert found["truth"].shape == found["mean/EKF"].shape == (4, T, 50)
        assert found["cov/EKF"].shape == (4, 4, T, 50)
        assert found["measurements"].shape == (2, T - 1, 50)
        errors = np.hypot(*(found["mean/EKF"] - found["truth"])[[0, 2]]).T
        rmse = np.sqrt(np.square(errors).mean(axis=1))
        frame = report.per_run
        stored = frame[frame["metric"] == "rmse_position"].sort_values("run")["value"]
        window = report.results.config["scenario"]
        assert window["last"] == 30
        np.testing.assert_allclose(rmse, stored, rtol=0.3)  # a window may leave out first steps
    without = api.run(CONFIG, quiet=True, engine="serial", formats=())
    assert without.tracks()["truth"].shape[-1] == 1
    assert "cov/EKF" not in without.tracks()


def test_saved_tracks_of_a_grid_are_those_of_the_point() -> None:
    grid = {"scenario.sensor.sigma_range": [50, 500]}
    config = {**CONFIG, "grid": grid, "runs": 5}
    report = api.run(config, save_tracks=True, quiet=True, formats=())
    first, second = (report.tracks(point) for point in report.results.points())
    assert first["mean/EKF"].shape == second["mean/EKF"].shape
    assert first["mean/EKF"].shape[-1] == 5
    assert not np.array_equal(first["mean/EKF"], second["mean/EKF"])


def test_one_run_is_timed_as_one_and_several_in_a_block() -> None:
    """A step over a whole block of an EKF's runs costs a run a small part of a step over one."""
    table = {"t": {"kind": "metrics", "columns": {"s": "cpu_s_per_run"}}}
    costs = []
    for runs in (1, 500):
        report = api.run(
            {**CONFIG, "runs": runs, "tables": table}, quiet=True, engine="serial", formats=()
        )
        costs.append(report.results.timing["cpu_s_per_run"].iloc[0])
    assert costs[0] > 5.0 * costs[1]


def test_saved_tracks_are_read_by_any_program_that_unpacks_zip() -> None:
    """They were packed by LZMA, which few programs unpack."""
    report = api.run(CONFIG, save_tracks=True, quiet=True, engine="serial", formats=())
    with ZipFile(report.folder / "tracks.npz") as archive:
        for member in archive.infolist():
            assert member.compress_type == ZIP_DEFLATED
            with archive.open(member) as file:
                assert np.lib.format.read_magic(file) == (1, 0)
                _, is_fortran_order, dtype = np.lib.format.read_array_header_1_0(file)
            assert not is_fortran_order
            assert dtype.str in ("<f8", "<i8")


def test_measurements_are_those_of_the_steps_after_the_first() -> None:
    report = api.run(CONFIG, save_tracks=True, quiet=True, engine="serial", formats=())
    tracks = report.tracks()
    # The scans of the steps 0 and 1 make the first estimate.
    assert tracks["steps"].tolist() == [*range(1, 31)]
    assert tracks["measurements"].shape == (2, 29, 50)
    px, _, py, _ = tracks["truth"][:, 1:]
    azimuth = tracks["measurements"][1]
    errors = azimuth - np.arctan2(py, px)
    # A step moves the azimuth by 20 mrad, and the noise has 3 mrad.
    assert np.std(errors) == pytest.approx(3e-3, rel=5.0 / np.sqrt(2.0 * errors.size))
