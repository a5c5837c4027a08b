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
    'A number for every component; fails if it is zero.'

    off: float = 0.0
    'the number'

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
figures: {f: {kind: estimates}}
"""


OFFSET = "filters: {A: {kind: offset, off: 1.0}}\n"


def ran(folder: Path, more: str) -> Results:
    (folder / "own.py").write_text(PLUGIN)
    (folder / "c.yaml").write_text(CONFIG + more)
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
    results = ran(tmp_path, OFFSET + "grid: {filters.A.off: [0, 1, 2]}\n")
    assert [point["filters.A.off"] for point in results.points()] == [1, 2]
    assert estimates(results) == [("off = 1", 1.0), ("off = 2", 2.0)]
    assert results.tracks(results.every_point[0]) == {}


def test_a_table_of_claims_over_a_grid_of_words(tmp_path: Path) -> None:
    more = "filters: {A: {kind: pf, N: 5}, B: {kind: prior-mean}}\n"
    more += "grid: {filters.A.resampling: [systematic, residual]}\n"
    more += "tables: {t: {kind: claims, claims: {c: {less: A, than: B, metric: rmse}}}}\n"
    results = ran(tmp_path, more)
    assert results.tables["t"].value_headers == ["systematic", "residual"]


def test_a_grid_of_one_value_shows_its_tracks(tmp_path: Path) -> None:
    results = ran(tmp_path, OFFSET + "grid: {filters.A.off: [3]}\n")
    assert estimates(results) == [("off = 3", 3.0)]


@pytest.mark.parametrize(
    ("path", "values"), [("scenario.lost_beyond", "[null, 5]"), ("scenario.R", "[1, 0.5]")]
)
def test_points_are_found_as_they_are_written(tmp_path: Path, path: str, values: str) -> None:
    results = ran(tmp_path, OFFSET + f"grid: {{{path}: {values}}}\n")
    found = [results.tracks(point)["truth"] for point in results.points()]
    for i, truth in enumerate(found):
        np.testing.assert_array_equal(truth, results.shown[f"point{i}/truth"])
