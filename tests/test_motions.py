"""Every filter on every motion: as good as an extended Kalman filter, or refused.

The motions turn and accelerate so hard that a filter which reads only some of F and Q is off by many
standard deviations after a step or two. Their noise is that of the sensor, so that particles last.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from trackbench.config.experiment import Point
from trackbench.config.load import load
from trackbench.core.arrays import Array
from trackbench.errors import UserError
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.run_blocks_side_by_side import run_block
from trackbench.registry import kinds

Keys = dict[str, Any]
MOTIONS: dict[str, Keys] = {
    "cv": {"kind": "cv", "q": 3.3},
    "cv-printed": {"kind": "cv", "q": 10.0, "noise_gain": "printed"},
    "cwna": {"kind": "cwna", "q": 10.0},
    "ca": {"kind": "ca", "q": 1.0, "initial_std": 1.0},
    "singer": {"kind": "singer", "sigma": 6.0, "tau": 0.5},
    "ct": {"kind": "ct", "turn_rate_deg_s": 20.0, "q": 30.0},
    "ct-unknown": {"kind": "ct-unknown", "q": 10.0, "turn_walk_deg_s": 3.0},
}
ASSUMED = MOTIONS | {"ct": {"kind": "ct", "turn_rate_deg_s": 5.0, "q": 30.0}}
LAUNCH = {"x": 3000, "y": 2000, "vx": -40, "vy": 30}
RADAR = {"kind": "range-azimuth", "sigma_range": 5, "sigma_azimuth_mrad": 1}
SENSORS: dict[str, Keys] = {
    "position": {
        "sensor": {"kind": "position", "sigma": 5},
        "start": {"kind": "gaussian", "sigma": [10, 5, 10, 5]},
        "last": 4,
    },
    "radar": {"sensor": RADAR, "start": "two-scan", "last": 5},
}
RUNS, N = 24, 400
ERRORS = ("rmse_position", "rmse_velocity")
OWN: Keys = {"kind": "cv", "q": 10.0}
"""Motion of the filters that bring their own."""
BRINGS_ITS_OWN: dict[str, Keys] = {
    "adaptive-kf": {"nmf": {"q": 10}, "mf": {"q": 1}, "detector": {"eta": 1e6, "window_s": 1}},
    "vdf": {"nmf": {"q": 10}, "mf": {"q": 1}, "eta": 1e6, "gamma": 0.1},
    "input-estimation": {"motion": {"q": 10}, "window_s": 1, "min_window_s": 1, "eta": 1e6},
}
JUMPS: Keys = {"transition": [[0.9, 0.1], [0.1, 0.9]]}
FIXED_GAIN = "alpha-beta"
PROPOSING = ("epf", "upf", "hdepf", "pfde")
EXACT = ("kf", "iekf", "ukf", "ckf", "ghkf", "iplf", "imm", *BRINGS_ITS_OWN)
"""Equal to the extended filter where motion and sensor are linear."""
POLAR = ("cmkf", "mcaekf", "conversion", "mpf", "los-rbpf")
OTHERS = ("prior-mean", "conversion", "grid", "grid-2d", "inversion")  # no posterior; small states
OURS = [
    kind
    for kind, c in kinds("filters").items()
    if c.__module__.startswith("trackbench.") and not c.runs_program
]
CASES = [
    (sensor, motion, assumed)
    for sensor in SENSORS
    for motion in MOTIONS
    for assumed in (False, True)
]


def entry(kind: str, motion: Keys) -> Keys:
    """A filter's config, the motion in the place of all motions of a filter of several."""
    keys: Keys = {"kind": kind, **BRINGS_ITS_OWN.get(kind, {})}
    if kind in ("imm", "mmpf"):
        keys |= {**JUMPS, "motions": [motion, motion]}
    if kind == FIXED_GAIN:
        keys["q"] = OWN["q"]
    if kind == "gaussian-sum":
        keys |= {"split": 9, "span": 2.0}
    fields = kinds("filters")[kind].__dataclass_fields__  # type: ignore[attr-defined]
    return keys | ({"N": N} if "N" in fields else {}) | ({"G": 3} if "G" in fields else {})


def loaded(folder: Path, scenario: Keys, filters: dict[str, Keys]) -> Point:
    """A config of these filters; raises UserError with what is refused."""
    path = folder / "c.yaml"
    data = {"name": "c", "scenario": scenario, "filters": filters, "runs": RUNS}
    path.write_text(yaml.safe_dump(data))
    (point,) = load(path).points
    return point


def result(point: Point, label: str) -> dict[str, Array]:
    """Numbers per run of one filter."""
    assume = point.assumed.get(label)
    task = BlockTask(point.scenario, point.filters[label], 1, 0, RUNS, RUNS, assume=assume)
    return run_block(task).per_run


def is_right(found: dict[str, Array], best: dict[str, Array]) -> bool:
    """Its squared errors exceed the best by no more than four standard errors and a twentieth.

    Weighted means may have one part in their effective particles more, which differ from step to step:
    four parts of their mean number.
    """
    effective = N * float(found["ess"].mean()) if "ess" in found else np.inf
    for name in ERRORS:
        square, least = np.square(found[name]), np.square(best[name])
        more = (square - least) / least.mean()
        error = more.std() / np.sqrt(RUNS)
        if not (error < 2.0 and more.mean() <= 4.0 * error + 0.05 + 4.0 / effective):
            return False
    return True


def refused(sensor: str, motion: str) -> set[str]:
    """Kinds that a config may not have there."""
    kind = MOTIONS[motion]["kind"]
    out = {"grid", "grid-2d", "inversion", *(POLAR if sensor == "position" else ("kf", FIXED_GAIN))}
    if sensor == "radar":
        out |= BRINGS_ITS_OWN.keys()
    if kind not in ("cv", "cwna"):
        out |= {"mpf", "los-rbpf"}
    if kind in ("ca", "singer", "ct-unknown"):
        out |= {"conversion"}
    if kind == "ct-unknown":
        out |= {"kf"}
    if kind not in ("cwna", "singer"):  # a singular Q has no density to weigh by
        out |= {*PROPOSING}
    return out


@pytest.mark.parametrize(("sensor", "motion", "assumed"), CASES)
def test_it_is_right_or_refused(sensor: str, motion: str, assumed: bool, tmp_path: Path) -> None:
    own = ASSUMED[motion] if assumed else MOTIONS[motion]
    target = {"kind": "driven", "motion": OWN if assumed else own, "launch": LAUNCH}
    scenario: Keys = {"kind": "tracking", "target": target, **SENSORS[sensor]}
    if assumed:
        scenario["assume"] = {"motion": own}
    judge(tmp_path, scenario, own, refused(sensor, motion), linear=sensor == "position")


@pytest.mark.parametrize("motion", ["cwna", "singer", "ct", "ct-unknown"])
def test_it_is_right_or_refused_where_steps_differ(motion: str, tmp_path: Path) -> None:
    own = MOTIONS[motion]
    recorded(tmp_path, own)
    scenario = {
        "kind": "tracking",
        "target": {"kind": "measured", "measurements": "m.csv", "truth": "t.csv"},
        "sensor": {"kind": "position", "sigma": 5},
        "start": {"kind": "one-scan", "sigma_velocity": 15},
        "assume": {"motion": own},
    }
    equal_steps = {*BRINGS_ITS_OWN, FIXED_GAIN}
    judge(tmp_path, scenario, own, refused("position", motion) | equal_steps, linear=True)


def recorded(folder: Path, motion: Keys) -> None:
    """Write truth and measurements of a target at steps of 0.2 to 1.5 s."""
    rng, times = np.random.default_rng(7), np.array([0.0, 1.5, 1.7, 2.7, 3.2])
    keys = {k: v for k, v in motion.items() if k != "kind"}
    own = kinds("motions")[motion["kind"]](**keys)  # type: ignore[call-arg]
    n = len(own.sampled(1.0).components)
    x = np.zeros((n, RUNS))
    x[1:4:2] = 15.0 * rng.standard_normal((2, RUNS))
    rows, seen = ["run,time,px,vx,py,vy"], ["run,time,x,y"]
    for k, t in enumerate(times):
        if k:
            x = own.sampled(t - times[k - 1]).transition(x, k).sample(rng)  # type: ignore[arg-type]
        z = x[0:4:2] + 5.0 * rng.standard_normal((2, RUNS))
        rows += [",".join(map(repr, map(float, (m, t, *x[:4, m])))) for m in range(RUNS)]
        seen += [",".join(map(repr, map(float, (m, t, *z[:, m])))) for m in range(RUNS)]
    (folder / "t.csv").write_text("\n".join(rows) + "\n")
    (folder / "m.csv").write_text("\n".join(seen) + "\n")


def judge(folder: Path, scenario: Keys, motion: Keys, never: set[str], linear: bool) -> None:
    """Try every filter there, those of ``never`` for their refusal."""
    with pytest.raises(UserError) as error:
        loaded(folder, scenario, {kind: entry(kind, motion) for kind in never})
    assert {str(p.path).split(".")[1] for p in error.value.problems} == never
    filters = {kind: entry(kind, motion) for kind in OURS if kind not in never}
    with_own = {"kind": "ekf", "assume": {"motion": OWN}}
    point = loaded(folder, scenario, {**filters, "with own": with_own})
    standard, of_own = result(point, "ekf"), result(point, "with own")
    wrong = []
    for kind in filters.keys() - OTHERS:
        found, brings_own = result(point, kind), kind in BRINGS_ITS_OWN
        best = of_own if brings_own or kind == FIXED_GAIN else standard
        if kind in EXACT and linear and (brings_own or motion["kind"] != "ct-unknown"):
            right = all(np.allclose(found[name], best[name], rtol=1e-6) for name in ERRORS)
        elif kind == FIXED_GAIN:
            right = bool(found[ERRORS[0]].mean() < 2.0 * best[ERRORS[0]].mean())
        else:
            right = is_right(found, best)
        wrong += [] if right else [kind]
    assert sorted(wrong) == []
