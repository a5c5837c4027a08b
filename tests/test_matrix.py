"""Every filter on every sensor: it runs for ten steps, or is refused with a reason."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from trackbench.config.load import load
from trackbench.errors import UserError
from trackbench.evaluation.block import BlockTask, Kind
from trackbench.evaluation.run_block import run_block
from trackbench.registry import kinds

CV, CA = {"kind": "cv", "q": 0.1}, {"kind": "ca", "q": 1e-3}
NEEDED: dict[str, dict[str, Any]] = {
    "adaptive-kf": {"nmf": {"q": 0.1}, "mf": {"q": 1e-3}, "detector": {"eta": 20, "window_s": 5}},
    "vdf": {"nmf": {"q": 0.1}, "mf": {"q": 1e-3}, "eta": 20},
    "input-estimation": {"motion": {"q": 0.1}, "window_s": 5, "min_window_s": 1},
    "alpha-beta": {"q": 0.1},
    "imm": {"motions": [CV, CA], "transition": [[0.95, 0.05], [0.05, 0.95]]},
    "mmpf": {"motions": [CV, CA], "transition": [[0.95, 0.05], [0.05, 0.95]], "N": 200},
    "gaussian-sum": {"split": 9, "span": 2.0},
    **{
        kind: {"N": 60}
        for kind in (
            "pf",
            "rpf",
            "jitter-pf",
            "apf",
            "epf",
            "upf",
            "mpf",
            "los-rbpf",
            "gpf",
            "enkf",
            "edh",
        )
    },
    **{kind: {"N": 20, "G": 3} for kind in ("pfde", "hdepf")},
}
TARGET = {
    "kind": "driven",
    "motion": {"kind": "cwna", "q": 0.1},
    "launch": {"x": 3000, "y": 2000, "vx": -20, "vy": 15},
}
SPACE = {**TARGET, "launch": {**TARGET["launch"], "z": 900, "vz": -3}}
RADAR = {"kind": "range-azimuth", "sigma_range": 20, "sigma_azimuth_mrad": 5}
KNOWN_ROUGHLY = {"kind": "gaussian", "sigma": [60, 5, 60, 5]}
LINEAR = "a linear sensor"
PER_AXIS = "a sensor of planar positions, as it works axis by axis (try imm, or cmkf)"
SCANS = "a start from two scans of a radar at the origin"
READING = "a sensor of range and azimuth"
SCALAR = ("grid", "grid-2d", "inversion")
TOLD: tuple[Kind, ...] = ("score", "prediction", "calibration", "crps")
SCORELESS = ("prior-mean", "conversion")  # one looks at no measurement, one has no prediction
OF_POSITIONS = ("adaptive-kf", "alpha-beta", "input-estimation", "vdf")
OF_SCANS = ("conversion", "los-rbpf", "mpf")
OF_READINGS = ("cmkf", "mcaekf")
PROBLEMS: dict[str, tuple[dict[str, Any], dict[tuple[str, ...], str]]] = {
    "position": (
        {"target": TARGET, "sensor": {"kind": "position", "sigma": 30}, "start": "two-scan"},
        {OF_SCANS: SCANS, OF_READINGS: READING},
    ),
    "position-velocity": (
        {
            "target": TARGET,
            "sensor": {"kind": "position-velocity", "sigma": 30, "sigma_velocity": 2},
            "start": "two-scan",
        },
        {OF_POSITIONS: PER_AXIS, OF_SCANS: SCANS, OF_READINGS: READING},
    ),
    "range-azimuth": (
        {"target": TARGET, "sensor": RADAR, "start": "two-scan"},
        {("kf",): LINEAR, OF_POSITIONS: PER_AXIS},
    ),
    "range-azimuth-doppler": (
        {
            "target": TARGET,
            "sensor": {**RADAR, "kind": "range-azimuth-doppler", "sigma_range_rate": 1},
            "start": "two-scan",
        },
        {("kf",): LINEAR, OF_POSITIONS: PER_AXIS, OF_SCANS: SCANS, OF_READINGS: READING},
    ),
    "bearing": (
        {
            "target": TARGET,
            "sensor": {"kind": "bearing", "sigma_mrad": 5},
            "start": KNOWN_ROUGHLY,
        },
        {("kf",): LINEAR, OF_POSITIONS: PER_AXIS, OF_SCANS: SCANS, OF_READINGS: READING},
    ),
    "range": (
        {
            "target": TARGET,
            "sensor": {"kind": "range", "at": [500, -500], "sigma": 5},
            "start": KNOWN_ROUGHLY,
        },
        {("kf",): LINEAR, OF_POSITIONS: PER_AXIS, OF_SCANS: SCANS, OF_READINGS: READING},
    ),
    "two sensors": (
        {
            "target": TARGET,
            "sensor": [
                {**RADAR, "at": [500, -500], "detection": 0.7},
                {"kind": "bearing", "sigma_mrad": 2, "period": 3},
            ],
            "start": "two-scan",
        },
        {("kf",): LINEAR, OF_POSITIONS: PER_AXIS, OF_SCANS: SCANS, OF_READINGS: READING},
    ),
    "range-azimuth-elevation": (
        {
            "target": SPACE,
            "sensor": {
                **RADAR,
                "kind": "range-azimuth-elevation",
                "sigma_elevation_mrad": 5,
            },
            "start": "two-scan",
        },
        {
            ("kf",): LINEAR,
            OF_POSITIONS: "a target in the plane",
            (*OF_SCANS, "gaussian-sum"): "a target in the plane",
            OF_READINGS: READING,
        },
    ),
}
OURS = [
    k
    for k, c in kinds("filters").items()
    if c.__module__.startswith("trackbench.") and not c.runs_program
]
CASES = [(name, kind) for name in PROBLEMS for kind in OURS if kind not in SCALAR]


def config(folder: Path, problem: str, kind: str) -> Path:
    scenario = {"kind": "tracking", "last": 12, **PROBLEMS[problem][0]}
    tracker = {"kind": kind, **NEEDED.get(kind, {})}
    path = folder / "c.yaml"
    data = {"name": "c", "scenario": scenario, "filters": {"F": tracker}, "runs": 4}
    path.write_text(yaml.safe_dump(data))
    return path


@pytest.mark.parametrize(("problem", "kind"), CASES)
def test_it_runs_or_is_refused(problem: str, kind: str, tmp_path: Path) -> None:
    path = config(tmp_path, problem, kind)
    refused = PROBLEMS[problem][1]
    reason = next((why for group, why in refused.items() if kind in group), None)
    if reason is not None:
        with pytest.raises(UserError) as error:
            load(path)
        assert f"`{kind}` works only with {reason}; " in str(error.value)
        return
    (point,) = load(path).points
    task = BlockTask(point.scenario, point.filters["F"], 1, 0, 4, 4, predictive_metrics=TOLD)
    found = run_block(task).per_run
    assert np.isfinite(found["rmse_position"]).all()
    assert (found["lost"] == 0.0).all()
    assert ("log_score" in found) is (kind not in SCORELESS)
    for metric in {"log_score", "anis"} & found.keys() if kind not in SCORELESS else ():
        assert np.isfinite(found[metric]).all(), metric
    for metric in ("pit_px", "pit_nees", "coverage_90"):
        assert ((found[metric] >= 0.0) & (found[metric] <= 1.0)).all(), metric
    assert (found["crps_px"] > 0.0).all()


@pytest.mark.parametrize("problem", [p for p in PROBLEMS if p != "range-azimuth-elevation"])
def test_most_filters_run_on_a_planar_sensor(problem: str) -> None:
    refused = {kind for group in PROBLEMS[problem][1] for kind in group}
    assert len(set(OURS) - refused - set(SCALAR)) >= 20
