"""Points of a grid in figures: of one value, of none, and where every filter failed."""

from pathlib import Path

import numpy as np
import pytest

from tests.commands import ran
from tests.papers import banana_text, merwe_text
from trackbench.report.plotting import file_formats
from trackbench.report.tables_and_figures import Results
from trackbench.results.point_facts import same_points

PLUGIN = """
from dataclasses import dataclass, replace

from trackbench.filters.baselines import PriorMean
from trackbench.registry import register


@register("filters", "offset")
@dataclass(frozen=True, kw_only=True)
class Offset(PriorMean):
    'A number for every component; fails if it is zero or missing.'

    off: float | None = 0.0
    'the number'

    def step(self, model, state, z, k, rng):
        if not self.off:
            raise ValueError("no offset")
        return super().step(model, state, z, k, rng)

    def estimate(self, state):
        return replace(state, mean=0.0 * state.mean + self.off)
"""
CONFIG = """
name: points
runs: 3
scenario: MERWE
plugins: [own.py]
figures: {f: {kind: estimates}}
""".replace("MERWE", merwe_text(T=5))


OFFSET = "filters: {A: {kind: offset, off: 1.0}}\n"


def with_offset(folder: Path, text: str) -> Results:
    (folder / "own.py").write_text(PLUGIN)
    return ran(folder, text, allow_plugins=True).results


def estimates(results: Results) -> list[tuple[str, float]]:
    """Heading and last estimate of each panel; the panels of errors below have no heading."""
    figure = results.parts("figures")["f"].draw(results)
    lines = [(ax.get_title(), line) for ax in figure.axes if ax.get_title() for line in ax.lines]
    found = [(title, line.get_ydata()[-1]) for title, line in lines if line.get_label() == "A"]
    file_formats.close(figure)
    return found


def test_a_panel_shows_its_own_point(tmp_path: Path) -> None:
    results = with_offset(tmp_path, CONFIG + OFFSET + "grid: {filters.A.off: [0, 1, 2]}\n")
    assert [point["filters.A.off"] for point in results.points()] == [1, 2]
    assert estimates(results) == [("off = 1", 1.0), ("off = 2", 2.0)]
    assert results.tracks(results.grid_points[0]) == {}


def test_runs_are_found_if_the_failed_point_alone_is_a_word(tmp_path: Path) -> None:
    results = with_offset(tmp_path, CONFIG + OFFSET + "grid: {filters.A.off: [null, 1, 2]}\n")
    points = results.points()
    assert [point["filters.A.off"] for point in points] == [1, 2]
    loaded = Results(results.folder)
    for point in points:
        assert results.runs(point)
        assert results.runs(point).keys() == loaded.runs(point).keys()


def test_a_key_that_is_new_since_changes_no_point() -> None:
    stored = '[{"scenario": {"kind": "mine", "R": 1.0, "parts": [{"q": 2}]}}]'
    new = stored.replace('"q": 2', '"q": 2, "more": null')
    assert same_points(stored, stored)
    assert same_points(stored, new)
    assert not same_points(new, stored)
    assert not same_points(stored, new.replace("1.0", "1.5"))
    assert not same_points(stored, new.replace("[{", "[{}, {", 1))
    assert not same_points(stored[:-1], new)


def test_a_later_point_has_no_facts_that_only_the_first_one_has(tmp_path: Path) -> None:
    """The second point, whose state has no angle, had the angle of the first one."""
    text = """
name: angles
runs: 2
scenario:
  kind: tracking
  last: 5
  target:
    kind: driven
    motion: {kind: map, components: [a], next: {a: a + 0.1}, Q: {a: 1e-4}}
    initial: {a: 0}
  sensor: {kind: function, h: {z: a}, R: 1}
  start: {kind: gaussian, sigma: {a: 0.1}}
grid: {scenario.target.motion.angles: [[a], []]}
filters: {EKF: {kind: ekf}}
"""
    results = ran(tmp_path, text).results
    first, second = (Results(results.folder).facts(point) for point in results.points())
    assert (first.angles, second.angles) == (["a"], None)


def test_a_table_of_claims_over_a_grid_of_words(tmp_path: Path) -> None:
    more = "filters: {A: {kind: pf, N: 5}, B: {kind: prior-mean}}\n"
    more += "grid: {filters.A.resampling: [systematic, residual]}\n"
    more += "tables: {t: {kind: claims, claims: {c: {less: A, than: B, metric: rmse}}}}\n"
    results = with_offset(tmp_path, CONFIG + more)
    assert results.tables["t"].value_headers == ["systematic", "residual"]


def test_a_grid_of_one_value_shows_its_tracks(tmp_path: Path) -> None:
    results = with_offset(tmp_path, CONFIG + OFFSET + "grid: {filters.A.off: [3]}\n")
    assert estimates(results) == [("off = 3", 3.0)]


@pytest.mark.parametrize(
    ("path", "values"),
    [("scenario.score.lost_beyond", "[null, 5]"), ("scenario.sensor.R", "[1, 0.5]")],
)
def test_points_are_found_as_they_are_written(tmp_path: Path, path: str, values: str) -> None:
    results = with_offset(tmp_path, CONFIG + OFFSET + f"grid: {{{path}: {values}}}\n")
    found = [results.tracks(point)["truth"] for point in results.points()]
    for i, truth in enumerate(found):
        np.testing.assert_array_equal(truth, results.shown[f"point{i}/truth"])


@pytest.mark.parametrize(
    ("axis", "expected"),
    [
        ("filters.A.N: [5, 9]", [5.0, 9.0]),
        ("filters.A.N & filters.B.off: [5, 9]", [5.0, 9.0]),
        ("scenario.sensor.R: [1, 2]", [7.0, 7.0]),
        ("filters.A: [{kind: pf}, {kind: pf, N: 6}]", [100.0, 6.0]),
        ("filters.A.kind: [pf, apf]", [7.0, 7.0]),
    ],
)
def test_a_key_in_a_table_is_that_of_the_point(
    tmp_path: Path, axis: str, expected: list[float]
) -> None:
    path, _, values = axis.partition(": ")
    more = "filters: {A: {kind: pf, N: 7}, B: {kind: offset, off: 1.0}}\n"
    more += "tables: {t: {kind: metrics, columns: {N: N}, filters: [A]}}\n"
    results = with_offset(tmp_path, CONFIG + f'{more}grid: {{"{path}": {values}}}\n')
    assert [cells[0].estimate.value for cells in results.tables["t"].cells] == expected


def test_linked_paths_show_the_keys_that_differ(tmp_path: Path) -> None:
    more = "filters: {A: {kind: pf}, B: {kind: offset, off: 1.0}}\n"
    more += "tables: {t: {kind: metrics, columns: {N: N}, filters: [A]}}\n"
    grid = "{filters.A.N & filters.B.off: [[5, 5], [5, 9], 7], scenario.score.steps: [[2, 2]]}"
    table = with_offset(tmp_path, CONFIG + more + f"grid: {grid}\n").tables["t"]
    keys = [tuple(cell.text for cell in row[:2]) for row in table.texts().rows]
    words = ["N = 5, off = 5", "N = 5, off = 9", "N = 7, off = 7"]
    assert keys == [(text, "[2, 2]") for text in words]
    assert table.texts().heads[0] == "N, off"
    assert [row[0] for row in table.csv_rows()] == ["[5, 5]", "[5, 9]", "7"]


def test_linked_paths_that_one_key_tells_apart_show_it(tmp_path: Path) -> None:
    more = "filters: {A: {kind: pf}, B: {kind: offset, off: 1.0}}\n"
    more += "tables: {t: {kind: metrics, columns: {N: N}, filters: [A]}}\n"
    grid = "{filters.A.N & filters.B.off: [[5, 5], [6, 9], 7]}"
    table = with_offset(tmp_path, CONFIG + more + f"grid: {grid}\n").tables["t"]
    assert table.texts().heads[0] == "filters.A.N"
    assert [row[0].text for row in table.texts().rows] == ["5", "6", "7"]
    assert "| 6 |" in table.markdown()
    assert [row[0] for row in table.csv_rows()] == ["[5, 5]", "[6, 9]", "7"]


def test_a_key_of_a_plugin_is_known_without_it(tmp_path: Path) -> None:
    results = with_offset(tmp_path, CONFIG + OFFSET + "grid: {filters.A.off: [1, 2]}\n")
    unknown = Results(results.folder)
    unknown.config["filters"]["A"]["kind"] = "nobody-knows"
    found = [unknown.facts(point).filters["A"]["off"] for point in unknown.points()]
    assert found == [1, 2]


def test_the_arc_of_a_measurement_is_that_of_the_point(tmp_path: Path) -> None:
    """Two standard deviations of range to either side, so twice as thick with twice the noise."""
    more = "filters: {A: {kind: cmkf}}\ngrid: {scenario.sensor.sigma_range: [10, 20]}\n"
    text = (CONFIG + more).replace(merwe_text(T=5), banana_text(scans=4))
    figure = "{kind: posterior, half_height_m: 1000, point: %d}"
    heights = []
    for point in (1, 2):
        results = with_offset(tmp_path, text.replace("{kind: estimates}", figure % point))
        drawn = results.parts("figures")["f"].draw(results)
        (arc,) = drawn.axes[0].patches
        middle = arc.get_xy()
        heights.append(np.ptp(middle[np.abs(middle[:, 0]) < 1e-3 * np.ptp(middle[:, 0]), 1]))
        file_formats.close(drawn)
    assert heights[1] == pytest.approx(2.0 * heights[0], rel=0.05)


def test_a_caption_names_the_point_that_is_drawn(tmp_path: Path) -> None:
    """The number counts the first point, too, where every filter failed."""
    text = CONFIG.replace(merwe_text(T=5), banana_text(scans=4))
    text = text.replace("{kind: estimates}", "{kind: posterior, point: 2}")
    results = with_offset(tmp_path, text + OFFSET + "grid: {filters.A.off: [0, 1, 2]}\n")
    assert "at off = 1:" in results.parts("figures")["f"].default_caption(results)
