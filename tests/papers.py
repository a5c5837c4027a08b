"""The three papers' scenarios under the few keys that tests vary, as objects and as YAML.

Each lays its changes over a shipped file of scenarios/, whose values are the defaults.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict
from math import ceil, sqrt
from typing import Any

from tests.conftest import EXPERIMENTS
from trackbench.config.build_components import build_kind
from trackbench.config.includes import deep_merge
from trackbench.models.assume import Assume
from trackbench.models.base import Motion
from trackbench.scenarios.targets.initial_state import Launch
from trackbench.scenarios.targets.legs import Leg
from trackbench.scenarios.tracking import Tracking
from trackbench.yaml_source import Source, read

Mapping = dict[str, Any]

_MERWE = {"w", "phi1", "gamma_shape", "gamma_rate", "sine_index"}, {"phi2", "phi3", "R", "switch"}
_BANANA = {"range_km", "azimuth_deg", "velocity_radial", "velocity_cross"}
_RADAR = {"sigma_range", "sigma_azimuth_mrad"}


def merwe(**keys: Any) -> Tracking:
    """Van der Merwe's scalar model up to step T, its first state of mean x1 and variance P1."""
    return _made(_merwe(**keys))


def merwe_text(**keys: Any) -> str:
    """The same as a line of YAML."""
    return json.dumps(_merwe(**keys))


def banana(**keys: Any) -> Tracking:
    """The banana paper's long-range target."""
    return _made(_banana(**keys))


def banana_text(**keys: Any) -> str:
    """The same as a line of YAML."""
    return json.dumps(_banana(**keys))


def maneuver(**keys: Any) -> Tracking:
    """The adaptive Kalman filter paper's track, up to ``duration`` seconds."""
    return _made(_maneuver(**keys))


def maneuver_text(**keys: Any) -> str:
    """The same as a line of YAML."""
    return json.dumps(_maneuver(**keys))


def shipped(name: str) -> Mapping:
    """The keys of a file of scenarios/, those of the file that it uses included."""
    (path,) = EXPERIMENTS.glob(f"*/scenarios/{name}")
    data: Mapping = read(path).data
    base = data.pop("use", None)
    return deep_merge(shipped(base), data, by_kind=True) if base else data


def _merwe(
    T: int = 50,
    x1: float = 1.0,
    P1: float = 0.0,
    first: int = 1,
    lost_beyond: float | None = 10.0,
    **keys: Any,
) -> Mapping:
    moved, seen = ({k: keys.pop(k) for k in group if k in keys} for group in _MERWE)
    assert not keys, keys
    switch = seen.get("switch", 30)
    windows = [
        {"name": f"k<={switch}", "last": switch},
        {"name": f"k>{switch}", "first": switch + 1},
    ]
    top = {
        "first": first,
        "last": T,
        "begin": first,
        "target": {"motion": moved, "launch": {"x": x1}},
        "sensor": seen,
        "score": {"windows": windows if switch < T else windows[:1], "lost_beyond": lost_beyond},
    }
    if P1:
        top["start"] = {"kind": "gaussian", "sigma": [sqrt(P1)]}
    return deep_merge(shipped("merwe.yaml"), top)


def _banana(
    scans: int = 100,
    rmse_window: tuple[int, int] | None = None,
    lost_sigmas: float | None = 10.0,
    until: Sequence[int] = (),
    **keys: Any,
) -> Mapping:
    windows = [{"name": f"k<={k}", "last": k} for k in until]
    score: Mapping = {"lost_sigmas": lost_sigmas, "windows": windows}
    if rmse_window is not None:
        score["steps"] = list(rmse_window)
    top: Mapping = {"last": scans, "score": score, "target": {}}
    if "T" in keys:
        top["T"] = keys.pop("T")
    if "q" in keys:
        top["target"]["motion"] = {"q": keys.pop("q")}
    top["target"]["polar"] = {k: keys.pop(k) for k in _BANANA & keys.keys()}
    top["sensor"] = {k: keys.pop(k) for k in _RADAR & keys.keys()}
    assert not keys, keys
    return deep_merge(shipped("banana.yaml"), top)


def _maneuver(
    T: float = 1.0,
    duration: float = 1700.0,
    truth: str = "corrected",
    legs: Sequence[Leg] | None = None,
    launch: Launch | None = None,
    score_from: float = 20.0,
    lost_beyond: float | None = None,
    sigma: float = 100.0,
    motion: Mapping | None = None,
    **target: Any,
) -> Mapping:
    file = "maneuver.yaml" if truth == "corrected" else "maneuver-as-printed.yaml"
    top: Mapping = {
        "T": T,
        "last": round(duration / T),
        "sensor": {"sigma": sigma},
        "score": {"steps": [ceil(score_from / T), None], "lost_beyond": lost_beyond},
        "target": target,
    }
    if legs is not None:
        target["legs"] = [asdict(leg) for leg in legs]
    if launch is not None:
        target["launch"] = asdict(launch)
    if motion is not None:
        top["assume"] = {"motion": motion}
    return deep_merge(shipped(file), top)


def _made(keys: Mapping) -> Tracking:
    source = Source({"scenario": keys})
    built = build_kind("scenarios", source, ("scenario",))
    source.check()
    assert isinstance(built, Tracking)
    return built


def seen_as(scenario: Tracking, motion: Motion) -> Tracking:
    """The scenario as a filter sees it that assumes this motion."""
    return scenario.with_assumptions(Assume(motion=motion))
