"""Values of the curves in a figure's SVG, for the page's script; thumbnails."""

import json
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from matplotlib.figure import Figure

from trackbench.report.figure_drawing import draw_figure
from trackbench.report.figures.estimates_of_one_run import EstimatesOfOneRun
from trackbench.report.figures.heat_map import HeatMap
from trackbench.report.figures.over_time import draw_gray_line
from trackbench.report.figures.rmse_vs_time import RmseVsTime
from trackbench.report.html.thumbnail import thumbnail
from trackbench.report.plotting import (
    error_bands_and_bars,
    file_formats,
    filter_colors,
    filter_lines,
    interactive_curves,
    zeros_on_log_axes,
)
from trackbench.report.plotting.svg_paths import compact_paths, outline
from trackbench.report.tables_and_figures import Results

SVG = "{http://www.w3.org/2000/svg}"


def drawn(spec, results):
    ((_, content),) = draw_figure(spec, results, ["svg"])
    return content


def live(content):
    """Labels and axes of an SVG file, the abscissas of each curve written out."""
    data = json.loads(ET.fromstring(content).get("data-live"))
    for panel in data["axes"]:
        abscissas = []
        for curve in panel["curves"]:
            abscissas = curve.setdefault("x", abscissas)
    return data


@pytest.mark.parametrize("log", [False, True])
def test_values_are_those_of_the_file(made, log):
    results = Results(made)
    data = live(drawn(RmseVsTime(log=log, floor="Exact"), results))
    assert set(data["labels"]) == set(results.labels)
    frame = results.per_step.query("metric == 'rmse'")
    for curve in data["axes"][0]["curves"]:
        rows = frame[frame["filter"] == data["labels"][curve["of"]]]
        # A logarithmic axis leaves out the first step, whose error is only rounding.
        rows = rows[rows["step"] >= curve["x"][0]]
        assert curve["x"][0] <= 1 + log
        assert curve["x"] == rows["step"].tolist()
        assert curve["y"] == rows["value"].tolist()
        assert [e or 0.0 for e in curve["stderr"]] == rows["stderr"].fillna(0.0).tolist()


def test_a_plugins_figure_has_its_values():
    """It draws on any axes; of a line with error bars only the house knows what their ends are."""
    figure = Figure()
    above, below = figure.subplots(2)
    above.plot([1, 2, 3], [0.1234567891, np.nan, 2e9], "r", label="a")
    above.errorbar([1, 2, 3], [4, 5, 6], 1, label="b")
    above.plot([0, 1, 2], [0, 1, 2], label="not in data", transform=above.transAxes)
    below.plot(np.arange(1801), np.arange(1801), label="long")
    data = live(file_formats.content(figure, "svg"))
    assert data["labels"] == ["a", "b", "long"]
    (a, b), (long,) = (panel["curves"] for panel in data["axes"])
    assert a == {"of": 0, "color": "#ff0000", "x": [1, 3], "y": [0.1234568, 2e9]}
    assert (b["x"], b["y"]) == ([1, 2, 3], [4, 5, 6])
    assert long["x"] == long["y"] == list(range(0, 1801, 4))


def test_a_label_is_told_as_it_is(made, hostile):
    told = live(drawn(RmseVsTime(), Results(made)))
    assert hostile in told["labels"]


def test_axes_that_share_are_told(made):
    told = live(drawn(EstimatesOfOneRun(filters=("PF",)), Results(made)))
    above, below = told["axes"]
    assert above["x"]["group"] == below["x"]["group"]
    assert above["y"]["group"] != below["y"]["group"]
    assert told["labels"] == ["Truth", "PF"]


def test_a_figure_without_curves_is_told_nothing_of(made):
    root = ET.fromstring(drawn(HeatMap(), Results(made)))
    assert root.get("data-live") is None
    assert root.find(f"{SVG}metadata") is None


def test_clip_paths_have_numbers_whatever_their_last_digits():
    def drawing(first: str, second: str) -> str:
        clips = f'<a clip-path="url(#{first})"/><b clip-path="url(#{second})"/>'
        return f'{clips}<clipPath id="{first}"/><clipPath id="{second}"/><text>p0123456789</text>'

    expected = drawing("clip1", "clip2")
    assert compact_paths(drawing("p0123456789", "pabcdefabcd")) == expected
    assert compact_paths(drawing("pfedcbafedc", "p9876543210")) == expected


def test_outline_reads_what_compact_writes():
    d = "M 1.5 2 L -3 4.25 L -3.001 4.25 z M 7 8 L 7 -0.5"
    (path,) = ET.fromstring(compact_paths(f'<a><b d="{d}"/></a>'))
    (first, closed), (second, open_) = outline(path.get("d"))
    assert (first, closed) == ([(1.5, 2.0), (-3.0, 4.25), (-3.0, 4.25)], True)
    assert (second, open_) == ([(7.0, 8.0), (7.0, -0.5)], False)
    assert list(outline("M 0 0 C 1 1 2 2 3 3")) == []


def test_a_thumbnail_is_small_and_only_shapes(made):
    content = (made / "figures" / "time.svg").read_bytes()
    small = thumbnail(content)
    assert len(small) < 0.3 * len(content)
    root = ET.fromstring(small)
    assert {element.tag for element in root} == {f"{SVG}path"}
    assert len({e.get("stroke") for e in root} & set(map(str.lower, filter_colors.COLORS))) > 1
    assert not [e for e in root.iter() if "id" in e.attrib]


def test_no_label_of_a_filter_is_that_of_another_shape():
    """Gray lines, triangles and lines without a label belong to no filter, whatever its label."""
    figure, x = Figure(), np.arange(5.0)
    ax = figure.add_subplot()
    ax.axvline(2.0)
    labels = ["gray", "cut", "zero", "alone", "child0"]
    for label in labels:
        look = {"label": label, "color": "r"}
        filter_lines.draw_filter_line(ax, x, x, look)
        error_bands_and_bars.draw_error_band(ax, x, x, x + 1.0, look, line_index=0, lines=1)
    draw_gray_line(ax, x, x)
    zeros_on_log_axes.mark_zeros(ax, [zeros_on_log_axes.Zeros(x=x[:2], color="r")])
    filter_lines.draw_lone_points(ax, x, np.where(x == 2.0, 1.0, np.nan), "r")
    assert interactive_curves.number_shapes(figure) == labels
    numbers = [artist.get_gid().split("-")[1] for artist in ax.findobj() if _is_of_a_curve(artist)]
    assert sorted(numbers) == sorted(2 * ["0", "1", "2", "3", "4"])  # a line and a band each


def _is_of_a_curve(artist):
    return (artist.get_gid() or "").startswith("of-")
