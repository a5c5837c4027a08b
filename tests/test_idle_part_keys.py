"""Every key of every motion, sensor, start and simulated target changes something."""

import copy
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from tests.test_idle_keys import LAUNCH, MERWE, PLANE, numbers
from trackbench.config.load import load
from trackbench.registry import Group, kinds

Keys = dict[str, Any]
MOTIONS: dict[str, Keys] = yaml.safe_load("""
ar1: {q: 1.0}
ca: {q: 1.0}
ct: {turn_rate_deg_s: 3.0, q: 1.0}
ct-unknown: {q: 1.0, turn_walk_deg_s: 1.0}
cv: {q: 1.0}
cwna: {q: 1.0}
singer: {sigma: 1.0, tau: 10.0}
""")
SENSORS: dict[str, Keys] = yaml.safe_load("""
bearing: {sigma_mrad: 5.0}
polar-position: {sigma_range: 5.0, sigma_azimuth_mrad: 5.0}
position: {sigma: 5.0}
range: {sigma: 5.0}
range-azimuth: {sigma_range: 5.0, sigma_azimuth_mrad: 5.0}
range-azimuth-doppler: {sigma_range: 5.0, sigma_azimuth_mrad: 5.0, sigma_range_rate: 1.0}
velocity: {sigma: 1.0}
""")
IN_SPACE: dict[str, Keys] = yaml.safe_load("""
position-3d: {sigma: 5.0}
range-azimuth-elevation: {sigma_range: 5.0, sigma_azimuth_mrad: 5.0, sigma_elevation_mrad: 5.0}
""")
LEG = {"start": 2, "end": 5, "ax": 1.0}
TARGETS: dict[str, Keys] = {
    "driven": {"motion": {"kind": "cwna", "q": 1.0}, "launch": LAUNCH},
    "legs": {"launch": LAUNCH, "legs": [LEG], "settle": 1.0, "edge": 1.0},
    "random-legs": {
        **{"area": 900.0, "speed": [9, 12], "legs": [2, 3], "leg_steps": [2, 3]},
        **{"sigma_along": 0.1, "across": 0.1, "straight_steps": [1, 2]},
    },
    "waypoints": {"x": [0, 90, 150], "y": [0, 40, 90], "speed": 20.0},
}
STARTS: dict[str, Keys] = yaml.safe_load("""
gaussian: {sigma: [10, 5, 10, 5]}
given: {mean: [3000, -40, 2000, 30], sigma: [9, 5, 9, 5]}
uniform: {low: [2900, -50, 1900, 20], high: [3100, 0, 2100, 60]}
mixture: {parts: [{mean: [3000, -40, 2000, 30], sigma: [9, 5, 9, 5]}]}
one-scan: {sigma_velocity: 9.0}
""")
POSITION = {"kind": "position", "sigma": 5}
PLAIN: Keys = {"T": 2, "target": PLANE, "sensor": POSITION, "last": 9}
PLAIN["start"] = {"kind": "gaussian", "sigma": [10, 5, 10, 5]}
WITHOUT_LAUNCH = {"kind": "driven", "motion": PLANE["motion"]}
SPACE: Keys = {"target": PLANE | {"launch": {**LAUNCH, "z": 900, "vz": 1}}, "last": 9}
SPACE["start"] = {"kind": "gaussian", "sigma": [10, 5] * 3}
SCALAR: Keys = yaml.safe_load("""
target: {kind: driven, motion: {kind: ar1, q: 1.0}, launch: {x: 1.0}}
sensor: {kind: scalar, sigma: 1.0}
start: {kind: gaussian, sigma: [0.5]}
last: 9
""")
ASSUMED = {"assume": {"motion": {"kind": "cwna", "q": 10.0}}, "start": "known"}
PRIOR = STARTS["mixture"]["parts"][0]
CASES: dict[tuple[Group, str], Keys] = {
    **{("motions", kind): PLAIN for kind in MOTIONS if kind != "ar1"},
    **{("sensors", k): PLAIN | {"sensor": {"kind": k, **keys}} for k, keys in SENSORS.items()},
    **{("sensors", k): SPACE | {"sensor": {"kind": k, **keys}} for k, keys in IN_SPACE.items()},
    **{("starts", k): PLAIN | {"start": {"kind": k, **keys}} for k, keys in STARTS.items()},
    **{
        ("targets", k): PLAIN | ASSUMED | {"target": {"kind": k, **keys}}
        for k, keys in TARGETS.items()
    },
    **{("motions", "ar1"): SCALAR, ("motions", "sine-gamma"): MERWE},
    **{("sensors", "scalar"): SCALAR, ("sensors", "square-then-line"): MERWE},
}
for kind in ("uniform", "mixture"):
    CASES["starts", kind] = CASES["starts", kind] | {"target": WITHOUT_LAUNCH}
OTHER: Keys = {
    "detection": 0.5,
    "outliers": {"share": 0.3, "times": 20},
    "bias": None,
    "period": 2,
    "offset": 1,
    "at": [50, 70],
    "platform": {"steps": [0, 9], "x": [10, 90], "y": [20, 50]},
    "motion": {"kind": "cwna", "q": 4.0},
    "launch": {**LAUNCH, "x": 3100},
    "polar": {"range_km": 3, "azimuth_deg": 20},
    "noise_gain": "printed",
    "sine_index": "old",
    "settle": 4.0,
    "edge": 4.0,
    "legs": [{**LEG, "ax": 2.0}],
    "straight_steps": [2, 3],
    "times": [0, 4, 8],
    "cov": np.diag([64, 16, 81, 25]).tolist(),
    "initial": {"px": 2000.0, "vy": 3.0},
    "z": [5, 6, 7],
    "low": [2800, -50, 1900, 20],
    "high": [3200, 0, 2100, 60],
    "parts": [PRIOR, PRIOR | {"mean": [3000, -40, 2600, 30]}],
}
"""Another value of a key that is no number and no list of numbers."""
BESIDE: dict[str, Keys] = {
    "offset": {"period": 2},
    "polar": {"launch": None, "polar": {"range_km": 4, "azimuth_deg": 20}},
    "times": {"speed": None, "times": [0, 5, 8]},
    "cov": {"sigma": None, "cov": np.diag([81, 25, 81, 25]).tolist()},
    "initial": {"launch": None, "initial": [3000, -40, 2000, 30]},
}
"""What else a key stands with; None: instead of."""
PART: dict[Group, str] = {
    **{"motions": "motion", "sensors": "sensor"},
    **{"starts": "start", "targets": "target"},
}


LEFT_OUT = {
    "range-azimuth-doppler": ("platform",),
    "range-azimuth-elevation": ("platform",),
    "legs": ("settled_error",),
}
"""Keys that a kind has and refuses, since it stands still, and one that changes a metric only."""


def another(key: str, value: Any) -> Any:
    """Another value of a key."""
    if key == "legs" and isinstance(value[0], int):
        return [end + 1 for end in value]
    if key in OTHER:
        return OTHER[key]
    if isinstance(value, list | tuple):
        return [another(key, part) for part in value]
    return value + 1 if isinstance(value, int) and key != "sigma" else 1.7 * value + 0.1


def test_every_kind_is_tried() -> None:
    from_files = {("targets", "measured"), ("targets", "recorded")}
    keyless = {("starts", "known"), ("starts", "two-scan")}
    ours = {
        (group, kind)
        for group in PART
        for kind, cls in kinds(group).items()
        if cls.__module__.startswith("trackbench.")
    }
    equations = {("motions", "map"), ("motions", "ode"), ("sensors", "function")}
    of_robots = {
        ("sensors", "landmark")
    }  # its state has a heading: see tests/models/test_landmark.py
    assert CASES.keys() == ours - from_files - keyless - equations - of_robots


@pytest.mark.parametrize(("group", "kind"), CASES, ids=str)
def test_a_key_changes_the_data_or_what_filters_make_of_them(
    group: Group, kind: str, tmp_path: Path
) -> None:
    base, cls = CASES[group, kind], kinds(group)[kind]
    places = [PART[group], *(["assume"] if kind in MOTIONS and kind != "ar1" else [])]
    idle = []
    for field in fields(cls):
        if field.init and field.name not in ("kind", *LEFT_OUT.get(kind, ())):
            found = [changes(group, kind, base, place, field, tmp_path) for place in places]
            idle += [field.name] * (not any(found))
    assert idle == []


def changes(group: Group, kind: str, base: Keys, place: str, field: Any, folder: Path) -> bool:
    """Return whether another value of the field gives other bytes."""
    keys = keys_of(group, kind, base) | BESIDE.get(field.name, {})
    keys = {name: value for name, value in keys.items() if value is not None}
    value = another(field.name, keys.get(field.name, field.default))
    if field.name == "at" and group == "sensors" and "z" in str(base["target"]):
        value = [*value, 10]
    if field.name == "bias":
        value = [0.3] * len(kinds(group)[kind].components)
    return made(base, place, keys, folder) != made(base, place, keys | {field.name: value}, folder)


def keys_of(group: Group, kind: str, base: Keys) -> Keys:
    """The kind and keys of the part that is varied."""
    if group == "motions":
        return {"kind": kind, **MOTIONS.get(kind, {})}
    part = base[PART[group]]
    return dict(part)


def made(base: Keys, place: str, keys: Keys, folder: Path) -> bytes:
    """Estimates of a particle filter, windows of the score, and the data."""
    whole = {"kind": "tracking", **copy.deepcopy(base)}
    if place == "assume":
        whole["assume"] = {"motion": keys}
    elif place == "motion":
        whole["target"]["motion"] = keys
    else:
        whole[place] = keys
    if keys.get("delay"):
        whole["assume"] = whole.get("assume", {}) | {"late": "drop"}
    data = {"name": "c", "runs": 4, "scenario": whole, "filters": {"F": {"kind": "pf", "N": 20}}}
    (folder / "c.yaml").write_text(yaml.safe_dump(data))
    point = load(folder / "c.yaml").points[0]
    windows = b"".join(mask.tobytes() for mask in point.scenario.windows.values())
    return numbers(point, "F") + windows
