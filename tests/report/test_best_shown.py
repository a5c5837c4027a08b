"""Figures show the best filters; swept keys have units, and those of a scenario no best value."""

import json
import shutil
from dataclasses import replace
from types import SimpleNamespace
from xml.etree import ElementTree as ET

import numpy as np
import pytest
import yaml

from tests.commands import ran
from tests.conftest import PLANE as POSITIONS
from trackbench import api
from trackbench.report.figures.rmse_vs_parameter import RmseVsParameter
from trackbench.report.figures.rmse_vs_time import RmseVsTime
from trackbench.report.figures.sweep import SweepFigure
from trackbench.report.findings import best_filter_sentences
from trackbench.report.findings.ranking import rankings
from trackbench.report.overview.result_on_card import short_answer
from trackbench.report.plotting import file_formats
from trackbench.report.tables_and_figures import Results

PLANE = """
name: plane
runs: 8
scenario:
  kind: tracking
  T: 5
  last: 20
  target: {kind: driven, motion: {kind: cwna, q: 1}, launch: {x: 500, y: 300, vx: 10}}
  sensor:
    - {kind: bearing, sigma_mrad: 5, at: [0, 0]}
    - {kind: bearing, sigma_mrad: 5, at: [900, 0]}
    - {kind: bearing, sigma_mrad: 5, at: [90000, 0]}
  start: {kind: gaussian, sigma: [30, 5, 30, 5]}
filters:
  Prior: {kind: prior-mean}
  EKF: {kind: ekf}
  UKF: {kind: ukf}
  Wide: {kind: ekf, assume: {motion: {kind: cwna, q: 100}}}
"""


@pytest.fixture(scope="module")
def plane(tmp_path_factory):
    return ran(tmp_path_factory.mktemp("plane"), PLANE, formats=("svg",)).results


def test_a_figure_that_compares_some_filters_shows_the_best_too(made):
    results = Results(made)
    best = rankings(results)[0].order[0].label
    others = tuple(b for b in results.filters if b not in (best, "Exact"))
    assert RmseVsTime(filters=others[:2]).with_best(results).filters == (*others[:2], best)
    for kept in (others[:1], (best, *others[:1]), None):
        assert RmseVsTime(filters=kept).with_best(results).filters == kept
    figure = RmseVsTime(filters=others[:2]).with_best(results).draw(results)
    assert best in {line.get_label() for line in figure.axes[0].lines}
    file_formats.close(figure)


def test_the_default_track_has_the_three_best_and_sensors_that_are_near(plane):
    best = [c.label for c in rankings(plane)[0].order[:3]]
    assert "Prior" not in best  # the first in the config, and the worst
    assert yaml.safe_load((plane.folder / "config.yaml").read_text())["figures"].keys() == {"track"}
    figure = plane.figure("track")
    lines = {line.get_label(): line for line in figure.axes[0].lines}
    assert [label for label in lines if label in plane.filters] == best
    assert {"Truth", "Start", "Sensor 1", "Sensor 2"} < lines.keys()
    assert "Sensor 3" not in lines  # 90 km away the track would be a dot
    np.testing.assert_allclose(lines["Sensor 2"].get_xydata(), [[900, 0]])
    np.testing.assert_allclose(
        lines[best[0]].get_xdata(), plane.shown[f"mean/{best[0]}"][0, :, 0], equal_nan=True
    )
    file_formats.close(figure)


@pytest.mark.parametrize(
    ("path", "marks"), [("scenario.target.motion.q", 0), ("filters.Wide.assume.motion.q", 1)]
)
def test_a_swept_key_has_its_unit_and_a_scenario_no_best(tmp_path, path, marks):
    table = "tables: {t: {kind: metrics, columns: {E: mean(rmse_position)}}}"
    results = ran(tmp_path, f"{PLANE}\ngrid: {{{path}: [0.5, 1, 4]}}\n{table}\n").results
    assert results.axis(path) == "q (m²/s³)"
    assert f"| {path} (m²/s³) |" in (results.folder / "tables" / "t.md").read_text()
    assert (results.folder / "tables" / "t.csv").read_text().startswith(f"{path},Filter,E,")
    only = ("Wide",)
    for spec in (RmseVsParameter(filters=only), SweepFigure(paths=(path,), filters=only)):
        figure = spec.draw(results)
        ax = figure.axes[0]
        best = [
            line for line in ax.lines if line.get_marker() == "o" and len(line.get_xdata()) == 1
        ]
        assert ax.get_xlabel() == "q (m²/s³)"
        assert len(best) == marks
        assert ("Best" in spec.default_caption(results)) == bool(marks)
        panel = json.loads(ET.fromstring(file_formats.content(figure, "svg")).get("data-live"))[
            "axes"
        ][0]
        rows = results.summary.query("filter == 'Wide' and metric == 'mean(rmse_position)'")
        for key, column in (("y", "value"), ("stderr", "stderr")):
            assert panel["curves"][0][key] == rows[column].tolist()
        file_formats.close(figure)


def test_the_index_groups_by_topic_and_says_each_result(plane, made, tmp_path):
    for name, results in (("plane", plane), ("small", Results(made))):
        shutil.copytree(results.folder, tmp_path / name)
    index, ledger = api.report(tmp_path)
    (found,) = rankings(plane)
    result = short_answer([found])
    assert found.among_the_best[0].label in result or "no significant difference" in result
    assert len(result.split()) <= 7
    page, text = index.read_text(), ledger.read_text()
    topics = ("Targets seen by radar, lidar or bearings", "Other dynamic systems")
    for topic, name in zip(topics, ("plane", "small"), strict=True):
        assert page.index(topic) < page.index(f">{name}<")
        assert text.index(f"## {topic}") < text.index(f"### [{name}]")
    assert f"- Result: {result}" in text
    assert f"<strong>{result}</strong>" in page
    assert short_answer([found, found]).endswith("best at 2 of 2")


def test_a_result_is_five_words(plane):
    (found,) = rankings(plane)
    first, *others = found.order
    alone = found._replace(best=first, ties=[], worse=[(c, None) for c in others])
    assert short_answer([alone]) == f"{first.label} best of 4 filters"
    tuned = replace(first, label="A, tuned")
    assert short_answer([alone._replace(best=tuned)]) == "“A, tuned” best of 4 filters"
    assert short_answer([found._replace(best=None)]) == "which is best is inconclusive"
    assert short_answer([]) == ""


def test_the_headline_names_the_best_and_those_that_are_not_worse(plane, monkeypatch):
    (found,) = rankings(plane)
    a, b, c = found.order[:3]
    tie, worse = (SimpleNamespace(filter=candidate) for candidate in (b, c))

    def headline(*scene_rankings):
        monkeypatch.setattr(best_filter_sentences, "rankings", lambda results: [*scene_rankings])
        return best_filter_sentences.headline(plane)

    decided = found._replace(best=a, ties=[tie], worse=[worse], undecided=[])
    first = f"{a.name} has the lowest position RMSE of 4 filters."
    assert headline(decided) == f"{first} {b.name} does not differ significantly from it."
    assert headline(decided._replace(ties=[])) == first
    alike = decided._replace(ties=[tie, worse], worse=[])
    assert headline(alike) == "The 4 filters do not differ significantly."
    assert headline(alike._replace(undecided=[worse])) == ""
    assert headline(found._replace(best=None)) == ""
    assert headline(decided._replace(order=[a])) == ""
    assert headline() == ""
    scenes = [decided._replace(scene={"scenario.T": 1}), decided._replace(scene={"scenario.T": 2})]
    assert headline(*scenes) == f"{a.label} is among the best at 2 of 2 values of T."


@pytest.mark.parametrize("labels", [("KF", "EKF"), ("EKF", "KF")])
def test_a_solid_track_lies_below_an_equal_dashed_one(tmp_path, labels):
    kinds = {"KF": "{kind: kf}", "EKF": "{kind: ekf}"}
    filters = "".join(f"  {label}: {kinds[label]}\n" for label in labels)
    more = "  Prior: {kind: prior-mean}\n"
    text = f"name: e\nruns: 6\n{POSITIONS}filters:\n{filters}{more}"
    figure = ran(tmp_path, text, formats=()).results.figure("track")
    lines = {line.get_label(): line for line in figure.axes[0].lines}
    first, second = (lines[label] for label in labels)
    np.testing.assert_allclose(first.get_xydata(), second.get_xydata())
    assert (first.get_linestyle(), second.get_linestyle()) == ("-", "--")
    assert first.get_zorder() < second.get_zorder()
    file_formats.close(figure)
