"""A config of a maneuvering target: its resolved form, and grids of paths that vary together."""

from pathlib import Path

import yaml

from tests.bad_input.test_bad_input import LISTS, good_files
from trackbench.config.load import load
from trackbench.config.resolved_config import resolved

GOOD = good_files(LISTS["maneuver"])["c.yaml"]


def _load(tmp_path: Path, text: str) -> object:
    path = tmp_path / "c.yaml"
    path.write_text(text)
    return load(path)


def test_good_config_loads_and_its_resolved_form_too(tmp_path: Path) -> None:
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
