"""Logarithmic axes and colors show what has a logarithm, and are linear for the rest."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from matplotlib.figure import Figure

from tests.commands import ran, trackbench
from tests.conftest import PLANE
from trackbench.evaluation.metric_expression import measure
from trackbench.report.figure_drawing import draw_figure
from trackbench.report.figures.autocorrelation import Autocorrelation
from trackbench.report.figures.bars import Bars
from trackbench.report.figures.estimates_of_one_run import EstimatesOfOneRun
from trackbench.report.figures.heat_map import HeatMap
from trackbench.report.figures.lines_over_parameter import is_level as _is_level
from trackbench.report.figures.nis import Nis
from trackbench.report.figures.rmse_per_run import RmsePerRun
from trackbench.report.figures.rmse_vs_parameter import RmseVsParameter
from trackbench.report.figures.rmse_vs_time import RmseVsTime
from trackbench.report.kinds import FigureKind
from trackbench.report.plotting import (
    cut_off_lines,
    file_formats,
    scales,
    style,
    tick_labels,
    zeros_on_log_axes,
)
from trackbench.report.rounded_numbers import rounded
from trackbench.report.tables_and_figures import Results

KEYS: dict[str, Any] = {
    "name": "c",
    "runs": 4,
    **yaml.safe_load(PLANE),
    "filters": {"KF": {"kind": "kf"}, "PF": {"kind": "pf", "N": 20}},
    "tables": {"t": {"kind": "metrics", "columns": {"Score": "mean(log_score)"}}},
    "figures": {
        "f": {"kind": "estimates"},
        "b": {"kind": "bias", "rows": {"x": "bias_x"}},
        "a": {"kind": "autocorrelation"},
    },
}
SPEED = "scenario.target.launch.vx"


def results_of(folder: Path, **keys: Any) -> Results:
    return ran(folder, yaml.safe_dump(KEYS | keys)).results


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Results:
    return results_of(tmp_path_factory.mktemp("plain"))


@pytest.fixture(scope="module")
def signed(tmp_path_factory: pytest.TempPathFactory) -> Results:
    return results_of(tmp_path_factory.mktemp("signed"), grid={SPEED: [-20, -10, 10, 20]})


def test_what_has_a_logarithm() -> None:
    assert scales.has_logarithm(np.array([0.0, 1.0, np.nan]))
    for values in ([], [0.0], [np.nan], [-1.0, 2.0], [np.inf]):
        assert not scales.has_logarithm(np.array(values))


def test_a_parameter_below_zero_has_a_linear_axis(signed: Results) -> None:
    figure = RmseVsParameter(metric=measure("mean(rmse_position)")).draw(signed)
    (ax,) = figure.axes
    assert (ax.get_xscale(), ax.get_yscale()) == ("linear", "log")
    low, high = ax.get_xlim()
    assert low <= -20 < 20 <= high
    assert draw_figure(RmseVsParameter(metric=measure("mean(log_score)")), signed, ["svg"])
    file_formats.close(figure)


def test_colors_of_negative_numbers_are_linear(signed: Results) -> None:
    figure = HeatMap(metric=measure("mean(log_score)"), log=True).draw(signed)
    values = signed.summary.query("metric == 'mean(log_score)'")["value"]
    image = figure.axes[0].images[0]
    assert (image.norm.vmin, image.norm.vmax) == pytest.approx((values.min(), values.max()))
    assert image.norm(values.mean()) == pytest.approx(
        (values.mean() - values.min()) / np.ptp(values), abs=1e-4
    )
    file_formats.close(figure)
    assert draw_figure(HeatMap(metric=measure("mean(log_score)"), log=True), signed, ["svg"])


def test_equal_numbers_have_a_logarithmic_color(tmp_path: Path) -> None:
    filters = {"KF": {"kind": "kf"}, "U": {"kind": "ukf"}}
    grid = {"filters.U.kappa": [1, 2]}
    results = results_of(tmp_path, filters=filters, grid=grid)
    spec = HeatMap(filters=("KF",), metric=measure("mean(rmse_position)"), log=True)
    ((_, content),) = draw_figure(spec, results, ["svg"])
    value = results.summary.query("metric == 'mean(rmse_position)' and filter == 'KF'")["value"]
    assert f"{value.iloc[0]:.3g}".encode() in content


@pytest.mark.parametrize(
    "spec",
    [
        Bars(metric=measure("mean(log_score)"), log=True),
        RmseVsTime(metric=measure("bias_x"), log=True),
        RmseVsTime(metric=measure("bias_x"), log=True, y_label="Bias (m)"),
        RmsePerRun(metric=measure("log_score"), log=True),
        RmsePerRun(metric=measure("log_score"), log=True, y_label="Log score"),
        EstimatesOfOneRun(log=True, component=4),
        EstimatesOfOneRun(log=True, component=4, y_label="x (m)"),
        Autocorrelation(log=True),
    ],
    ids=lambda spec: f"{spec.kind}, {getattr(spec, 'y_label', '')}",
)
def test_curves_below_zero_have_linear_axes(plain: Results, spec: FigureKind) -> None:
    with style.rc_context():
        figure = spec.draw(plain)
    ax = figure.axes[-1]  # the errors, of estimates
    name = "x" if isinstance(spec, Bars) else "y"
    values = scales.drawn_values(ax.xaxis if name == "x" else ax.yaxis)
    assert (values < 0.0).any()
    assert (ax.get_xscale() if name == "x" else ax.get_yscale()) == "linear"
    low, high = ax.get_xlim() if name == "x" else ax.get_ylim()
    assert low <= values.min() < values.max() <= high
    file_formats.close(figure)


def test_a_linear_axis_shows_what_is_negative(plain: Results) -> None:
    figure = RmseVsTime(metric=measure("bias_x")).draw(plain)
    values = scales.drawn_values(figure.axes[0].yaxis)
    assert figure.axes[0].get_ylim()[0] < values.min() < 0.0
    file_formats.close(figure)


def test_linked_paths_with_equal_numbers_are_one_parameter(tmp_path: Path) -> None:
    filters = {"A": {"kind": "pf", "N": 10}, "B": {"kind": "rpf", "N": 10}}
    grid = {"filters.A.N & filters.B.N": [[10, 10], [30, 30], [90, 90]]}
    figures = {"n": {"kind": "rmse-vs-parameter", "metric": "rms(rmse_position)"}}
    results = results_of(tmp_path, filters=filters, grid=grid, figures=figures)
    figure = results.parts("figures")["n"].draw(results)
    rows = results.summary.query("metric == 'rms(rmse_position)'")
    for label in filters:
        (line,) = (x for x in figure.axes[0].lines if x.get_label() == label)
        assert line.get_xdata().tolist() == [10, 30, 90]
        np.testing.assert_array_equal(line.get_ydata(), rows[rows["filter"] == label]["value"])
    assert "B " in results.parts("figures")["n"].default_caption(results)
    file_formats.close(figure)
    grid["filters.A.N & filters.B.N"][1] = [30, 31]
    keys = {"filters": filters, "grid": grid, "figures": figures}
    (tmp_path / "d.yaml").write_text(yaml.safe_dump(KEYS | keys))
    assert "[30, 31] in the grid" in trackbench("check", tmp_path / "d.yaml").stderr


def test_a_filter_that_ignores_the_parameter_has_no_best_value() -> None:
    values = np.array([52.93, 52.95, 52.92])
    assert _is_level(values, np.full(3, 1.95))
    assert not _is_level(values, np.full(3, 0.1))
    assert not _is_level(np.array([1.0, 2.0, np.nan]), np.full(3, 0.5))
    assert _is_level(np.full(3, np.nan), np.full(3, np.nan))


def test_a_filter_that_lost_all_runs_has_no_line_in_the_legend(tmp_path: Path) -> None:
    blind = {"kind": "kf", "assume": {"sensor": {"kind": "position", "sigma": 5e5}}}
    scenario = KEYS["scenario"] | {"last": 20, "score": {"lost_beyond": 15}}
    filters = {"KF": {"kind": "kf"}, "Blind": blind}
    results = results_of(tmp_path, filters=filters, scenario=scenario, figures={}, tables={})
    assert results.summary.query("filter == 'Blind'")["lost"].min() == KEYS["runs"]
    metric = measure("rmse_position")
    for spec in (RmseVsTime(metric=metric), RmsePerRun(metric=metric)):
        figure = spec.draw(results)
        labels = {text.get_text() for text in figure.legends[0].get_texts()}
        assert "KF" in labels
        assert "Blind" not in labels
        file_formats.close(figure)


def test_a_label_of_the_user_stays(tmp_path: Path) -> None:
    filters = {f"F{i}": {"kind": "kf"} for i in range(6)}
    results = results_of(tmp_path, filters=filters, scenario=KEYS["scenario"] | {"last": 160})
    figure = EstimatesOfOneRun(y_label="Easting (m)").draw(results)
    assert "Easting (m)" in figure.get_supylabel().split("\n")
    file_formats.close(figure)


def test_tuning_is_shown_where_filters_are_tuned(tmp_path: Path) -> None:
    for group, keys in (("tables", {}), ("figures", {"filter": "KF"})):
        (tmp_path / "c.yaml").write_text(
            yaml.safe_dump(KEYS | {group: {"t": {"kind": "tuning"} | keys}})
        )
        done = trackbench("check", tmp_path / "c.yaml")
        assert done.returncode == 2
        assert "name its keys under `tune`" in done.stderr


def test_as_many_digits_as_asked() -> None:
    assert rounded(0.12345678912, np.nan, 8) == "0.12345679"
    assert rounded(1.2345678912e-9, np.nan, 8) == "1.2345679e-09"
    assert rounded(12345678.912, 0.0, 10).startswith("1.234567891e+07")
    assert rounded(1.2345e-9, np.nan, 4) == "1.23e-09"


def test_a_diverged_line_is_cut_off_and_marked_where_it_leaves() -> None:
    """Three filters over a truth; the errors of one are 25 times those of the next."""
    k, figure = np.arange(5.0), Figure()
    axes, below = figure.subplots(2)
    errors = {"A": np.array([1, -1, 1, 1, -1.0]), "B": np.array([2, 2, -2, 2, 2.0])}
    errors["C"] = np.array([1, 1, 40, -50, np.nan])
    for label, error in errors.items():
        axes.plot(k, 5.0 + error, label=label)
        below.plot(k, error, label=label)
    cut_off_lines.cut_dwarfing_lines([axes, below], errors, extent=100.0)
    assert axes.get_ylim() == pytest.approx((3 - 0.2, 7 + 0.2))
    mark, in_legend = below.lines[-2:]
    assert in_legend.get_label() == "Leaves the axis"
    assert (mark.get_marker(), mark.get_xdata().tolist()) == ("^", [2.0])
    assert 2.0 < mark.get_ydata()[0] < below.get_ylim()[1]
    # Of two filters neither is cut: which one is right is not known.
    two_errors = {"A": errors["A"], "C": errors["C"]}
    cut_off_lines.cut_dwarfing_lines([axes], two_errors, extent=100.0)
    assert len(axes.lines) == 5


def test_a_line_that_stays_on_the_axis_has_no_mark_and_no_entry_in_the_legend() -> None:
    """Its errors are far too large, but its estimates are among those of the others."""
    ax, k = Figure().add_subplot(), np.arange(3.0)
    errors = {"A": np.full(3, 1.0), "B": np.full(3, -1.0), "C": np.full(3, 90.0)}
    for label, value in (("A", [0.0, 5.0, 9.0]), ("B", [1.0, 4.0, 8.0]), ("C", [2.0, 3.0, 4.0])):
        ax.plot(k, value, label=label)
    cut_off_lines.cut_dwarfing_lines([ax], errors, extent=10.0)
    assert ax.get_legend_handles_labels()[1] == ["A", "B", "C"]


@pytest.mark.parametrize(("extent", "is_cut"), [(20.0, True), (200.0, False)])
def test_a_line_with_one_spike_beyond_the_truth_is_cut_off(extent: float, is_cut: bool) -> None:
    """Of two filters one has an error of 100 at one step, and both have errors of 1 elsewhere."""
    ax = Figure().add_subplot()
    small = np.resize([1.0, -1.0], 50)
    errors = {"A": small, "B": np.where(np.arange(50) == 30, 100.0, small)}
    for label, error in errors.items():
        ax.plot(np.arange(50.0), error, label=label)
    cut_off_lines.cut_dwarfing_lines([ax], errors, extent)
    assert (ax.get_ylim()[1] < 2.0) == is_cut
    # A filter alone is never cut.
    cut_off_lines.cut_dwarfing_lines([ax], {"B": errors["B"]}, extent=0.0)
    assert (len(ax.lines) > 2) == is_cut


@pytest.mark.parametrize("decades", [3, 14])
def test_a_logarithmic_axis_of_any_span_has_labels(decades: int) -> None:
    figure = Figure()
    ax = figure.add_subplot()
    ax.plot([1.0, 2.0], [10.0**-decades, 5.0])
    scales.set_plain_log_scale(ax.yaxis, largest_ratio=np.inf)
    figure.draw_without_rendering()
    low, high = ax.get_ylim()
    inside = [tick for tick in ax.yaxis.get_major_ticks() if low <= tick.get_loc() <= high]
    assert sum(bool(tick.label1.get_text()) for tick in inside) >= 3


def test_the_band_of_a_signed_metric_is_whole_where_log_is_wanted(signed: Results) -> None:
    spec = RmseVsTime(metric=measure("bias_x"), log=True)
    bands = []
    for log in (True, False):
        with style.rc_context():
            ax = RmseVsTime(metric=spec.metric, log=log).draw(signed).axes[0]
        assert ax.get_yscale() == "linear"
        bands.append(ax.collections[0].get_paths()[0].vertices)
    np.testing.assert_array_equal(*bands)


@pytest.mark.parametrize("limits", [(-9500.0, 9500.0), (-16000.0, 400.0), (-0.0012, 0.0011)])
def test_a_narrow_axis_has_two_labels_without_a_factor(limits: tuple[float, float]) -> None:
    """A common factor such as 1e-3 would stand on the axis' label."""
    with style.rc_context():
        figure, ax = style.subplots(height_in=1.0)
        ax.set_xlim(limits)
        tick_labels.set_few_ticks(ax)
        figure.draw_without_rendering()
        texts = [tick.get_text() for tick in ax.get_xticklabels()]
        assert texts[-1] == "0" or texts[0] == "0"
        assert len(texts) == 2
        assert ax.xaxis.get_offset_text().get_text() == ""
        assert ax.get_xlim() == limits


def test_a_narrow_axis_has_a_label_at_the_expected_value() -> None:
    with style.rc_context():
        _, ax = style.subplots(height_in=1.0)
        ax.set_xlim(0.9, 5.6)
        tick_labels.set_few_ticks(ax, expected=1.0)
        assert [tick.get_text() for tick in ax.get_xticklabels()] == ["1", "5"]


def test_the_nis_of_a_short_record_has_ten_points(tmp_path: Path) -> None:
    """60 measured components a point would be one point, of the record's first half."""
    results = results_of(tmp_path, runs=1)
    figure = Nis().draw(results)
    (ax,) = figure.axes
    lines = [line for line in ax.lines if line.get_label() == "KF"]
    steps = len(results.per_step.query("filter == 'KF' and metric == 'anis'"))
    assert len(lines[0].get_xdata()) >= min(10, steps)
    file_formats.close(figure)


def test_the_caption_of_a_panel_for_each_filter_names_the_bands(tmp_path: Path) -> None:
    filters = {f"KF {number}": {"kind": "kf"} for number in range(6)}
    scenario = KEYS["scenario"] | {"last": 160}
    results = results_of(tmp_path, runs=2, filters=filters, scenario=scenario, figures={})
    spec = RmseVsTime(metric=measure("rmse_position"))
    assert "Bands are two standard errors" in spec.default_caption(results)


def test_zero_on_a_logarithmic_axis_stands_behind_a_break() -> None:
    values = np.array([0.0, 1e-4, 1e-3, 1e-2])
    ax = Figure().add_subplot()
    ax.plot(zeros_on_log_axes.places_with_zero(values), values)
    zeros_on_log_axes.set_log_scale_with_zero(ax, values)
    (mark,) = ax.texts
    assert mark.get_text() == "//"
    assert zeros_on_log_axes.places_with_zero(values)[0] < mark.get_position()[0] < values[1]
    # An axis without zero has no break.
    ax = Figure().add_subplot()
    zeros_on_log_axes.set_log_scale_with_zero(ax, values[1:])
    assert not ax.texts


@pytest.mark.parametrize(
    ("values", "texts"),
    [
        ([0.0, 1e-6, 1e-4, 0.1], ["0", "10⁻⁶", "10⁻⁴", "10⁻¹"]),
        ([0.1, 1.0, 10.0], ["0.1", "1", "10"]),
        ([-0.5, 0.0, 2.0], ["−0.5", "0", "2"]),
        ([1e-6, 3e-6, 1.0], ["1e−06", "3e−06", "1"]),
    ],
)
def test_labels_of_values(values: list[float], texts: list[str]) -> None:
    assert tick_labels.value_texts(values) == texts
