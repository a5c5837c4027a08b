"""Mistakes in a maneuvering-target config, each with its place; grids of paths that vary together."""

from pathlib import Path

import pytest

from tests.experiment.test_bad_input import mistakes
from trackbench.experiment.config import load
from trackbench.experiment.resolved import resolved

GOOD = """name: x
runs: 4
scenario:
  kind: maneuver
  duration: 300
  legs:
    - {start: 100, end: 150, ax: 0.1, ay: 0}
    - {start: 200, end: 250, ax: 0.1, ay: 0}
filters:
  A:
    kind: adaptive-kf
    nmf: {q: 0}
    mf: {q: 1e-4}
    detector:
      eta: 20
      gamma: 0.8
  I:
    kind: imm
    motions: [{kind: cv, q: 0}, {kind: ca, q: 0.1}]
    transition:
      - [0.9, 0.1]
      - [0.1, 0.9]
  K:
    kind: kf
    motion: {kind: cv, q: 1}
"""

CASES = [
    (
        "start: 200",
        "start: 140",
        "8:15: scenario.legs.1.start: leg 2 starts at 140 s, before leg 1 ends",
    ),
    (
        "end: 250",
        "end: 350",
        "8:25: scenario.legs.1.end: leg 2 ends at 350 s, after the run's end at 300 s",
    ),
    ("end: 250", "end: 190", "8:25: scenario.legs.1.end: leg 2 ends before it starts"),
    ("ay: 0}\n    - ", "}\n    - ", "7:7: scenario.legs.0.ay: this key is required"),
    (
        "duration: 300",
        "duration: 300\n  truht: x",
        "6:3: scenario.truht: unknown key; did you mean",
    ),
    (
        "eta: 20",
        "eta: 20\n      alpha: 0.01",
        "15:7: filters.A.detector: give one of eta and alpha",
    ),
    ("eta: 20", "start: 20", "15:7: filters.A.detector: give one of eta and alpha"),
    ("gamma: 0.8", "gamma: 1", "16:14: filters.A.detector.gamma: 1 is not less than 1"),
    ("gamma: 0.8", "gamma: 0", "16:14: filters.A.detector.gamma: 0 is not greater than 0"),
    (
        "gamma: 0.8",
        "window_s: 400",
        "16:17: filters.A.detector.window_s: 400 s is longer than the run of 300 s",
    ),
    (
        "gamma: 0.8",
        "min_window_s: 40",
        "16:21: filters.A.detector.min_window_s: 40 s exceed the window",
    ),
    (
        "gamma: 0.8",
        "{onset: paper, min_window_s: 3, window_s: 20}",
        "the printed onset is always the newest",
    ),
    (
        "gamma: 0.8",
        "kind: fading\n      onset: argmax",
        "17:14: filters.A.detector.onset: kind fading has no zeta",
    ),
    ("gamma: 0.8", "gama: 0.8", "16:7: filters.A.detector.gama: unknown key"),
    ("    nmf: {q: 0}\n", "", "10:3: filters.A.nmf: this key is required"),
    ("nmf: {q: 0}", "nmf: {kind: cv}", "12:5: filters.A.nmf.q: this key is required"),
    ("[0.1, 0.9]", "[0.1, 0.8]", "22:9: filters.I.transition.1: the row sums to 0.9, not to 1"),
    ("[0.1, 0.9]", "[0.1, 0.8, 0.1]", "22:9: filters.I.transition.1: 3 entries for 2 motions"),
    ("      - [0.1, 0.9]\n", "", "filters.I.transition: 1 rows for 2 motions"),
    ("[0.1, 0.9]", "[-0.1, 1.1]", "22:10: filters.I.transition.1.0: -0.1 is less than 0"),
    ("{kind: cv, q: 1}", "{kind: cw, q: 1}", "'cw' is not one of cv, ca, cwna, ct"),
    ("{kind: cv, q: 1}", "{q: 1}", "25:13: filters.K.motion: needs a kind"),
    ("{kind: cv, q: 1}", "{kind: cv, q: -1}", "25:27: filters.K.motion.q: -1 is less than 0"),
    (
        "kind: maneuver\n  duration: 300\n  legs:\n    - {start: 100, end: 150, ax: 0.1, ay: 0}\n"
        "    - {start: 200, end: 250, ax: 0.1, ay: 0}",
        "kind: merwe",
        "filters.K: kf needs motion.T, which scenario merwe does not have",
    ),
]


@pytest.mark.parametrize(("old", "new", "expected"), CASES, ids=[c[2][:60] for c in CASES])
def test_mistake_is_found_where_it_stands(
    tmp_path: Path, old: str, new: str, expected: str
) -> None:
    if new.startswith("{onset"):
        old, new = "detector:\n      eta: 20\n      gamma: 0.8", f"detector: {new[:-1]}, eta: 20}}"
    assert old in GOOD
    found = mistakes(tmp_path, GOOD.replace(old, new, 1))
    assert any(expected in line for line in found), found


def _load(tmp_path: Path, text: str) -> object:
    path = tmp_path / "c.yaml"
    path.write_text(text)
    return load(path)


def test_good_config_loads_and_its_resolved_form_too(tmp_path: Path) -> None:
    import yaml

    first = _load(tmp_path, GOOD)
    again = _load(tmp_path, yaml.safe_dump(resolved(first, tmp_path)))
    assert again.points == first.points
    assert resolved(again, tmp_path) == resolved(first, tmp_path)


def test_paths_of_a_grid_take_a_value_together(tmp_path: Path) -> None:
    grid = 'grid: {"filters.K.motion.q & filters.A.nmf.q": [0.5, 2]}\n'
    points = _load(tmp_path, GOOD + grid).points
    got = [(p.filters["K"].motion.q, p.filters["A"].nmf.q) for p in points]
    assert got == [(0.5, 0.5), (2.0, 2.0)]
    assert points[0].filters["I"] == points[1].filters["I"]


def test_a_preset_s_mapping_may_be_changed_in_one_key(tmp_path: Path) -> None:
    text = GOOD.replace("    detector:\n      eta: 20\n      gamma: 0.8\n", "    preset: seconds\n")
    text = text.replace("preset: seconds", "preset: seconds\n    detector: {window_s: 40}")
    detector = _load(tmp_path, text).points[0].filters["A"].detector
    assert (detector.window_s, detector.eta, detector.min_window_s) == (40.0, 20.0, 15.0)
