"""Every filter on every sensor: it runs for ten steps, or is refused with a reason."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from trackbench.config.load import load
from trackbench.errors import UserError
from trackbench.evaluation.block_task import BlockTask, Kind
from trackbench.evaluation.run_blocks_side_by_side import run_block
from trackbench.registry import kinds

MANEUVERS = "motions: [{kind: cv, q: 0.1}, {kind: ca, q: 1.0e-3}], "
MANEUVERS += "transition: [[0.95, 0.05], [0.05, 0.95]]"
NEEDED: dict[str, dict[str, Any]] = yaml.safe_load(f"""
adaptive-kf: {{nmf: {{q: 0.1}}, mf: {{q: 1.0e-3}}, detector: {{eta: 20, window_s: 5}}}}
vdf: {{nmf: {{q: 0.1}}, mf: {{q: 1.0e-3}}, eta: 20}}
input-estimation: {{motion: {{q: 0.1}}, window_s: 5, min_window_s: 1}}
alpha-beta: {{q: 0.1}}
imm: {{{MANEUVERS}}}
mmpf: {{{MANEUVERS}, N: 200}}
gaussian-sum: {{split: 9, span: 2.0}}
pfde: {{N: 20, G: 3}}
hdepf: {{N: 20, G: 3}}
""")
PARTICLES = ("pf", "rpf", "jitter-pf", "apf", "epf", "upf", "mpf", "los-rbpf", "gpf", "enkf", "edh")
NEEDED |= {kind: {"N": 60} for kind in PARTICLES}
LINEAR = "a linear sensor"
PER_AXIS = "a sensor of planar positions, as it works axis by axis (try imm, or cmkf)"
SCANS = "a start from two scans of a radar at the origin"
READING = "a sensor of range and azimuth"
PLANE = "a target in the plane"
SCALAR = ("grid", "grid-2d", "inversion")
TOLD: tuple[Kind, ...] = ("score", "prediction", "calibration", "crps")
SCORELESS = ("prior-mean", "conversion")  # one looks at no measurement, one has no prediction
OF_POSITIONS = ("adaptive-kf", "alpha-beta", "input-estimation", "vdf")
OF_SCANS = ("conversion", "los-rbpf", "mpf")
OF_READINGS = ("cmkf", "mcaekf")
SCENARIOS: dict[str, dict[str, Any]] = yaml.safe_load("""
position: {sensor: {kind: position, sigma: 30}}
range-azimuth: {sensor: &radar {kind: range-azimuth, sigma_range: 20, sigma_azimuth_mrad: 5}}
range-azimuth-doppler:
  sensor: {<<: *radar, kind: range-azimuth-doppler, sigma_range_rate: 1}
bearing:
  sensor: {kind: bearing, sigma_mrad: 5}
  start: &roughly {kind: gaussian, sigma: [60, 5, 60, 5]}
range: {sensor: {kind: range, at: [500, -500], sigma: 5}, start: *roughly}
two sensors:
  sensor: [{<<: *radar, at: [500, -500], detection: 0.7}, {kind: bearing, sigma_mrad: 2, period: 3}]
range-azimuth-elevation:
  launch: {z: 900, vz: -3}
  sensor: {<<: *radar, kind: range-azimuth-elevation, sigma_elevation_mrad: 5}
""")
OTHERS = {("kf",): LINEAR, OF_POSITIONS: PER_AXIS, OF_SCANS: SCANS, OF_READINGS: READING}
REFUSED: dict[str, dict[tuple[str, ...], str]] = dict.fromkeys(SCENARIOS, OTHERS) | {
    "position": {OF_SCANS: SCANS, OF_READINGS: READING},
    "range-azimuth": {("kf",): LINEAR, OF_POSITIONS: PER_AXIS},
    "range-azimuth-elevation": OTHERS
    | {OF_POSITIONS: PLANE, OF_SCANS: PLANE, ("gaussian-sum",): PLANE},
}
OURS = [
    k
    for k, c in kinds("filters").items()
    if c.__module__.startswith("trackbench.") and not c.runs_program
]
CASES = [(name, kind) for name in SCENARIOS for kind in OURS if kind not in SCALAR]


def config(folder: Path, problem: str, kind: str) -> Path:
    launch = {"x": 3000, "y": 2000, "vx": -20, "vy": 15}
    own = SCENARIOS[problem]
    launch |= own.get("launch", {})
    target = {"kind": "driven", "motion": {"kind": "cwna", "q": 0.1}, "launch": launch}
    scenario = {"kind": "tracking", "last": 12, "target": target, "sensor": own["sensor"]}
    scenario["start"] = own.get("start", "two-scan")
    tracker = {"kind": kind, **NEEDED.get(kind, {})}
    path = folder / "c.yaml"
    data = {"name": "c", "scenario": scenario, "filters": {"F": tracker}, "runs": 4}
    path.write_text(yaml.safe_dump(data))
    return path


@pytest.mark.parametrize(("problem", "kind"), CASES)
def test_it_runs_or_is_refused(problem: str, kind: str, tmp_path: Path) -> None:
    path = config(tmp_path, problem, kind)
    reason = next((why for group, why in REFUSED[problem].items() if kind in group), None)
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


@pytest.mark.parametrize("problem", [p for p in SCENARIOS if p != "range-azimuth-elevation"])
def test_most_filters_run_on_a_planar_sensor(problem: str) -> None:
    refused = {kind for group in REFUSED[problem] for kind in group}
    assert len(set(OURS) - refused - set(SCALAR)) >= 20
