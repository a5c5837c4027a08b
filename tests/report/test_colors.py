"""Colors of filters: no two filters of a figure have the same one, and each keeps its own."""

import html
import json
import re
from pathlib import Path

import pytest
import yaml

from tests.commands import ran
from trackbench.evaluation.metric_expression import measure
from trackbench.report.figures.rmse_vs_time import RmseVsTime
from trackbench.report.plotting import filter_colors
from trackbench.report.tables_and_figures import Results

ONLY_OF_PARTICLES = ("F2", "F10")
CONFIG = {
    "name": "colors",
    "runs": 2,
    "scenario": {
        "kind": "tracking",
        "last": 3,
        "target": {"kind": "driven", "motion": {"kind": "cv", "q": 1}, "launch": {"x": 10}},
        "sensor": {"kind": "position", "sigma": 2},
        "start": {"kind": "gaussian", "sigma": [2, 1, 2, 1]},
    },
    "reference": "Reference",
    "bound": "PCRLB",
    "filters": {
        "Reference": {"kind": "kf"},
        **{f"F{i}": {"kind": "ekf"} for i in range(1, 13)},
        **{label: {"kind": "pf", "N": 10} for label in ONLY_OF_PARTICLES},
    },
    "metrics": ["rmse_position", "ess"],
    "tables": {"t": {"kind": "metrics", "columns": {"ESS": "mean(ess)"}}},
    "figures": {
        "pair": {"kind": "rmse-vs-time", "metric": "rmse_position", "filters": ["F1", "F9"]},
        "three": {"kind": "rmse-vs-time", "metric": "rmse_position", "filters": ["F1", "F3", "F9"]},
        "all": {"kind": "rmse-vs-time", "metric": "rmse_position"},
    },
}


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Results:
    return ran(tmp_path_factory.mktemp("colors"), yaml.safe_dump(CONFIG, sort_keys=False)).results


def test_two_filters_of_a_figure_have_two_colors(results: Results) -> None:
    for name in ("pair", "three"):
        looks = dict(results.parts("figures")[name].labels_and_looks(results))
        assert len({look["color"] for look in looks.values()}) == len(looks)


def test_a_filter_keeps_its_color_where_there_is_room(results: Results) -> None:
    pair, three = (
        dict(results.parts("figures")[name].labels_and_looks(results)) for name in ("pair", "three")
    )
    assert pair["F1"] == three["F1"] == results.line_style("F1")
    assert pair["F9"] == three["F9"] == results.line_style("F9")


def test_more_filters_than_colors_differ_in_color_or_dash(results: Results) -> None:
    looks = dict(results.parts("figures")["all"].labels_and_looks(results))
    assert len(looks) == 14
    pairs = {(look["color"], str(look["linestyle"])) for look in looks.values()}
    assert len(pairs) == len(looks)
    assert {look["color"] for look in looks.values()} >= set(filter_colors.COLORS)


def test_reference_and_bound_are_black_in_every_figure(results: Results) -> None:
    reference = results.line_style("Reference")
    bound = results.line_style("PCRLB")
    assert reference["color"] == bound["color"] == "black"
    assert reference["linestyle"] != bound["linestyle"]
    others = [label for label in results.config["filters"] if label != "Reference"]
    assert {results.line_style(label)["color"] for label in others} <= set(filter_colors.COLORS)


def test_a_filter_without_the_metric_takes_no_color(results: Results) -> None:
    looks = dict(RmseVsTime(metric=measure("ess")).labels_and_looks(results))
    assert set(looks) == set(ONLY_OF_PARTICLES)
    assert len({look["color"] for look in looks.values()}) == 2


def test_a_run_of_some_filters_has_a_color_for_each(tmp_path: Path) -> None:
    text = yaml.safe_dump(CONFIG, sort_keys=False)
    some = ran(tmp_path, text, only=("F1", "F9", "F5"), set=("figures={}", "tables={}")).results
    looks = some.line_styles(some.labels)
    assert set(looks) >= {"F1", "F5", "F9"}
    colors = [looks[label]["color"] for label in ("F1", "F5", "F9")]
    assert len(set(colors)) == 3
    assert set(colors) <= set(filter_colors.COLORS)


def test_looks_of_many_filters_are_distinct() -> None:
    usual = {str(number): filter_colors.line(0) for number in range(90)}
    looks = filter_colors.distinct_looks(usual)
    assert list(looks) == list(usual)
    first = [looks[str(number)]["color"] for number in range(len(filter_colors.COLORS))]
    assert len(set(first)) == len(filter_colors.COLORS)
    pairs = {(look["color"], str(look["linestyle"])) for look in looks.values()}
    assert len(pairs) == len(filter_colors.COLORS) * len(filter_colors.DASHES)


STORED = Path(__file__).parents[2] / "results"
FIGURES = sorted(STORED.glob("*/figures/*.svg"))


def curves_of(svg: Path) -> dict[str, set[str]]:
    """Colors of the curves of a stored figure, by label."""
    match = re.search(r'data-live="([^"]*)"', svg.read_text())
    if match is None:
        return {}
    data = json.loads(html.unescape(match[1]))
    colors: dict[str, set[str]] = {}
    for panel in data["axes"]:
        for curve in panel["curves"]:
            colors.setdefault(data["labels"][curve["of"]], set()).add(curve["color"])
    return colors


def test_the_filters_of_every_stored_figure_have_colors_of_their_own() -> None:
    """The looks of the curves that each stored figure has, as it is drawn now."""
    checked = 0
    for svg in FIGURES:
        folder = svg.parents[1]
        if not (folder / "config.yaml").is_file():  # a suite
            continue
        results = Results(folder)
        known = [*results.labels, *(f"{label}, 2 σ" for label in results.labels)]
        curves = [label for label in curves_of(svg) if label in known]
        labels = [label.removesuffix(", 2 σ") for label in curves]
        keys = results.figure_configs.get(svg.stem, {})
        looks = results.line_styles(labels, keys.get("floor"), keys.get("baseline"))
        colors = [look["color"] for look in looks.values() if look["color"] in filter_colors.COLORS]
        assert len(set(colors)) == min(len(colors), len(filter_colors.COLORS)), svg
        pairs = {(look["color"], str(look["linestyle"])) for look in looks.values()}
        assert len(pairs) == len(looks), svg
        checked += len(looks) > 1
    assert checked > 50


def test_the_curves_of_stored_figures_are_drawn_in_colors_of_their_own() -> None:
    checked = 0
    for svg in FIGURES:
        folder = svg.parents[1]
        if not (folder / "config.yaml").is_file():  # a suite
            continue
        known = Results(folder).labels
        drawn = {label: colors for label, colors in curves_of(svg).items() if label in known}
        of_filters = [
            {color.upper() for color in colors} & {*filter_colors.COLORS}
            for colors in drawn.values()
        ]
        chosen = [colors for colors in of_filters if colors]  # not black, as references are
        assert all(len(colors) == 1 for colors in chosen), svg
        assert len(set().union(*chosen)) == min(len(chosen), len(filter_colors.COLORS)), svg
        checked += len(chosen) > 1
    assert checked > 20


@pytest.mark.parametrize("name", ["hdepf", "merwe-cost", "banana-pf", "air-traffic"])
def test_stored_references_and_bounds_are_black_or_gray(name: str) -> None:
    results = Results(STORED / name)
    for label in (results.config.get("reference"), results.config.get("bound")):
        if label:
            assert results.line_style(label)["color"] == "black"
