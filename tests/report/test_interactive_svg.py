"""What the script is told of a figure: values read off its shapes are those of the files."""

import json
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from trackbench.report.figures.heat_map import HeatMap
from trackbench.report.figures.over_time import EstimatesOfOneRun, RmseVsTime
from trackbench.report.html.index_page import thumbnail
from trackbench.report.html.svg import compact, outline
from trackbench.report.plotting import style
from trackbench.report.render import draw_figure
from trackbench.report.results import Results

SVG = "{http://www.w3.org/2000/svg}"


def svg(spec, results):
    ((_, content),) = draw_figure(spec, results, ["svg"])
    return ET.fromstring(content)


def read_off(root, told, number):
    """Abscissas and ordinates (n, 2) of the line of a label."""
    (line,) = [
        path.get("d")
        for group in root.iter(f"{SVG}g")
        if group.get("data-of") == str(number)
        for path in group.findall(f"{SVG}path")
        if path.get("d", "").count("l") > 3 and "z" not in path.get("d")
    ]
    left, top, right, bottom = told["box"]
    ((points, _),) = outline(line)
    share = (np.array(points) - [left, bottom]) / [right - left, top - bottom]
    columns = []
    for i, axis in enumerate((told["x"], told["y"])):
        low, high = np.log10(axis["ends"]) if axis["log"] else axis["ends"]
        value = low + share[:, i] * (high - low)
        columns.append(10.0**value if axis["log"] else value)
    return np.stack(columns, axis=1)


@pytest.mark.parametrize("log", [False, True])
def test_values_read_off_are_those_of_the_file(made, log):
    results = Results(made)
    root = svg(RmseVsTime(log=log, floor="Exact"), results)
    told = json.loads(root.get("data-live"))
    (axes,) = told["axes"]
    frame = results.per_step.query("metric == 'rmse' and value > 0")
    for number, label in enumerate(told["labels"]):
        found = read_off(root, axes, number)
        rows = frame[(frame["filter"] == label) & (frame["step"] > 1)]
        found = found[found[:, 0] > 1.5]
        np.testing.assert_allclose(found[:, 0], rows["step"], atol=0.01)
        scale = 0.0 if log else 1e-3 * axes["y"]["ends"][1]
        np.testing.assert_allclose(found[:, 1], rows["value"], rtol=0.003, atol=scale)
        steps, errors = axes["errors"][str(number)]
        known = frame[(frame["filter"] == label) & (frame["stderr"] > 0)]
        assert steps == known["step"].tolist()
        np.testing.assert_allclose(errors, known["stderr"], rtol=0.06)


def test_a_label_is_told_as_it_is(made, hostile):
    told = json.loads(svg(RmseVsTime(), Results(made)).get("data-live"))
    assert hostile in told["labels"]


def test_axes_that_share_are_told(made):
    told = json.loads(svg(EstimatesOfOneRun(filters=("PF",)), Results(made)).get("data-live"))
    above, below = told["axes"]
    assert above["x"]["group"] == below["x"]["group"]
    assert above["y"]["group"] != below["y"]["group"]
    assert told["labels"] == ["Truth", "PF"]


def test_a_figure_without_curves_is_told_nothing_of(made):
    root = svg(HeatMap(), Results(made))
    assert root.get("data-live") is None
    assert root.find(f"{SVG}metadata") is None


def test_clip_paths_have_numbers_whatever_their_last_digits():
    def drawing(first: str, second: str) -> str:
        clips = f'<a clip-path="url(#{first})"/><b clip-path="url(#{second})"/>'
        return f'{clips}<clipPath id="{first}"/><clipPath id="{second}"/><text>p0123456789</text>'

    expected = drawing("clip1", "clip2")
    assert compact(drawing("p0123456789", "pabcdefabcd")) == expected
    assert compact(drawing("pfedcbafedc", "p9876543210")) == expected


def test_outline_reads_what_compact_writes():
    d = "M 1.5 2 L -3 4.25 L -3.001 4.25 z M 7 8 L 7 -0.5"
    (path,) = ET.fromstring(compact(f'<a><b d="{d}"/></a>'))
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
    assert len({e.get("stroke") for e in root} & set(map(str.lower, style.COLORS))) > 1
    assert not [e for e in root.iter() if "id" in e.attrib]
