"""Points of a grid in figures: of one value, of none, and where every filter failed."""

from pathlib import Path

import numpy as np
import pytest

from trackbench import api
from trackbench.report import style
from trackbench.report.results import Results

PLUGIN = """
from dataclasses import dataclass, replace

from trackbench.filters.reference import PriorMean
from trackbench.registry import register


@register("filters", "offset")
@dataclass(frozen=True, kw_only=True)
class Offset(PriorMean):
    off: float = 0.0

    def step(self, model, state, z, k, rng):
        if self.off == 0.0:
            raise ValueError("no offset")
        return super().step(model, state, z, k, rng)

    def estimate(self, state):
        return replace(state, mean=0.0 * state.mean + self.off)
"""
CONFIG = """
name: points
runs: 3
scenario: {kind: merwe, T: 5}
plugins: [own.py]
filters: {A: {kind: offset, off: OFF}}
figures: {f: {kind: estimates}}
"""


def ran(folder: Path, more: str, off: float = 0.0) -> Results:
    (folder / "own.py").write_text(PLUGIN)
    (folder / "c.yaml").write_text(CONFIG.replace("OFF", str(off)) + more)
    options = api.Options(engine="serial", quiet=True, out=folder / "out", formats=("svg",))
    return api.run(folder / "c.yaml", options, allow_plugins=True).results


def estimates(results: Results) -> list[tuple[str, float]]:
    """Heading and last estimate of each panel."""
    figure = results.parts("figures")["f"].draw(results)
    lines = [(ax.get_title(), line) for ax in figure.axes for line in ax.lines]
    found = [(title, line.get_ydata()[-1]) for title, line in lines if line.get_label() == "A"]
    style.close(figure)
    return found


def test_a_panel_shows_its_own_point(tmp_path: Path) -> None:
    results = ran(tmp_path, "grid: {filters.A.off: [0, 1, 2]}\n")
    assert [point["filters.A.off"] for point in results.points()] == [1, 2]
    assert estimates(results) == [("off = 1", 1.0), ("off = 2", 2.0)]
    assert results.tracks(results.every_point[0]) == {}


def test_a_grid_of_one_value_shows_its_tracks(tmp_path: Path) -> None:
    results = ran(tmp_path, "grid: {filters.A.off: [3]}\n")
    assert estimates(results) == [("off = 3", 3.0)]


@pytest.mark.parametrize(
    ("path", "values"), [("scenario.lost_beyond", "[null, 5]"), ("scenario.R", "[1, 0.5]")]
)
def test_points_are_found_as_they_are_written(tmp_path: Path, path: str, values: str) -> None:
    results = ran(tmp_path, f"grid: {{{path}: {values}}}\n", off=1.0)
    found = [results.tracks(point)["truth"] for point in results.points()]
    for i, truth in enumerate(found):
        np.testing.assert_array_equal(truth, results.shown[f"point{i}/truth"])
