"""Mistakes in a maneuvering-target config, each with its place; grids of paths that vary together."""

from pathlib import Path

import pytest

from tests.config.test_bad_input import mistakes
from trackbench.config.dump import resolved
from trackbench.config.load import load

GOOD = """name: x
runs: 4
scenario:
  kind: tracking
  last: 300
  sensor: {kind: position, sigma: 100}
  start: two-scan
  assume: {motion: {kind: cv, q: 0}}
  target:
    kind: legs
    launch: {vy: -15}
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
    assume: {motion: {kind: cv, q: 1}}
"""

CASES = [
    (
        "start: 200",
        "start: 140",
        "14:17: scenario.target.legs.1.start: leg 2 starts at 140 s, before leg 1 ends",
    ),
    (
        "end: 250",
        "end: 350",
        "14:27: scenario.target.legs.1.end: leg 2 ends at 350 s, after the run's end at 300 s",
    ),
    ("end: 250", "end: 190", "14:27: scenario.target.legs.1.end: leg 2 ends before it starts"),
    (
        "start: 100, ",
        "",
        "13:9: scenario.target.legs.0.start: this key is required",
    ),
    (
        "ax: 0.1, ay: 0}\n  ",
        "ax: 0.1, turn_rate_deg_s: 1}\n  ",
        "13:9: scenario.target.legs.0: a leg has an acceleration or a turn rate, not both",
    ),
    ("vy: -15", "v: -15", "11:14: scenario.target.launch.v: unknown key; did you mean vz?"),
    (
        "last: 300",
        "last: 300\n  strat: x",
        "6:3: scenario.strat: unknown key; did you mean start?",
    ),
    (
        "eta: 20",
        "eta: 20\n      alpha: 0.01",
        "21:7: filters.A.detector: give one of eta and alpha",
    ),
    ("eta: 20", "start: 20", "21:7: filters.A.detector: give one of eta and alpha"),
    ("gamma: 0.8", "gamma: 1", "22:14: filters.A.detector.gamma: 1 is not less than 1"),
    ("gamma: 0.8", "gamma: 0", "22:14: filters.A.detector.gamma: 0 is not greater than 0"),
    (
        "gamma: 0.8",
        "window_s: 400",
        "22:17: filters.A.detector.window_s: 400 s is longer than the run of 300 s",
    ),
    (
        "gamma: 0.8",
        "min_window_s: 40",
        "22:21: filters.A.detector.min_window_s: 40 s exceed the window",
    ),
    (
        "gamma: 0.8",
        "{onset: paper, min_window_s: 3, window_s: 20}",
        "the printed onset is always the newest",
    ),
    (
        "gamma: 0.8",
        "kind: fading\n      onset: argmax",
        "23:14: filters.A.detector.onset: kind fading has no zeta",
    ),
    ("gamma: 0.8", "gama: 0.8", "22:7: filters.A.detector.gama: unknown key"),
    ("    nmf: {q: 0}\n", "", "16:3: filters.A.nmf: this key is required"),
    ("nmf: {q: 0}", "nmf: {kind: cv}", "18:5: filters.A.nmf.q: this key is required"),
    ("[0.1, 0.9]", "[0.1, 0.8]", "28:9: filters.I.transition.1: the row sums to 0.9, not to 1"),
    ("[0.1, 0.9]", "[0.1, 0.8, 0.1]", "28:9: filters.I.transition.1: 3 entries for 2 motions"),
    ("      - [0.1, 0.9]\n", "", "filters.I.transition: 1 rows for 2 motions"),
    ("- [0.1, 0.9]", "- [0, 1]\n      - [1, 0]", "filters.I.transition: 3 rows for 2 motions"),
    ("[0.1, 0.9]", "[0.2, 0.9]", "28:9: filters.I.transition.1: the row sums to 1.1, not to 1"),
    ("[0.1, 0.9]", "[1]", "28:9: filters.I.transition.1: 1 entries for 2 motions"),
    ("{kind: cv, q: 0}, ", "", "25:14: filters.I.motions: give at least two motions"),
    *(
        ("transition:", f"initial: {row}\n    transition:", f"26:14: filters.I.initial: {what}")
        for row, what in (
            ("[0.5, 0.4]", "sums to 0.9, not to 1"),
            ("[0.5, 0.6]", "sums to 1.1, not to 1"),
            ("[1]", "1 entries for 2 motions"),
            ("[0.5, 0.5, 0]", "3 entries for 2 motions"),
        )
    ),
    ("[0.1, 0.9]", "[-0.1, 1.1]", "28:10: filters.I.transition.1.0: -0.1 is less than 0"),
    (
        "{kind: cv, q: 1}",
        "{kind: cw, q: 1}",
        "31:29: filters.K.assume.motion.kind: 'cw' is not a kind of motion; did you mean cwna?",
    ),
    ("{kind: cv, q: 1}", "{q: 1}", "31:22: filters.K.assume.motion: needs a kind"),
    (
        "{kind: cv, q: 1}",
        "{kind: cv, q: -1}",
        "31:36: filters.K.assume.motion.q: -1 is less than 0",
    ),
    (
        "motion: {kind: cv, q: 1}",
        "motoin: {kind: cv, q: 1}",
        "31:14: filters.K.assume.motoin: unknown key; did you mean motion?",
    ),
    (
        "assume: {motion: {kind: cv, q: 0}}\n",
        "\n",
        "scenario.assume: name the motion that filters assume",
    ),
    (
        "{kind: position, sigma: 100}",
        "{kind: bearing, sigma_mrad: 5}",
        "7:10: scenario.start: no sensor here tells a position in one scan",
    ),
    (
        "{kind: position, sigma: 100}",
        "{kind: range-azimuth, sigma_range: 50, sigma_azimuth_mrad: 5}",
        "filters.K: `kf` works only with a linear sensor; this scenario has `range-azimuth`: "
        "take another filter or sensor",
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
    grid = 'grid: {"filters.K.assume.motion.q & filters.A.nmf.q": [0.5, 2]}\n'
    points = _load(tmp_path, GOOD + grid).points
    got = [(p.assumed["K"].motion.q, p.filters["A"].nmf.q) for p in points]
    assert got == [(0.5, 0.5), (2.0, 2.0)]
    assert points[0].filters["I"] == points[1].filters["I"]


def test_a_preset_s_mapping_may_be_changed_in_one_key(tmp_path: Path) -> None:
    text = GOOD.replace("    detector:\n      eta: 20\n      gamma: 0.8\n", "    preset: seconds\n")
    text = text.replace("preset: seconds", "preset: seconds\n    detector: {window_s: 40}")
    detector = _load(tmp_path, text).points[0].filters["A"].detector
    assert (detector.window_s, detector.eta, detector.min_window_s) == (40.0, 20.0, 15.0)
