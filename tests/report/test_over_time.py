"""Figures over time: a panel per filter where one panel is illegible, gaps where steps are missing."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tests.commands import ran
from trackbench.evaluation.metric_expression import measured
from trackbench.report.figure_drawing import draw_figure
from trackbench.report.figures.anees import Anees
from trackbench.report.figures.estimates_of_one_run import EstimatesOfOneRun
from trackbench.report.figures.nis import Nis
from trackbench.report.figures.over_time import OverTime, draw_gray_line
from trackbench.report.figures.rmse_per_run import RmsePerRun
from trackbench.report.figures.rmse_vs_time import RmseVsTime
from trackbench.report.plotting import file_formats, filter_lines, style, zeros_on_log_axes
from trackbench.report.tables_and_figures import Results

LABELS = ["A", "B", "C", "D", "E", "A filter with a name of many words", "Bound"]
CONFIG = """
name: many
runs: 4
metrics: [rmse_position, anees, anis, innovations]
scenario:
  kind: tracking
  T: 1
  last: 160
  target: {kind: legs, launch: {x: 0, y: 0, vx: 0, vy: -15}, legs: [{start: 10, end: 20, ax: 1, ay: 1}]}
  sensor: {kind: position, sigma: 10}
  start: two-scan
filters: {FILTERS}
tables: {}
figures: {time: {kind: rmse-vs-time, metric: rmse_position}, estimates: {kind: estimates}}
"""
RMSE = measured("rmse_position")
FILTER = "{kind: kf, assume: {motion: {kind: cv, q: %g}}}"


@pytest.fixture(scope="module")
def many(tmp_path_factory: pytest.TempPathFactory) -> Results:
    folder = tmp_path_factory.mktemp("many")
    filters = [f"{label}: {FILTER % (i + 1)}" for i, label in enumerate(LABELS)]
    return ran(folder, CONFIG.replace("FILTERS", ", ".join(filters))).results


def panels(spec: OverTime, results: Results) -> list[Axes]:
    with style.rc_context():
        return [ax for ax in spec.draw(results).axes if ax.axison]


def lines(ax: Axes) -> dict[str, np.ndarray]:
    """Return the points (n, 2) of labeled lines that have any."""
    found = {str(line.get_label()): np.asarray(line.get_xydata(), float) for line in ax.lines}
    return {label: xy for label, xy in found.items() if len(xy) > 2 and label[0] != "_"}


@pytest.mark.parametrize("log", [False, True])
def test_many_filters_over_many_steps_have_a_panel_each(many: Results, log: bool) -> None:
    shown = panels(RmseVsTime(metric=RMSE, floor="Bound", log=log), many)
    assert [ax.get_title().replace("\n", " ") for ax in shown] == LABELS[:6]
    frame = many.per_step.query("metric == 'rmse_position'")
    for ax, label in zip(shown, LABELS, strict=False):
        assert [*lines(ax)] == [label, "Bound"]
        np.testing.assert_allclose(
            lines(ax)[label][:, 1], frame.loc[frame["filter"] == label, "value"]
        )
        assert sum(line.get_label() == "_gray" for line in ax.lines) == 5
    assert len({ax.get_ylim() for ax in shown}) == len({ax.get_xlim() for ax in shown}) == 1
    (legend,) = shown[0].figure.legends
    words = [text.get_text().replace("\n", " ") for text in legend.get_texts()]
    assert words == ["Other filters, means over 2 steps", "Bound", style.SPREAD]


@pytest.mark.parametrize(
    "kind", [RmseVsTime(metric=RMSE), Anees(n_x=4), Nis(), EstimatesOfOneRun()]
)
def test_seven_panels_stand_in_rows_of_four_and_three(many: Results, kind: OverTime) -> None:
    shown = panels(kind, many)
    assert len(shown) == 7
    labeled = [ax.get_xlabel() != "" for ax in shown]
    assert labeled == [False] * 3 + [True] * 4  # where no panel is below
    ticks = [any(tick.label1.get_visible() for tick in ax.xaxis.get_major_ticks()) for ax in shown]
    assert ticks == labeled


@pytest.mark.parametrize("labels", [LABELS[:5], LABELS[:1]])
def test_few_filters_have_one_panel(many: Results, labels: Sequence[str]) -> None:
    (ax,) = panels(RmseVsTime(metric=RMSE, filters=tuple(labels), floor="Bound"), many)
    assert [*lines(ax)] == [*labels, "Bound"]
    assert len(panels(EstimatesOfOneRun(filters=tuple(labels)), many)) == 2


def test_panels_of_nis_have_averages_over_steps(many: Results) -> None:
    shown = panels(Nis(over=2), many)
    assert [next(iter(lines(ax))) for ax in shown] == LABELS
    frame = many.per_step.query("metric == 'anis' and filter == 'B'")
    averages = frame["value"].to_numpy()[: 2 * (len(frame) // 2)].reshape(-1, 2).mean(axis=1)
    np.testing.assert_allclose(lines(shown[1])["B"][:, 1], averages)
    words = [text.get_text() for text in shown[0].figure.legends[0].get_texts()]
    assert "Other filters, means\nover 2 steps" in words


def test_a_label_without_steps_has_no_panel(many: Results) -> None:
    steps = dict.fromkeys(LABELS, 200)
    assert Anees(n_x=4).panel_labels(many, steps) == LABELS
    assert Anees(n_x=4).panel_labels(many, steps | {"Bound": 0}) == LABELS[:6]


def test_the_panels_of_estimates_have_the_errors_of_a_run(many: Results) -> None:
    tracks = many.tracks({})
    for ax, label in zip(panels(EstimatesOfOneRun(), many), LABELS, strict=True):
        error = (tracks[f"mean/{label}"] - tracks["truth"])[0, :, 0]
        np.testing.assert_allclose(lines(ax)[label][:, 1], error[np.isfinite(error)])


def test_the_page_reads_a_panel_of_its_own_filter_only(many: Results) -> None:
    ((_, content),) = draw_figure(RmseVsTime(metric=RMSE, floor="Bound"), many, ["svg"])
    root = ET.fromstring(content)
    live = json.loads(root.get("data-live", ""))
    assert live["labels"] == ["A", "Bound", *LABELS[1:6]]
    assert len({ax["x"]["group"] for ax in live["axes"]}) == 1
    assert len({ax["y"]["group"] for ax in live["axes"]}) == 1
    for number, axes in enumerate(live["axes"]):
        (panel,) = (group for group in root.iter() if group.get("data-axes") == str(number))
        owners = {g.get("data-of") for g in panel.iter() if g.get("data-of")}
        own = live["labels"].index(LABELS[number])
        assert owners == {str(own), "1"}
        assert {str(c["of"]) for c in axes["curves"] if c["stderr"]} == owners


def test_gray_lines_are_means_over_windows() -> None:
    figure, ax = style.subplots()
    x = np.arange(250.0)
    draw_gray_line(ax, x, np.where(x == 100.0, np.nan, 2.0 * x))
    drawn = ax.lines[0].get_xydata()
    assert len(drawn) == 84
    assert drawn[0].tolist() == [1.0, 2.0]
    assert drawn[-1].tolist() == [249.0, 498.0]
    assert np.isnan(drawn[33, 1])  # the window with the gap
    assert np.isfinite(np.delete(drawn, 33, axis=0)).all()
    draw_gray_line(ax, x[:0], x[:0])
    file_formats.close(figure)


def test_a_gap_is_wider_than_three_usual_distances() -> None:
    steps = np.array([1, 2, 3, 6, 7, 11, 12])
    (shown,) = filter_lines.insert_gaps(steps, steps)
    np.testing.assert_array_equal(shown, [1, 2, 3, 6, 7, np.nan, 11, 12])
    for few in (steps[:0], steps[:1], 10 * np.arange(5)):
        np.testing.assert_array_equal(filter_lines.insert_gaps(few, few)[0], few)


@pytest.mark.parametrize("kind", [RmseVsTime(metric=RMSE), EstimatesOfOneRun()])
def test_a_line_ends_where_the_truth_has_a_gap(tmp_path: Path, kind: OverTime) -> None:
    """The truth lacks steps 41 to 60, and of steps 80 to 99 every second one."""
    rows = [f"{k},{3 * k},{2 * k}" for k in range(1, 121)]
    (tmp_path / "z.csv").write_text("\n".join(["step,x,y", *rows]) + "\n")
    known = [k for k in range(1, 121) if not 40 < k <= 60 and not (80 <= k < 100 and k % 2)]
    truth = [f"{k},{3 * k},{2 * k},3,2" for k in known]
    (tmp_path / "t.csv").write_text("\n".join(["step,x,y,vx,vy", *truth]) + "\n")
    text = (
        "name: gap\nscenario:\n  kind: tracking\n  T: 1\n"
        "  target: {kind: measured, measurements: z.csv, truth: t.csv}\n"
        "  sensor: {kind: position, sigma: 1}\n  start: two-scan\n"
        f"filters: {{A: {FILTER % 1}}}\nmetrics: [rmse_position]\n"
        "figures: {one: {kind: estimates}}\n"
    )
    ax = panels(kind, ran(tmp_path, text).results)[-1]
    xy = lines(ax)["A"]
    breaks = np.flatnonzero(np.isnan(xy[:, 0]))
    assert len(breaks) == 1
    assert xy[breaks[0] - 1, 0] == 40
    assert xy[breaks[0] + 1, 0] == 61
    assert {*known[2:]} <= {*xy[np.isfinite(xy[:, 0]), 0].astype(int)}


DIVERGED = """
name: diverged
runs: 4
scenario:
  kind: tracking
  T: 1
  last: 40
  target: {kind: driven, motion: {kind: cwna, q: 1}, launch: {x: 1000, y: 500, vx: 10, vy: -3}}
  sensor: {kind: position, sigma: 2}
  start: {kind: gaussian, sigma: [2, 1, 2, 1]}
filters:
  Good: {kind: kf}
  Other: {kind: kf, assume: {motion: {kind: cwna, q: 5}}}
  Bad: {kind: kf, assume: {motion: {kind: cwna, q: 1.0e-9}, sensor: {kind: position, sigma: 2000}}}
figures:
  time: {kind: rmse-vs-time}
  runs: {kind: rmse-per-run}
  similar: {kind: rmse-vs-time, filters: [Good, Other], x: time}
  said: {kind: rmse-vs-time, y_label: Position RMSE (km)}
"""


def test_an_axis_without_a_label_gets_one_and_is_logarithmic_where_one_curve_dwarfs_the_others(
    tmp_path: Path,
) -> None:
    """The figures name no metric either: they show the scenario's first error."""
    stored = ran(tmp_path, DIVERGED).results
    axes = {name: stored.figure(name).axes[0] for name in stored.parts("figures")}
    assert {name: (ax.get_ylabel(), ax.get_yscale()) for name, ax in axes.items()} == {
        "time": ("Position RMSE (m)", "log"),
        "runs": ("Position RMSE (m)", "log"),
        "similar": ("Position RMSE (m)", "linear"),
        "said": ("Position RMSE (km)", "linear"),
    }


UNSORTED = """
name: unsorted
runs: 2
scenario:
  kind: tracking
  last: 12
  target: {kind: driven, motion: {kind: cv, q: 1}, launch: {x: 10}}
  sensor: {kind: position, sigma: 1}
  start: {kind: gaussian, sigma: [2, 1, 2, 1]}
  faults:
  - {name: early, kind: blackout, from: 3, to: 6}
  - {name: late, kind: outliers, from: 5, to: 9, factor: 5}
GRID
filters: {EKF: {kind: ekf}}
tables: {}
figures: {time: {kind: rmse-vs-time, metric: rmse_position}, one: {kind: estimates}}
"""


def test_panels_of_a_number_ascend_and_have_its_unit(tmp_path: Path) -> None:
    stored = ran(tmp_path, UNSORTED.replace("GRID", "grid: {scenario.sensor.sigma: [3, 1, 2]}"))
    titles = ["sigma = 1 m", "sigma = 2 m", "sigma = 3 m"]
    for name in ("time", "one"):
        shown = panels(stored.results.parts("figures")[name], stored.results)
        assert [ax.get_title() for ax in shown if ax.get_title()] == titles
    # The panel of a value has its numbers.
    first = panels(stored.results.parts("figures")["time"], stored.results)[0]
    rows = stored.results.per_step.query("metric == 'rmse_position'")
    of_first = rows.loc[rows["scenario.sensor.sigma"] == 1, "value"]
    np.testing.assert_allclose(lines(first)["EKF"][:, 1], of_first)


def test_panels_of_linked_paths_are_named_by_the_paths_that_differ(tmp_path: Path) -> None:
    grid = "grid: {scenario.sensor.sigma & scenario.target.motion.q: [[1, 2], [1, 3]]}"
    low = UNSORTED.replace("GRID", "grid: {scenario.target.launch.x: [-2, 10]}")
    below_zero = ran(tmp_path, low, out=tmp_path / "low").results
    titles = [ax.get_title() for ax in panels(below_zero.parts("figures")["time"], below_zero)]
    assert titles == ["x = \N{MINUS SIGN}2", "x = 10"]
    both = ran(tmp_path, UNSORTED.replace("GRID", grid), out=tmp_path / "both").results
    titles = [ax.get_title() for ax in panels(both.parts("figures")["time"], both)]
    assert titles == ["sigma = 1 m, q = 2 m²/s⁴", "sigma = 1 m, q = 3 m²/s⁴"]
    one = ran(tmp_path, UNSORTED.replace("GRID", grid.replace("[1, 3]", "[4, 3]"))).results
    titles = [ax.get_title() for ax in panels(one.parts("figures")["time"], one)]
    assert titles == ["sigma = 1 m", "sigma = 4 m"]
    times = ran(tmp_path, UNSORTED.replace("GRID", "grid: {scenario.T: [1, 2]}")).results
    titles = [ax.get_title() for ax in panels(times.parts("figures")["time"], times)]
    assert titles == ["T = 1 s", "T = 2 s"]
    start = UNSORTED.replace("[2, 1, 2, 1]", "{px: 2, vx: 1, py: 2, vy: 1}")
    start = start.replace("GRID", "grid: {scenario.start.sigma.px: [1, 2]}")
    components = ran(tmp_path, start).results
    titles = [ax.get_title() for ax in panels(components.parts("figures")["time"], components)]
    assert titles == ["px = 1 m", "px = 2 m"]


def test_faults_that_overlap_are_shaded_above_each_other(tmp_path: Path) -> None:
    stored = ran(tmp_path, UNSORTED.replace("GRID", "")).results
    (ax,) = panels(stored.parts("figures")["time"], stored)
    heights = [patch.get_bbox().intervaly.tolist() for patch in ax.patches]
    assert heights == [[0.5, 1.0], [0.0, 0.5]]
    words = "early and late have a strip each, from top to bottom."
    assert words in stored.parts("figures")["time"].default_caption(stored)
    apart = ran(tmp_path, UNSORTED.replace("GRID", "").replace("from: 5", "from: 7")).results
    (ax,) = panels(apart.parts("figures")["time"], apart)
    assert [patch.get_bbox().intervaly.tolist() for patch in ax.patches] == [[0.0, 1.0]] * 2
    assert words not in apart.parts("figures")["time"].default_caption(apart)


def test_lines_on_a_logarithmic_axis_begin_where_each_can(tmp_path: Path) -> None:
    """The filter with a known start has no error at first, which the axis cannot show."""
    text = UNSORTED.partition("  faults:")[0] + (
        "filters: {EKF: {kind: ekf}, Known: {kind: ekf, start: {kind: given, mean: truth}}}\n"
        "tables: {}\nfigures: {time: {kind: rmse-vs-time, metric: rmse_position, log: true}}\n"
    )
    stored = ran(tmp_path, text.replace(", start: {kind: given, mean: truth}", "")).results
    series = stored.columns("per_step").where(metric="rmse_position")
    is_first = (series["filter"] == "Known") & (series["step"] == series["step"].min())
    series["value"][is_first] = 0.0
    stored.__dict__["columns"] = lambda name, point=None: series
    (ax,) = panels(stored.parts("figures")["time"], stored)
    first = series["step"].min()
    for label, first_shown in (("EKF", first), ("Known", first + 1)):
        x, y = lines(ax)[label].T
        assert x[np.isfinite(y)][0] == first_shown


def test_the_axes_of_estimates_have_name_and_unit(tmp_path: Path) -> None:
    stored = ran(tmp_path, UNSORTED.replace("GRID", "")).results
    shown = panels(stored.parts("figures")["one"], stored)
    assert [ax.get_ylabel() for ax in shown] == ["px (m)", "Estimate \N{MINUS SIGN} truth (m)"]
    shown = panels(EstimatesOfOneRun(y_label="East (km)"), stored)
    assert [ax.get_ylabel() for ax in shown] == ["East (km)", "Estimate \N{MINUS SIGN} truth (km)"]


def test_a_caption_names_lines_of_which_one_hides_the_other(tmp_path: Path) -> None:
    text = UNSORTED.partition("  faults:")[0] + (
        "filters: {EKF: {kind: ekf}, UKF: {kind: ukf}, Wide: {kind: ekf, assume: {motion: MOTION}}}\n"
        "tables: {}\n"
    ).replace("MOTION", "{kind: cwna, q: 100}")
    stored = ran(tmp_path, text).results
    spec = RmseVsTime(metric=RMSE)
    assert "The lines of EKF and UKF coincide." in spec.default_caption(stored)
    assert "coincide" not in replace(spec, filters=("EKF", "Wide")).default_caption(stored)
    per_run = RmsePerRun(metric=RMSE)
    assert "The lines of EKF and UKF coincide." in per_run.default_caption(stored)


def test_a_caption_says_what_the_bound_is_of(tmp_path: Path) -> None:
    without_faults = UNSORTED.partition("  faults:")[0]
    text = f"{without_faults}bound: PCRLB\nfilters: {{EKF: {{kind: ekf}}}}\ntables: {{}}\n"
    stored = ran(tmp_path, text).results
    words = "PCRLB bounds filters whose first errors have the covariance of the start"
    spec = RmseVsTime(metric=RMSE)
    assert f" {words}." in spec.default_caption(stored)
    assert words not in replace(spec, filters=("EKF",)).default_caption(stored)
    smoothed = ran(tmp_path, text.replace("{kind: ekf}", "{kind: ekf, smooth: true}")).results
    assert f"{words}; smoothers may lie below it." in spec.default_caption(smoothed)


KNOWN_START = """
name: known
runs: 3
scenario:
  kind: tracking
  T: 1
  last: 8
  target: {kind: driven, motion: {kind: cwna, q: 1}, launch: {x: 0, y: 0, vx: 1, vy: 0}}
  sensor: {kind: position, sigma: 10}
  start: {kind: given, mean: [0, 1, 0, 0], cov: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}
filters: {KF: {kind: kf}, Smoother: {kind: kf, smooth: true}}
bound: PCRLB
tables: {}
figures: {time: {kind: rmse-vs-time, metric: rmse_position, log: true}}
"""


def test_zeros_below_a_logarithmic_axis_are_marked(tmp_path: Path) -> None:
    """The bound keeps its point at the step at which the error of the filter is zero."""
    results = ran(tmp_path, KNOWN_START).results
    (ax,) = panels(RmseVsTime(metric=RMSE, log=True), results)
    curves = lines(ax)
    assert np.isfinite(curves["PCRLB"][0]).all()
    assert np.isfinite(curves["Smoother"][0]).all()
    assert np.isnan(curves["KF"][0, 1])
    (zeros,) = (line for line in ax.lines if line.get_label() == "_zero")
    assert zeros.get_xdata() == curves["KF"][0, 0]
    legend = [text.get_text() for text in ax.figure.legends[0].get_texts()]
    assert "Zero, below the axis" in legend
    # A linear axis shows the zero itself.
    (ax,) = panels(RmseVsTime(metric=RMSE, y_label="error"), results)
    assert lines(ax)["KF"][0, 1] == 0.0
    assert not [line for line in ax.lines if line.get_label() == "_zero"]


def test_a_first_state_that_all_filters_know_needs_no_mark(tmp_path: Path) -> None:
    text = KNOWN_START.replace(", Smoother: {kind: kf, smooth: true}", "").replace(
        "bound: PCRLB", ""
    )
    results = ran(tmp_path, text).results
    spec = RmseVsTime(metric=RMSE, log=True)
    (ax,) = panels(spec, results)
    assert not [line for line in ax.lines if line.get_label() == "_zero"]
    words = "The state is known exactly at the first step, so that lines begin behind it."
    assert words in spec.default_caption(results)
    assert words not in RmseVsTime(metric=RMSE, y_label="error").default_caption(results)


def test_places_of_zeros_that_lines_share_have_a_color_of_their_own() -> None:
    ax = Figure().add_subplot()
    first = zeros_on_log_axes.Zeros(x=np.array([0.0, 2.0]), color="red")
    second = zeros_on_log_axes.Zeros(x=np.array([0.0, 3.0]), color="blue")
    zeros_on_log_axes.mark_zeros(ax, [first, second])
    marks = {
        line.get_color(): line.get_xdata().tolist() for line in ax.lines if len(line.get_xdata())
    }
    assert marks == {"red": [2.0], "blue": [3.0], style.ANY: [0.0]}
    # Many zeros have a few marks.
    ax = Figure().add_subplot()
    zeros_on_log_axes.mark_zeros(ax, [zeros_on_log_axes.Zeros(x=np.arange(1000.0), color="red")])
    assert len(ax.lines[0].get_xdata()) <= 30


def test_a_value_between_zeros_is_a_dot() -> None:
    ax = Figure().add_subplot()
    value = np.array([np.nan, 3.0, np.nan, 4.0, 5.0])
    filter_lines.draw_lone_points(ax, np.arange(5.0), value, "red")
    (line,) = ax.lines
    assert line.get_xydata().tolist() == [[1.0, 3.0]]


def test_zeros_of_any_line_on_a_logarithmic_axis_are_marked() -> None:
    ax = Figure().add_subplot()
    ax.plot([1.0, 2.0, 3.0], [0.0, 1.0, 10.0], label="KF", color="red")
    zeros_on_log_axes.mark_zeros_of_lines(ax)
    assert len(ax.lines) == 1  # a linear axis shows it
    ax.set_yscale("log")
    zeros_on_log_axes.mark_zeros_of_lines(ax)
    (zeros,) = (line for line in ax.lines if line.get_label() == "_zero")
    assert zeros.get_xdata().tolist() == [1.0]
