"""Figure kinds: ranks and cliques by hand, hostile labels, drawing one again."""

import numpy as np
import pytest
from matplotlib.collections import PolyCollection

from tests.commands import ran
from tests.conftest import PLANE
from tests.papers import merwe_text
from tests.report.forging import edit
from trackbench import api
from trackbench.errors import UserError
from trackbench.evaluation.metric_expression import measure
from trackbench.report.expressions import Evaluator
from trackbench.report.figures.bars import Bars
from trackbench.report.figures.critical_difference import cliques
from trackbench.report.figures.estimates_of_one_run import EstimatesOfOneRun
from trackbench.report.figures.rmse_per_run import RmsePerRun, _sort_over_shares
from trackbench.report.figures.rmse_vs_time import RmseVsTime
from trackbench.report.figures.track import Track
from trackbench.report.findings import grid_headings
from trackbench.report.plotting import file_formats, filter_colors, style
from trackbench.report.tables_and_figures import Results
from trackbench.statistics.estimates import RunEstimate
from trackbench.verify.verify_folder import verify

GRID = """
name: g
runs: 4
scenario: MERWE
filters: {PF: {kind: pf, N: 5}}
grid: {scenario.sensor.R: [1, 2]}
published: [n.csv]
""".replace("MERWE", merwe_text(T=5))


def test_cliques_are_the_largest_groups():
    assert cliques(np.array([3.0, 1.0, 1.5, 2.2]), 0.8) == [(1.0, 1.5), (1.5, 2.2), (2.2, 3.0)]
    assert cliques(np.array([1.0, 1.5, 1.6]), 2.0) == [(1.0, 1.6)]
    assert cliques(np.array([1.0, 2.0]), 0.5) == []


def test_only_draws_a_figure_by_name_or_by_kind(folder):
    assert [p.name for p in api.plot(folder, ["svg"], ["time"])] == ["time.svg"]
    assert [p.name for p in api.plot(folder, ["svg"], ["rmse-vs-time"])] == ["time.svg"]
    with pytest.raises(UserError, match="did you mean bars"):
        api.plot(folder, ["svg"], ["barz"])


def test_a_figure_none_of_whose_filters_ran_is_not_drawn_and_named(tmp_path):
    figures = """figures:
  both: {kind: rmse-vs-time, metric: rmse_position}
  of-kf: {kind: rmse-vs-time, metric: rmse_position, filters: [KF]}
"""
    text = "name: n\nruns: 3\n" + PLANE + "filters: {KF: {kind: kf}, EKF: {kind: ekf}}\n" + figures
    (tmp_path / "n.yaml").write_text(text)
    report = api.run(tmp_path / "n.yaml", only=["EKF"], out=tmp_path / "out", quiet=True)
    folder = tmp_path / "out"
    assert sorted(p.stem for p in (folder / "figures").glob("*.svg")) == ["both"]
    assert "because none of their filters ran: of-kf" in report.notes[0]
    assert "of-kf: none of their filters ran" in (folder / "report.html").read_text()
    with pytest.raises(UserError, match="--only of-kf: none of its filters ran"):
        api.plot(folder, ["svg"], ["of-kf"])
    with pytest.raises(UserError, match="none of its filters ran"):
        report.figure("of-kf")


def test_floor_and_baseline_have_a_look_of_their_own(made):
    spec = Results(made).parts("figures")["time"]
    looks = dict(spec.labels_and_looks(Results(made)))
    assert looks["Exact"] == filter_colors.FLOOR
    assert looks["No data"] == filter_colors.BASELINE
    assert looks["PF"] == filter_colors.line(0)
    assert (
        Results(made).line_style("Exact") == filter_colors.FLOOR
    )  # in figures that do not say so, too


@pytest.mark.parametrize(("level", "deviations"), [(0.6827, 1.0), (0.9545, 2.0), (0.9973, 3.0)])
def test_the_interval_of_an_expression_has_its_level(made, level, deviations):
    results = Results(made)
    term = Evaluator(results, {}).term(measure("rmse@5").of("PF"))
    figure = Bars(metric=measure("rmse@5"), level=level, filters=("PF",)).draw(results)
    bar, _ = figure.axes[0].containers  # PF, and the words of the legend
    (segment,) = bar.lines[2][0].get_segments()
    assert bar.lines[0].get_xdata() == [term.value]
    assert segment[:, 0] == pytest.approx(term.interval(level), rel=1e-12)
    plain = RunEstimate(1.0, 0.1, None, 400).interval(
        level
    )  # as of rmse@5 where no run has a share
    assert plain == pytest.approx((1.0 - 0.1 * deviations, 1.0 + 0.1 * deviations), rel=1e-4)


def test_a_published_number_stands_at_its_point(tmp_path):
    (tmp_path / "n.csv").write_text(
        "paper,table,filter,metric,value,label,expression,point\n"
        "p,t,f,m,1.5,PF,mean(rmse),scenario.sensor.R=2\n"
        "p,t,f,m,3.5,PF,mean(rmse),\n"
    )
    figure = Bars().draw(ran(tmp_path, GRID).results)
    shown = [
        [line.get_xdata()[0] for line in ax.lines if line.get_label() == "Published"]
        for ax in figure.axes
    ]
    assert shown == [[3.5], [1.5]]
    file_formats.close(figure)


def test_a_point_in_words():
    point = {"scenario.sensor.R": 0.1, "filters.A.q & filters.B.r": "low", "filters.A.fast": True}
    assert grid_headings.heading(point) == "R = 0.1, q = low, r = low, fast = True"


def test_a_dollar_or_a_long_label_is_only_text():
    assert style.wrap_label("a $x_$ b") == r"a \$x_\$ b"
    assert max(map(len, style.wrap_label("word " * 16).split("\n"))) <= 24


def test_a_filter_looks_the_same_in_every_figure(made):
    results = Results(made)
    looks = [
        dict(spec.labels_and_looks(results))
        for spec in map(results.parts("figures").get, ("time", "runs"))
    ]
    assert looks[0]["PF"] == looks[1]["PF"] == results.line_style("PF")
    assert RmseVsTime(filters=("No data",)).labels_and_looks(results).__next__()[
        1
    ] == results.line_style("No data")


def test_eight_filters_differ_in_gray_and_more_in_color_and_dash():
    looks = [(x["color"], str(x["linestyle"])) for x in map(filter_colors.line, range(24))]
    assert len({dash for _, dash in looks[:8]}) == 8
    assert len(set(looks)) == 24


def test_bands_are_said_and_more_than_three_are_bars(made):
    results = Results(made)
    for labels, bands in ((("PF",), 1), (("PF", "PF (N=50)", "No data", "Exact"), 0)):
        figure = RmseVsTime(filters=labels).draw(results)
        filled = [c for c in figure.axes[0].collections if isinstance(c, PolyCollection)]
        assert len([c for c in filled if c.get_paths()]) == bands
        legend = [text.get_text() for text in figure.legends[0].get_texts()]
        assert legend == [*labels, "± 2 standard errors"]
        file_formats.close(figure)


def test_time_stands_on_the_axis_if_asked(made):
    results = Results(made)
    figure = RmseVsTime(x="time").draw(results)
    times = results.per_step["time"].unique()
    np.testing.assert_array_equal(figure.axes[0].lines[0].get_xdata(), times)
    assert figure.axes[0].get_xlabel() == "Time (s)"
    file_formats.close(figure)


def test_a_run_stands_at_the_share_of_runs_that_do_no_worse(made):
    results = Results(made)
    runs = results.runs({})["PF", "rmse"]
    figure = RmsePerRun(filters=("PF",)).draw(results)
    share, value = figure.axes[0].lines[0].get_data()
    assert (value[0], value[-1], share[-1]) == (runs.min(), runs.max(), 100.0)
    np.testing.assert_allclose([np.mean(runs <= v) for v in value], 0.01 * share)
    file_formats.close(figure)
    assert _sort_over_shares(np.array([3.0, np.nan, 1.0]))[1].tolist()[:2] == [1.0, 3.0]
    assert np.isnan(_sort_over_shares(np.array([3.0, np.nan, 1.0]))[1][2])


def test_a_caption_names_the_diamonds_where_there_are_any(made):
    results = Results(made)
    diamonds = "Diamonds are the numbers that were published."
    assert Bars().default_caption(results).endswith(f" {diamonds}")
    assert diamonds not in Bars(metric=measure("mean(rmse)@3")).default_caption(results)
    # The published number at step 5 is that of PF.
    at_step = measure("rmse@5")
    assert diamonds in Bars(metric=at_step, filters=("PF",)).default_caption(results)
    assert diamonds not in Bars(metric=at_step, filters=("PF (N=50)",)).default_caption(results)


def test_the_report_begins_with_the_key_figure(folder):
    assert Results(folder).key_figure == "time"
    edit(folder, "config.yaml", "key_figure: null", "key_figure: bars")
    assert Results(folder).key_figure == "bars"
    (page,) = api.report(folder)
    assert page.read_text().partition("</header>")[0].count('<figure id="figure-bars">') == 1


def test_a_key_figure_is_one_of_the_figures(tmp_path):
    (tmp_path / "c.yaml").write_text(GRID.replace("published: [n.csv]", "key_figure: raneks"))
    with pytest.raises(UserError, match=r"c.yaml:\d+:13: key_figure: .* there are none"):
        api.prepare(tmp_path / "c.yaml", api.Options())


def test_errors_of_estimates_stand_below_them(made):
    results = Results(made)
    figure = EstimatesOfOneRun(filters=("PF",)).draw(results)
    above, below = figure.axes
    truth, estimate = (line.get_ydata() for line in above.lines)
    np.testing.assert_allclose(below.lines[1].get_ydata(), estimate - truth)
    file_formats.close(figure)


def test_a_grid_of_many_points_has_few_panels(tmp_path):
    grid = GRID.replace("[1, 2]", str(list(range(1, 31)))).replace("published: [n.csv]", "")
    results = ran(tmp_path, grid).results
    for spec in (RmseVsTime(title="Many"), Bars(title="Many")):
        figure = spec.draw(results)
        assert figure.get_suptitle() == "Many: the first 12 of 30 points"
        assert len([ax for ax in figure.axes if ax.axison]) == 12
        file_formats.close(figure)


def test_titles_say_how_many_runs_there_were(tmp_path):
    text = GRID.replace("published: [n.csv]", "title: Over {runs} runs")
    text += "tables: {t: {kind: metrics, title: '{runs} runs', columns: {RMSE: mean(rmse)}}}\n"
    text += "figures: {f: {kind: bars, title: 'of {runs}'}}\n"
    done = ran(tmp_path, text, runs=3, formats=("svg",))
    assert done.tables["t"].title == "3 runs"
    assert done.results.title == "Over 3 runs"
    page = (tmp_path / "out" / "report.html").read_text()
    for words in ("<h1>Over 3 runs</h1>", "of 3", "3 runs"):
        assert words in page
    assert "{runs}" not in page.partition("The resolved config")[0]


def test_an_experiment_that_asks_for_nothing_shows_its_errors(tmp_path):
    text = GRID.replace("published: [n.csv]", "").partition("grid:")[0]
    done = ran(tmp_path, text, formats=("svg",))
    assert list(done.tables) == ["results"]
    assert done.tables["results"].value_headers == ["RMSE", "ANEES"]
    assert (tmp_path / "out" / "figures" / "results.svg").is_file()
    assert 'id="figure-results"' in (tmp_path / "out" / "report.html").read_text()
    assert verify(tmp_path / "out", 4) == []
    ran(tmp_path, text, set=("tables={t: {kind: consistency}}",))
    assert not (tmp_path / "out" / "tables" / "results.csv").exists()


@pytest.mark.parametrize(
    ("figure", "caption"),
    [
        (Track(best=1), "The target in the plane in the first run, with the estimates of KF."),
        (
            Track(filters=("KF",), runs=3),
            "The target in the plane in the first 3 runs, with the estimates of KF.",
        ),
        (Track(best=0), "The target in the plane in the first run."),
        (
            Track(filters=("KF", "Prior"), runs=3),
            "The target in the plane in the first 3 runs, a panel for each of KF and Prior.",
        ),
        (
            EstimatesOfOneRun(component=3, run=2),
            "Estimates of py by KF and Prior in run 2, and their errors where there is a truth.",
        ),
    ],
)
def test_a_caption_names_component_run_and_filters(tmp_path, figure, caption):
    filters = "filters: {KF: {kind: kf}, Prior: {kind: prior-mean}}\n"
    # A target of one path for all runs; of another kind the figure `track` shows the first run.
    target = "{kind: driven, motion: {kind: cv, q: 1}, launch"
    plane = PLANE.replace(target, "{kind: legs, launch")
    plane = plane.replace("  last: 8", "  last: 8\n  assume: {motion: {kind: cv, q: 1}}")
    assert plane != PLANE
    results = ran(tmp_path, f"name: c\nruns: 6\n{plane}{filters}", formats=()).results
    assert figure.default_caption(results) == caption
    if isinstance(figure, Track):
        other = ran(tmp_path, f"name: c\nruns: 6\n{PLANE}{filters}", formats=()).results
        assert figure.default_caption(other) == caption.replace("first 3 runs", "first run")
