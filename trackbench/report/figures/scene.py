"""Picture of a scenario before it is run: path, speed, sensors and one run's measurements."""

import numpy as np

from trackbench.config.experiment import Experiment
from trackbench.core.arrays import Array
from trackbench.evaluation.block import simulate
from trackbench.models.base import position_velocity_names
from trackbench.report.figures.track import draw_sensor, draw_truth, plane_unit
from trackbench.report.plotting import style
from trackbench.report.plotting.artist_types import Axes, Figure
from trackbench.results.tracks import measured_positions, sensor_paths
from trackbench.scenarios.base import Scenario

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
        style.title(figure, experiment.settings.name)
        style.legend_outside(figure)
        return style.lay_out(figure)


def _in_the_plane(scenario: Scenario, truth: Array, z: Array) -> Figure:
    figure, (plane, speed) = style.subplots(1, 2, 4.0, width_ratios=(2, 1))
    paths, times = truth[[0, 2]], scenario.times
    seen = measured_positions(scenario, z[..., :1])
    sites = sensor_paths(scenario)
    metres, unit = plane_unit(paths.reshape(2, -1), *(site for _, site in sites))
    # Step 1: paths of all runs, measurements of the first.
    same = bool(np.all((paths == paths[..., :1]) | np.isnan(paths)))
    if not same:
        plane.plot(*(paths / metres), color="#bbbbbb", linewidth=0.5, zorder=0)
        plane.plot([], [], color="#bbbbbb", label=f"Truth of {paths.shape[-1]} runs")
    if seen is not None:
        dots = {"color": "#5599cc", "markersize": 2.5, "label": "Measurements, first run"}
        plane.plot(*(seen[:2, :, 0] / metres), ".", zorder=0.2, **dots)
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
    seen = [(n, scenario.times[1:], x) for n, x in zip(sensor.components, z, strict=True)]
    rows = rows[:_MOST_ROWS]
    figure, axes = style.subplots(
        len(rows) + min(len(seen), _MOST_ROWS), 1, 1.1 * (len(rows) + len(seen)), sharex=True
    )
    panels: list[Axes] = list(np.atleast_1d(axes))
    for ax, (name, times, x) in zip(panels, rows, strict=False):
        ax.plot(times, x, color="#bbbbbb", linewidth=0.5, label="_")
        ax.plot(times, x[:, 0], color="black", linewidth=1.2, label="Truth, first run")
        ax.set_ylabel(name)
    for ax, (name, times, x) in zip(panels[len(rows) :], seen, strict=False):
        ax.plot(times, x[:, 0], ".", color="#5599cc", markersize=3, label="Measurements, first run")
        ax.set_ylabel(f"{name} (meas.)")
    panels[-1].set_xlabel("Time (s)")
    return figure
