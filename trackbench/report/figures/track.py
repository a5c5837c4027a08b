"""Figure kinds of a target in the plane: `track` and `mean-and-std`; the scene of `check --picture`."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from trackbench.config.experiment import Experiment, Point
from trackbench.core.arrays import Array
from trackbench.evaluation.block import simulate
from trackbench.field_types import Count, Natural
from trackbench.models.base import position_velocity_names
from trackbench.registry import register
from trackbench.report.findings.phrases import listed, named
from trackbench.report.findings.ranking import rankings
from trackbench.report.kinds import FigureKind
from trackbench.report.plotting import filter_lines, style
from trackbench.report.plotting.page_formats import sheet
from trackbench.report.plotting.style import Axes, Figure
from trackbench.report.results import Results
from trackbench.results.tracks import measured_positions, sensor_paths
from trackbench.scenarios.base import Scenario

_AXES = ("x", "y")
_LONG_M = 2000.0
_FAR = 4.0  # times as long as the tracks: a picture with a sensor so far away shows no track


@register("figures", "track")
@dataclass(frozen=True, kw_only=True)
class Track(FigureKind):
    """The true track in the plane, its sensors and, one panel per filter, estimates of the first runs.

    Unless it names filters, one panel shows the first run's estimates of the best ones.
    """

    filters: tuple[str, ...] = ()
    """labels, a panel each; none draws the best over each other"""
    best: Natural = 3
    """number of the best filters, if no filters are named; 0 draws the truth alone"""
    runs: Count = 50
    """number of runs drawn over each other"""
    components: tuple[int, int] = (0, 2)
    """numbers of the state's two positions, from 0"""
    measurements: bool = True
    """sensors, and the first run's measurements as dots where a sensor tells positions"""

    def conflicts(self, points: Sequence[Point]) -> dict[str, str]:
        """Reject components that are not positions of the state."""
        last = min(len(p.scenario.components) for p in points) - 1
        names = points[0].scenario.components
        if len(names) > 1 and names[:2] != ("px", "vx"):
            return {"": f"shows positions, and the state is {', '.join(names)}: take `estimates`"}
        if not (self.filters or self.best) and not all(p.scenario.has_truth for p in points):
            return {"filters": "there is no truth to draw: name the filters whose tracks to draw"}
        if all(0 <= c <= last for c in self.components):
            return {}
        return {"components": f"{list(self.components)}: the state has components 0 to {last}"}

    @property
    def shown_runs(self) -> int:
        """Runs whose tracks must be kept."""
        return self.runs if self.filters else 1  # of the best, the first run's

    @property
    def shown_components(self) -> tuple[int, ...]:
        """Components that are drawn of those tracks, as lines."""
        return self.components

    @property
    def shown_measurements(self) -> bool:
        """True if the figure needs the measured positions of the first run."""
        return self.measurements

    def default_caption(self, results: Results) -> str:
        """Return whose estimates one panel shows, and of how many runs."""
        if len(self.filters) > 1:
            return ""
        runs = min(self.shown_runs, results.config["runs"])
        of = "the first run" if runs == 1 else f"the first {runs} runs"
        labels = [*map(named, self.filters or self._best(results))]
        whose = f", with the estimates of {listed(labels)}" if labels else ""
        return f"The target in the plane in {of}{whose}."

    def draw(self, results: Results) -> Figure:
        """Return a panel per filter, equal scales."""
        panels = max(len(self.filters), 1)
        # of the first point where not every filter failed
        point = next(filter(results.tracks, results.grid_points))
        turning, tracks = results.facts(point).spans, results.tracks(point)
        truth = tracks["truth"][list(self.components), :, 0]
        in_plane = self.measurements and self.components == (0, 2)
        measured = tracks["seen"][:2, :, 0] if in_plane and "seen" in tracks else np.empty((2, 0))
        estimates = {b: tracks[f"mean/{b}"][list(self.components), :, : self.runs]
                     for b in self.filters or self._best(results) if f"mean/{b}" in tracks}  # fmt: skip
        first = truth, measured, *(mean[..., 0] for mean in estimates.values())
        paths = {n.partition("/")[2]: x for n, x in tracks.items() if n.startswith("sensor/")}
        sensors = {n: x for n, x in paths.items() if in_plane and _is_near(x, first)}
        first += tuple(sensors.values())
        metres, unit = plane_unit(*first)
        width, height = _size(panels, *(xy / metres for xy in first))
        shared = {"sharex": True, "sharey": True}
        figure, axes = style.subplots(1, panels, height, width, squeeze=False, **shared)
        for i, ax in enumerate(axes[0]):
            label = self.filters[i] if self.filters else ""
            if measured.size:
                ax.plot(*(measured / metres), ".", color="#bbbbbb", markersize=2.0,
                        label="Measurements, first run", rasterized=True, zorder=0)  # fmt: skip
            if label in estimates:
                self._estimates(ax, estimates[label] / metres, results.line_style(label)["color"])
            for rank, (name, mean) in enumerate(estimates.items() if not self.filters else ()):
                look = results.line_style(name)
                # The best lies on top. A solid line that would hide an equal one lies below.
                equal = [np.allclose(mean, x, equal_nan=True) for x in estimates.values()]
                level = len(equal) if sum(equal) > 1 and look["linestyle"] == "-" else rank
                ax.plot(*(mean[..., 0] / metres), label=name, **look, zorder=1.9 - 0.1 * level)
            draw_truth(ax, truth / metres, tracks["times"], turning, thin=bool(estimates))
            for number, path in sensors.items():
                draw_sensor(ax, path / metres, f"Sensor {number}" if len(paths) > 1 else "Sensor")
            ax.set_aspect("equal")
            ax.set_xlabel(f"x ({unit})")
            ax.locator_params(nbins=5)
            ax.set_title(style.wrap_label(label))
        axes[0][0].set_ylabel(f"y ({unit})")
        return style.add_title_and_legend(figure, self.title)

    def _best(self, results: Results) -> list[str]:
        """Choose the best filters of the first ranking, else the first ones."""
        every = rankings(results)
        ranked = [c.label for c in every[0].order] if every else []
        return (ranked or results.filters)[: self.best]

    def _estimates(self, ax: Axes, xy: Array, color: str) -> None:
        x, y = xy
        shown = x.shape[1]
        name = f"Estimates, {shown} runs" if shown > 1 else "Estimate"
        opacity = min(1.0, max(0.15, 2.0 / shown))
        ax.plot(x, y, color=color, linewidth=0.6, alpha=opacity, rasterized=True)
        alone = len(self.filters) == 1
        ax.plot([], [], color=color if alone else style.ANY, linewidth=1.0, label=name)


def plane_unit(*tracks: Array) -> tuple[float, str]:
    """Return metres per unit of the axes and its name: km for tracks (2, T) of 2 km or more."""
    points = np.concatenate(tracks, axis=1)
    points = points[:, np.isfinite(points).all(axis=0)]
    long = points.size and np.ptp(points, axis=1).max() >= _LONG_M
    return (1000.0, "km") if long else (1.0, "m")


def _is_near(path: Array, tracks: Iterable[Array]) -> bool:
    """Test whether a sensor's path (2, T) leaves the tracks (2, T) a quarter of the picture."""
    points = np.concatenate([*tracks], axis=1)
    points = points[:, np.isfinite(points).all(axis=0)]
    if not points.size:
        return False
    both = np.concatenate([points, path], axis=1)
    return bool(np.ptp(both, axis=1).max() <= _FAR * np.ptp(points, axis=1).max())


def draw_sensor(ax: Axes, path: Array, name: str) -> None:
    """Draw a sensor where it begins, and its path (2, T)."""
    ax.plot(*path, color=style.COLORS[1], linewidth=1.0)
    ax.plot(*path[:, :1], "^", color=style.COLORS[1], markersize=8, label=name)


def _size(panels: int, *tracks: Array) -> tuple[float, float]:
    """Size a figure, in, whose panels fit these tracks (2, T): width and height."""
    points = np.concatenate(tracks, axis=1)
    points = points[:, np.isfinite(points).all(axis=0)]
    wide, high = np.ptp(points, axis=1) if points.size else (1.0, 1.0)
    room = sheet().width_in / panels - 0.8  # beside the ticks
    shape = float(np.clip(high / max(wide, 1e-9), 0.15, 10.0))
    panel = min(room, 4.0 / shape)
    return max(panels * (panel + 0.8), 3.4), panel * shape + 1.3


def draw_truth(
    ax: Axes, xy: Array, times: Array, turning: Iterable[Sequence[float]], thin: bool
) -> None:
    """Draw the true path (2, T), its start, and the spans in which it turns."""
    width = 0.7 if thin else 1.4
    known = np.isfinite(xy).all(axis=0)
    if not known.any():
        return
    points = {} if known.all() else {"marker": ".", "markersize": 2.0}  # one alone makes no line
    ax.plot(*xy, label="Truth", **style.TRUTH | {"linewidth": width} | points)
    for start, end in turning:
        during = (times >= start) & (times <= end)
        ax.plot(*xy[:, during], label="Maneuvers", color=style.MANEUVER, linewidth=6, zorder=0.5)
    ax.plot(*xy[:, known][:, 0], "o", color="black", markersize=4, label="Start")


@register("figures", "mean-and-std")
@dataclass(frozen=True, kw_only=True)
class MeanAndStd(FigureKind):
    """Mean error and standard deviation over the runs, per axis and step; maneuvers are shaded.

    Adaptive Kalman filter paper, eqs. 13 and 14: truth minus estimate, the opposite sign of `bias` in
    per_step.csv. The quantities are those the scenario calls x and y.
    """

    requires: ClassVar[dict[str, str]] = dict.fromkeys(
        ("bias_x", "bias_y", "std_x", "std_y"), "per_step"
    )

    filters: tuple[str, ...] | None = None
    """labels to draw; default: all"""

    def conflicts(self, points: Sequence[Point]) -> dict[str, str]:
        """Reject a scenario without errors of a position in x and y."""
        scenario = points[0].scenario
        nowhere = np.zeros((len(scenario.components), 1))
        moving = scenario.components[:2] == ("px", "vx")
        if moving and set(_AXES) <= set(scenario.errors(nowhere, nowhere)):
            return {}
        return {"": "there are no errors in x and y to show"}

    def draw(self, results: Results) -> Figure:
        """Return the mean error above, standard deviation below; x left, y right."""
        figure, axes = style.subplots(2, 2, 4.4, sharex=True, sharey="row")
        point = results.points()[0]
        frame = results.columns("per_step", point)
        labels = results.chosen(self.filters, exact=True)
        rows = (("bias", -1.0, "Mean error of {} (m)"), ("std", 1.0, "Std. deviation of {} (m)"))
        for (metric, sign, words), row in zip(rows, axes, strict=True):
            for quantity, ax in zip(_AXES, row, strict=True):
                for start, end in results.facts(point).spans:
                    ax.axvspan(start, end, color=style.MANEUVER, alpha=0.5, lw=0, zorder=0,
                               label="Maneuvers")  # fmt: skip
                chosen = frame.where(metric=f"{metric}_{quantity}")
                for label in labels:
                    curve, look = chosen.where(filter=label), results.line_style(label)
                    look = look | {"linewidth": 0.8, "label": label}
                    filter_lines.draw_filter_line(ax, curve["time"], sign * curve["value"], look)
                ax.set_ylabel(words.format(quantity))
        for ax in axes[1]:
            ax.set_xlabel("Time (s)")
            ax.set_ylim(bottom=0)
        return style.add_title_and_legend(figure, self.title)


_RUNS = 20  # whose paths are drawn
_MARKS = 8  # times along the path
_MOST_ROWS = 6  # components, of states and of measurements, in a picture over time


def draw_scene(experiment: Experiment) -> Figure:
    """Return the scenario's picture at the first grid point: in the plane, else over time."""
    scenario = experiment.points[0].scenario
    runs = min(_RUNS, experiment.settings.runs)
    data = simulate(scenario, experiment.settings.seed, 0, runs)
    with style.rc_context():
        if scenario.components[:4] == position_velocity_names(2):
            figure = _in_the_plane(scenario, data.truth, data.measurements)
        else:
            figure = _over_time(scenario, data.truth, data.measurements)
        return style.lay_out(style.add_title_and_legend(figure, experiment.settings.name))


def _in_the_plane(scenario: Scenario, truth: Array, z: Array) -> Figure:
    figure, (plane, speed) = style.subplots(1, 2, 4.0, width_ratios=(2, 1))
    paths, times = truth[[0, 2]], scenario.times
    measured = measured_positions(scenario, z[..., :1])
    sites = sensor_paths(scenario)
    metres, unit = plane_unit(paths.reshape(2, -1), *(site for _, site in sites))
    # Step 1: paths of all runs, measurements of the first.
    same = bool(np.all((paths == paths[..., :1]) | np.isnan(paths)))
    if not same:
        plane.plot(*(paths / metres), color="#bbbbbb", linewidth=0.5, zorder=0)
        plane.plot([], [], color="#bbbbbb", label=f"Truth of {paths.shape[-1]} runs")
    if measured is not None:
        dots = {"color": "#5599cc", "markersize": 2.5, "label": "Measurements, first run"}
        plane.plot(*(measured[:2, :, 0] / metres), ".", zorder=0.2, **dots)
    draw_truth(plane, paths[..., 0] / metres, times, scenario.spans, thin=False)
    # Step 2: times along the path.
    for i in np.linspace(0, len(times) - 1, _MARKS).astype(int):
        x, y = paths[:, i, 0] / metres
        plane.plot(x, y, ".", color="black", markersize=5)
        plane.annotate(f"{times[i]:g} s", (x, y), (4, 4), textcoords="offset points", fontsize=7)
    # Step 3: sensors, and the way of those that move.
    for number, site in sites:
        draw_sensor(plane, site / metres, f"Sensor {number}" if len(sites) > 1 else "Sensor")
    plane.set_aspect("equal", adjustable="datalim")
    plane.set_xlabel(f"x ({unit})")
    plane.set_ylabel(f"y ({unit})")
    # Step 4: speed over time.
    for start, end in scenario.spans:
        speed.axvspan(start, end, color=style.MANEUVER, lw=0, zorder=0)
    speed.plot(times, np.hypot(truth[1], truth[3])[:, 0], color="black")
    speed.set_ylim(bottom=0)
    speed.set_xlabel("Time (s)")
    speed.set_ylabel("Speed (m/s)")
    return figure


def _over_time(scenario: Scenario, truth: Array, z: Array) -> Figure:
    rows = [(name, scenario.times, x) for name, x in zip(scenario.components, truth, strict=False)]
    sensor = scenario.true_sensor
    measured = [(n, scenario.times[1:], x) for n, x in zip(sensor.components, z, strict=True)]
    rows = rows[:_MOST_ROWS]
    number, height = len(rows) + min(len(measured), _MOST_ROWS), 1.1 * (len(rows) + len(measured))
    figure, axes = style.subplots(number, 1, height, sharex=True)
    panels: list[Axes] = list(np.atleast_1d(axes))
    for ax, (name, times, x) in zip(panels, rows, strict=False):
        ax.plot(times, x, color="#bbbbbb", linewidth=0.5, label="_")
        ax.plot(times, x[:, 0], color="black", linewidth=1.2, label="Truth, first run")
        ax.set_ylabel(name)
    for ax, (name, times, x) in zip(panels[len(rows) :], measured, strict=False):
        ax.plot(times, x[:, 0], ".", color="#5599cc", markersize=3, label="Measurements, first run")
        ax.set_ylabel(f"{name} (meas.)")
    panels[-1].set_xlabel("Time (s)")
    return figure
