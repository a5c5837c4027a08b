"""Default figures: axes that fit what is drawn, ticks, legends, and captions of what is shown."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from tests.commands import ran, trackbench
from tests.papers import banana_text
from trackbench.config.tuning_axes import Axis
from trackbench.evaluation.metric_expression import measure
from trackbench.report.figures import caption_parts
from trackbench.report.figures.anees import Anees
from trackbench.report.figures.banana import PosteriorEllipses
from trackbench.report.figures.bars import Bars
from trackbench.report.figures.estimates_of_one_run import EstimatesOfOneRun
from trackbench.report.figures.heat_map import HeatMap
from trackbench.report.figures.rank_histograms import CalibrationFigure
from trackbench.report.figures.rmse_vs_parameter import RmseVsParameter
from trackbench.report.figures.rmse_vs_time import RmseVsTime
from trackbench.report.figures.sweep import SweepFigure
from trackbench.report.figures.tuned_keys import _draw_panel
from trackbench.report.plotting import scales, style, tick_labels, zeros_on_log_axes
from trackbench.report.plotting.page_formats import COLUMN, drawing_for
from trackbench.report.tables_and_figures import Results

SIZE = "filters.PF.N"
NOISE = "scenario.sensor.sigma"
CONFIG = """name: defaults
runs: 8
scenario:
  kind: tracking
  last: 4
  target: {kind: driven, motion: {kind: cv, q: 1}, launch: {x: 10, vx: 1}}
  sensor: {kind: position, sigma: 5}
  start: {kind: gaussian, sigma: [2, 1, 2, 1]}
bound: PCRLB
filters: {KF: {kind: kf}, PF: {kind: pf, N: 100}}
grid: {filters.PF.N: [6, 7, 9], scenario.sensor.sigma: [10, 250]}
tables: {}
figures:
  e: {kind: estimates}
  c: {kind: calibration, columns: {State: pit_nees@last}}
  s: {kind: rmse-vs-time, metric: ess}
"""


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Results:
    return ran(tmp_path_factory.mktemp("defaults"), CONFIG).results


def labels_of(axis: Any) -> list[str]:
    """Texts of the ticks that are within the axis."""
    low, high = axis.get_view_interval()
    ticks = [tick for tick in axis.get_major_ticks() if low <= tick.get_loc() <= high]
    return [tick.label1.get_text() for tick in ticks if tick.label1.get_text()]


def legend_of(figure: Figure) -> list[str]:
    return [text.get_text() for legend in figure.legends for text in legend.get_texts()]


def with_values(
    results: Results, file: str, metric: str, label: str, factor: float, size: int | None = None
) -> Results:
    """The results with a filter's metric multiplied, at all points or at those of one size."""
    columns = results.columns(file)
    is_changed = (columns["metric"] == metric) & (columns["filter"] == label)
    if size is not None:
        is_changed &= columns[SIZE] == size
    arrays = dict(columns.arrays)
    arrays["value"] = np.array(arrays["value"])
    arrays["value"][is_changed] *= factor
    changed = Results(results.folder)
    changed._columns[file] = type(columns)(arrays)
    return changed


@pytest.mark.parametrize("sigma_azimuth", [0.01, 200.0])
def test_a_posterior_is_within_its_panel(tmp_path: Path, sigma_azimuth: float) -> None:
    scenario = banana_text(
        range_km=2.0, scans=4, sigma_azimuth_mrad=sigma_azimuth, sigma_range=30.0
    )
    text = f"name: p\nruns: 2\nscenario: {scenario}\nfilters: {{U: {{kind: ukf}}}}\ntables: {{}}\n"
    text += "figures: {p: {kind: posterior}}\n"
    figure = PosteriorEllipses().draw(ran(tmp_path, text).results)
    (ax,) = figure.axes
    figure.draw_without_rendering()
    drawn = [line.get_xydata() for line in ax.lines] + [patch.get_xy() for patch in ax.patches]
    every = np.concatenate(drawn)
    for column, limits in enumerate((ax.get_xlim(), ax.get_ylim())):
        assert limits[0] <= every[:, column].min()
        assert every[:, column].max() <= limits[1]
    # The panel is no more than ten times as high as what it shows.
    assert np.ptp(every[:, 1]) > 0.1 * np.ptp(ax.get_ylim())


def test_bars_have_no_row_for_a_bound_and_name_the_metric(results: Results) -> None:
    figure = Bars(metric=measure("mean(rmse_position)")).draw(results)
    rows = [text.get_text() for text in figure.axes[0].get_yticklabels()]
    assert rows == ["KF", "PF"]
    assert figure.axes[0].get_xlabel() == "Position RMSE (m)"


def test_a_filter_without_a_number_keeps_its_row_of_bars(results: Results) -> None:
    figure = Bars(metric=measure("mean(ess)")).draw(results)
    assert "no finite value" in [text.get_text() for text in figure.axes[0].texts]


def test_an_anees_has_a_label_and_a_scale_that_shows_every_filter(results: Results) -> None:
    overconfident = with_values(results, "per_step", "anees", "PF", factor=1e5)
    figure = Anees().draw(overconfident)
    assert figure.axes[0].get_ylabel() == "ANEES"
    assert figure.axes[0].get_yscale() == "log"


def test_a_calibration_has_ticks_and_a_legend(results: Results) -> None:
    figure = CalibrationFigure(columns={"State": measure("pit_nees@last")}).draw(results)
    figure.draw_without_rendering()
    assert labels_of(figure.axes[0].xaxis) == ["0", "0.5", "1"]
    assert legend_of(figure) == ["Share of the truths", "95 % band", "Calibrated filter"]


def test_a_parameter_has_ticks_at_its_values(results: Results) -> None:
    for path, values in ((SIZE, ["6", "7", "9"]), (NOISE, ["10", "250"])):
        figure = RmseVsParameter(parameter=path).draw(results)
        figure.draw_without_rendering()
        assert labels_of(figure.axes[0].xaxis) == values


def test_ticks_of_close_values_leave_room() -> None:
    figure = Figure()
    ax = figure.add_subplot()
    values = np.array([1.0, 1.01, 1.02, 50.0, 100.0])
    ax.plot(values, values)
    tick_labels.set_ticks_at_values(ax, values, [f"{value:g}" for value in values], 3.0)
    figure.draw_without_rendering()
    assert labels_of(ax.xaxis) == ["1", "50", "100"]


@pytest.mark.parametrize("ends", [(0.8, 1.3), (6.1, 9.4), (0.11, 0.19)])
def test_a_narrow_logarithmic_axis_has_three_labels(ends: tuple[float, float]) -> None:
    figure = Figure()
    ax = figure.add_subplot()
    ax.plot([0, 1], ends)
    scales.set_plain_log_scale(ax.yaxis)
    figure.draw_without_rendering()
    labels = labels_of(ax.yaxis)
    assert len(labels) >= 3
    assert not any("10" in label and "^" in label for label in labels)


def test_a_sweep_of_wide_numbers_is_logarithmic_with_equal_axes(results: Results) -> None:
    figure = SweepFigure(paths=(NOISE,)).draw(results)
    shown = [ax for ax in figure.axes if ax.axison]
    assert len(shown) > 1
    assert {ax.get_xscale() for ax in shown} == {"log"}
    assert len({ax.get_xlim() for ax in shown}) == 1
    figure.draw_without_rendering()
    assert labels_of(shown[0].xaxis) == ["10", "250"]


def test_a_sweep_of_two_keys_says_which_value_a_curve_has(results: Results) -> None:
    figure = SweepFigure(paths=(SIZE, NOISE)).draw(results)
    shown = [ax for ax in figure.axes if ax.axison]
    assert [ax.get_title() for ax in shown] == ["sigma = 10 m", "sigma = 250 m"]
    bars = [container for container in shown[0].containers if hasattr(container, "has_yerr")]
    assert len(bars) == 2  # of KF and PF
    assert style.SPREAD in legend_of(figure)


def test_a_sweep_marks_points_without_a_number(results: Results) -> None:
    metric = measure("mean(rmse_position)")
    changed = with_values(results, "summary", str(metric), "PF", factor=np.inf, size=7)
    spec = SweepFigure(paths=(SIZE,), metrics={"Error": metric})
    figure = spec.draw(changed)
    (ax,) = [ax for ax in figure.axes if ax.axison]
    (crosses,) = [line for line in ax.lines if line.get_label() == "_without_number"]
    assert list(crosses.get_xdata()) == [7.0]
    assert "No finite value" in legend_of(figure)
    assert "No finite value: PF at N = 7." in spec.default_caption(changed)


def test_a_heat_map_has_errors(results: Results) -> None:
    spec = HeatMap(metric=measure("mean(rmse_position)"), x=SIZE)
    ax = spec.draw(results).axes[0]
    assert all("\n± " in text.get_text() for text in ax.texts)
    assert [text.get_text() for text in ax.get_yticklabels()] == ["KF", "PF"]


def test_trials_above_the_axis_are_joined_by_no_line() -> None:
    axis = Axis(key="q", low=1.0, high=5.0, log=False)
    objectives = (1.0, 1.1, 1e6, 1.2, 1.3)
    trials = [
        SimpleNamespace(values={"q": float(place)}, objective=objective, lost=0)
        for place, objective in enumerate(objectives, start=1)
    ]
    best = SimpleNamespace(values={"q": 1.0}, objective=1.0, stderr=0.1, lost=0)
    record = SimpleNamespace(
        best=best,
        trials=trials,
        values_within_stderr=lambda axis: [],
        trials_along=lambda axis: trials,
    )
    ax = Figure().add_subplot()
    _draw_panel(ax, record, axis)  # type: ignore[arg-type]
    line = max(ax.lines, key=lambda line: len(line.get_xdata()))
    assert np.isnan(line.get_ydata()).tolist() == [False, False, True, False, False]


def test_a_divergence_hides_no_earlier_error() -> None:
    diverging = np.array([61.0, 80.0, 1e5, 1e18])
    np.testing.assert_array_equal(zeros_on_log_axes.without_rounding(diverging), diverging)
    known_start = np.array([1e-13, 0.1, 0.0, 0.2])
    shown = zeros_on_log_axes.without_rounding(known_start)
    np.testing.assert_array_equal(shown, [np.nan, 0.1, np.nan, 0.2])


def test_one_run_has_no_standard_errors_in_its_legend(tmp_path: Path) -> None:
    text = CONFIG.replace("runs: 8", "runs: 1").partition("grid:")[0]
    one = ran(tmp_path, text + "figures: {t: {kind: rmse-vs-time}}\n").results
    figure = RmseVsTime(metric=measure("rmse_position")).draw(one)
    assert style.SPREAD not in legend_of(figure)
    # Four steps have ticks at whole numbers.
    figure.draw_without_rendering()
    assert all(float(tick).is_integer() for tick in figure.axes[0].get_xticks())


def test_estimates_at_many_points_have_room_in_a_column(results: Results) -> None:
    with drawing_for(COLUMN), style.rc_context():
        figure = EstimatesOfOneRun().draw(results)
    assert len([ax for ax in figure.axes if ax.axison]) == 2 * 6


def test_captions_name_metric_filters_and_runs(results: Results) -> None:
    position = measure("rmse_position")
    assert RmseVsTime(metric=position, x="time").default_caption(results) == (
        "Position RMSE over time of KF, PF and PCRLB, 8 runs, a panel for each value of N and sigma. "
        "Bands are two standard errors on either side. "
        "PCRLB bounds filters whose first errors have the covariance of the start."
    )
    caption = RmseVsParameter(parameter=NOISE).default_caption(results)
    assert caption == "Position RMSE over sigma of KF and PF, 8 runs at each value. At N = 6."
    caption = SweepFigure(paths=(SIZE, NOISE)).default_caption(results)
    assert caption == (
        "Position RMSE over N, a panel for each value of sigma; 8 runs at each value."
    )


def test_a_caption_of_no_filter_says_so() -> None:
    # `--only` may leave out all filters that a figure names.
    assert caption_parts.filters([]) == "no filter"


def test_a_sweep_says_that_it_leaves_out_the_figures_of_the_config(tmp_path: Path) -> None:
    path = tmp_path / "defaults.yaml"
    path.write_text(CONFIG.replace("grid:", "# grid:"))
    grid = ("--grid", f"{SIZE}=5,6", "--grid", f"{NOISE}=2,5", "--grid", "scenario.last=3,4")
    options = ("--runs", "3", "--engine", "serial", "--format", "svg", "--out", tmp_path / "o")
    done = trackbench("sweep", path, *grid, *options)
    assert done.returncode == 0, done.stderr
    assert "note: a sweep draws figures over its keys, not the config's (e, c, s)" in done.stderr
    # Of three keys the figure shows two.
    assert [file.name for file in (tmp_path / "o" / "figures").iterdir()] == [
        "sweep-PF-N-sensor-sigma.svg"
    ]
