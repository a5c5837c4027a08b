"""Every key of every filter changes something, or is refused where it does not."""

from dataclasses import fields
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

import numpy as np
import pytest
import yaml

from trackbench.config.experiment import Point
from trackbench.config.load import load
from trackbench.errors import Problem, UserError
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.run_filter import run_filter
from trackbench.field_types import hints_of
from trackbench.registry import kinds

Keys = dict[str, Any]
RUNS = 4
PROBLEMS: dict[str, Keys] = yaml.safe_load("""
merwe: &merwe
  target: {kind: driven, motion: sine-gamma, launch: {x: 1.0}}
  sensor: {kind: square-then-line, R: 0.1, switch: 5}
  start: {kind: gaussian, sigma: [0.5]}
  first: 1
  last: 9
sharp: {<<: *merwe, sensor: {kind: square-then-line, R: 1.0e-7, switch: 5}}
radar: &radar
  target: &plane
    kind: driven
    motion: {kind: cwna, q: 10.0}
    launch: {x: 3000, y: 2000, vx: -40, vy: 30}
  sensor: &eye {kind: range-azimuth, sigma_range: 5, sigma_azimuth_mrad: 30}
  start: two-scan
  last: 7
sharp radar: {<<: *radar, sensor: {<<: *eye, sigma_range: 1.0e-3}, last: 4}
position:
  target: {<<: *plane, motion: {kind: singer, sigma: 1, tau: 20}}
  sensor: {kind: position, sigma: 5, outliers: {share: 0.2, times: 20}}
  start: {kind: gaussian, sigma: [10, 5, 10, 5]}
  last: 40
  assume: {motion: {kind: cwna, q: 10.0}}
pair:
  target:
    kind: driven
    motion: {kind: map, components: [a, b], next: {a: a + 0.1*b, b: b - sin(a)}, Q: [0.01, 0.1]}
  sensor: {kind: function, h: {z: a}, R: 0.1}
  start: {kind: gaussian, sigma: [0.3, 0.3]}
  last: 3
""")
"""In the order in which a key's effect is looked for."""
MERWE, PLANE = PROBLEMS["merwe"], PROBLEMS["radar"]["target"]
LAUNCH = PLANE["launch"]
NEEDED: dict[str, Keys] = yaml.safe_load("""
adaptive-kf: {nmf: {q: 0.1}, mf: {q: 0.1}, detector: {eta: 20, window_s: 5, start: 3}}
vdf: {nmf: {q: 0.1}, mf: {q: 0.1}, eta: 20}
input-estimation: {motion: {q: 0.1}, window_s: 8, min_window_s: 1}
alpha-beta: {q: 0.1}
imm: &two
  motions: [{kind: cv, q: 1.0}, {kind: ca, q: 1.0}]
  transition: [[0.9, 0.1], [0.1, 0.9]]
mmpf: *two
gaussian-sum: {split: 9, span: 2.0, kept: 30}
""")
OTHER: Keys = yaml.safe_load("""
{N: 16, G: 2, F: 0.5, CR: 0.3, T0: 1.0, rho: 0.1, moves: 2, defensive: 0.3, smooth: true,
 centered: true, inflation: 1.2, fading: 1.2, Q: 0.5, R: 0.3, P0: 0.2, gate: 0.5, alpha: 0.5,
 beta: 0.3, kappa: 1.5, robust: {kind: huber, k: 0.3}, nodes: 96, deviations: 8.0, reach: 4.0,
 order: 4, iterations: 2, steps: 5, n_sigma: 4.0, ess_threshold: 0.7, boost: 2, boost_scans: 2,
 bandwidth_scale: 0.3, split: 11, span: 1.5, kept: 5, merge_within: 1.0, initial: [0.7, 0.3],
 eta: 5.0, window_s: 4.0, min_window_s: 3.0, gamma: 0.6, p: 4, Ta: 1.0, q: 5, nmf: {q: 5},
 mf: {q: 9}, motion: {q: 5}, dlw: {n: 3}, exit: {Ta: 500}, filter: ukf,
 detector: {eta: 5, window_s: 5, start: 3}, motions: [{kind: cv, q: 1.0}, {kind: cv, q: 1.0}],
 transition: [[0.5, 0.5], [0.5, 0.5]]}
""")
"""Another value of a key that is neither a word nor true or false."""
SETTINGS: dict[str, list[Keys]] = yaml.safe_load("""
pf: [{boost: 2, boost_scans: 2}]
mpf: [{regularize: none}]
epf: [{defensive: 1.0}]
upf: [{defensive: 1.0}]
pfde: [{reading: {estimate_from: before}}, {G: 0}]
hdepf: [{reading: {select: greedy}, N: 30}, {reading: {estimate_from: before}}, {G: 0}, {defensive: 1.0}]
alpha-beta: [{alpha: 0.5, beta: 0.3}]
""")
"""Keys beside which others may be idle."""
TOGETHER = {"alpha-beta": {"alpha": {"beta": 0.3}, "beta": {"alpha": 0.5}}}
"""Keys that are given together or not at all."""
EITHER = {"vdf": {"alpha": ("eta",)}}
"""Keys that are given instead of others."""
SAME = {
    "keep_best": "greedy selection never leaves the best point that a slot has visited",
    "weights": "without trials the target's arithmetic shows in the weights only if all underflow",
}
"""Keys that may change nothing in one of the SETTINGS and are not refused, with the reason."""
OURS = [
    kind
    for kind, c in kinds("filters").items()
    if c.__module__.startswith("trackbench.") and not c.runs_program
]
CASES = [(kind, setting) for kind in OURS for setting in ({}, *SETTINGS.get(kind, ()))]


def others(hint: Any, key: str, has: Any) -> list[Any]:
    """Further values of a key: all of its words, or one."""
    if hint is bool:
        return [not has]
    words = [
        w for part in (hint, *get_args(hint)) if get_origin(part) is Literal for w in get_args(part)
    ]
    return [word for word in words if word != has] or [OTHER[key]]


def variants(kind: str, setting: Keys) -> dict[str, Keys]:
    """The setting itself, and with another value of one key: by its name and a number."""
    cls = kinds("filters")[kind]
    plain = {"N": 12, "G": 3}
    base = {key.name: plain[key.name] for key in fields(cls) if key.name in plain}
    base |= NEEDED.get(kind, {}) | setting
    out: dict[str, Keys] = {"base": base}
    for field in fields(cls):
        if not field.init or (field.name in setting and field.name != "reading"):
            continue
        if field.name == "reading":
            for key in fields(hints_of(cls)["reading"]):
                given = setting.get("reading", {})
                values = others(hints_of(hints_of(cls)["reading"])[key.name], key.name, key.default)
                for i, value in enumerate(values if key.name not in given else ()):
                    out[f"{key.name} {i}"] = {
                        **base,
                        "reading": {**given, key.name: value},
                    }
            continue
        values = others(hints_of(cls)[field.name], field.name, base.get(field.name, field.default))
        for i, value in enumerate(values):
            without = EITHER.get(kind, {}).get(field.name, ())
            keys = {k: v for k, v in base.items() if k not in without}
            keys |= TOGETHER.get(kind, {}).get(field.name, {}) | {field.name: value}
            out[f"{field.name} {i}"] = keys
    return out


def point_of(
    folder: Path, problem: str, filters: dict[str, Keys]
) -> tuple[Point | None, dict[str, str]]:
    """Those of the filters that are not refused, if any, and why others are, by label."""
    path, refused = folder / "c.yaml", dict[str, str]()
    data = {"name": "c", "scenario": {"kind": "tracking", **PROBLEMS[problem]}, "runs": RUNS}
    for _ in range(3):  # the mistakes, then the idle keys, then none
        left = {label: keys for label, keys in filters.items() if label not in refused}
        if "base" not in left:
            break
        path.write_text(yaml.safe_dump({**data, "filters": left}))
        try:
            return load(path).points[0], refused
        except UserError as error:
            found = [p for p in error.problems if isinstance(p, Problem)]
            refused |= {p.path.split(".")[1]: p.message for p in found}
    return None, refused


def numbers(point: Point, label: str) -> bytes:
    """All estimates and diagnostics of a filter."""
    told = ("score", "prediction")
    task = BlockTask(
        point.scenario, point.filters[label], 1, 0, RUNS, RUNS, predictive_metrics=told
    )
    with np.errstate(all="ignore"):
        found = run_filter(task, task.data, RUNS)
    assert found.cov is not None
    rows = [found.diagnostics[name] for name in sorted(found.diagnostics)]
    return b"".join(part.tobytes() for part in (found.mean, found.nees, found.cov, *rows))


@pytest.mark.parametrize(("kind", "setting"), CASES, ids=str)
def test_it_changes_something_or_is_refused(kind: str, setting: Keys, tmp_path: Path) -> None:
    filters = {label: {"kind": kind, **keys} for label, keys in variants(kind, setting).items()}
    left = {label.split()[0] for label in filters} - {"base"}
    refused_there: set[str] = set()
    for problem in PROBLEMS:
        if not left - refused_there:
            break
        wanted = {
            label: keys for label, keys in filters.items() if label.split()[0] in {*left, "base"}
        }
        point, refused = point_of(tmp_path, problem, wanted)
        if point is None:
            continue
        refused_there |= {label.split()[0] for label in refused}
        base = numbers(point, "base")
        for label in point.filters:
            if label.split()[0] in left and numbers(point, label) != base:
                left.remove(label.split()[0])
    presets = kinds("filters")[kind].presets.values()
    # A preset may stand beside any key.
    usual = {key for preset in presets for key in preset}
    usual |= {key for preset in presets for key in preset.get("reading", {})}
    assert left - refused_there <= ({*SAME, *usual} if setting or kind == "pfde" else set())


def told(folder: Path, keys: Keys, **more: Any) -> list[str]:
    """Lines that a config with this filter on Merwe's model is answered."""
    path = folder / "c.yaml"
    scenario = {"kind": "tracking", **MERWE}
    path.write_text(
        yaml.safe_dump({"name": "c", "scenario": scenario, "filters": {"F": keys}, **more})
    )
    try:
        load(path)
    except UserError as error:
        return [f"{p.path}: {p.message}" for p in error.problems if isinstance(p, Problem)]
    return []


GREEDY: Keys = {"kind": "hdepf", "reading": {"select": "greedy"}}


def test_the_line_says_what_makes_the_key_idle(tmp_path: Path) -> None:
    why = "has no effect with `select: greedy`; leave it out"
    assert told(tmp_path, {**GREEDY, "T0": 5, "rho": 0.5}) == [
        f"filters.F.T0: {why}",
        f"filters.F.rho: {why}",
    ]
    assert told(tmp_path, {"kind": "hdepf", "defensive": 1, "Q": 2.5}) == [
        "filters.F.Q: has no effect with `defensive: 1`; leave it out"
    ]
    before = {"kind": "hdepf", "reading": {"estimate_from": "before", "final_weights": "uniform"}}
    assert told(tmp_path, before) == [
        "filters.F.reading.final_weights: has no effect with `estimate_from: before`; leave it out"
    ]


def test_a_grid_varies_a_nested_key_of_a_filter_without_the_mapping(tmp_path: Path) -> None:
    assert (
        told(tmp_path, {"kind": "hdepf"}, grid={"filters.F.reading.bounds": ["none", "cloud"]})
        == []
    )


def test_defaults_and_what_a_grid_uses_somewhere_may_stand(tmp_path: Path) -> None:
    assert told(tmp_path, {**GREEDY, "T0": 100, "rho": 0.9}) == []
    grid = {"filters.F.reading.select": ["metropolis", "greedy"]}
    assert told(tmp_path, {"kind": "hdepf", "T0": 5}, grid=grid) == []
    assert len(told(tmp_path, {**GREEDY, "T0": 5}, grid={"filters.F.G": [1, 2]})) == 1


def test_settings_without_the_key_that_they_belong_to(tmp_path: Path) -> None:
    pf = {"kind": "pf"}
    assert told(tmp_path, pf, min_runs=7) == [
        "min_runs: has no effect without `until`; leave it out"
    ]
    assert told(tmp_path, pf, tuning={"runs": 7}) == [
        "tuning: has no effect without `tune`; leave it out"
    ]
    # Defaults may stand, as in the config of a results folder, and an override may empty the other key.
    assert told(tmp_path, pf, min_runs=1000, tuning={"runs": 100}) == []
    assert told(tmp_path, pf, min_runs=7, until={}, tuning={"runs": 7}, tune={}) == []


def test_idle_keys_come_with_the_mistakes_of_other_filters(tmp_path: Path) -> None:
    filters = {"A": {**GREEDY, "T0": 5}, "B": {"kind": "kf"}, "C": {"kind": "pf", "M": 3}}
    lines = told(tmp_path, {}, filters=filters, key_figure="nope")
    assert "filters.A.T0: has no effect with `select: greedy`; leave it out" in lines
    assert "key_figure: 'nope' is not a figure here; there are none: leave this key out" in lines
    assert sum(line.startswith("filters.B: `kf` works only with") for line in lines) == 2
    assert sum(line.startswith("filters.C.M: unknown key") for line in lines) == 1


def test_a_motion_is_not_assumed_where_the_filter_brings_its_own(tmp_path: Path) -> None:
    position = PROBLEMS["position"]
    assumed = {"assume": {"motion": {"kind": "ca", "q": 1.0}}}
    for kind in ("adaptive-kf", "vdf", "input-estimation", "alpha-beta", "imm", "mmpf"):
        keys = {"kind": kind, **NEEDED[kind], **assumed}
        (line,) = told(tmp_path, keys, scenario={"kind": "tracking", **position})
        assert line.startswith("filters.F.assume.motion: has no effect as this filter has")
