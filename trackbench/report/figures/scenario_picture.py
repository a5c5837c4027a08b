"""Picture of a scenario, as `check --picture` draws it: paths, sensors and measurements."""

import numpy as np

from trackbench.config.experiment import Experiment
from trackbench.core.arrays import Array
from trackbench.durations import time_text
from trackbench.evaluation.simulated_runs import simulate
from trackbench.models.component_names import position_velocity_names
from trackbench.report.figures.track import draw_sensor, draw_truth, plane_unit
from trackbench.report.plotting import file_formats, style, time_axis
from trackbench.report.plotting.panels import add_title_and_legend
from trackbench.report.plotting.style import Axes, Figure, LineStyle
from trackbench.results.drawn_sensors_and_measurements import measured_positions, sensor_paths
from trackbench.scenarios.base import Scenario

_RUNS = 20
"""Runs whose paths are drawn."""
_MARKS = 8
"""Times that are marked along the path."""
_MOST_ROWS = 6
"""Components, of states and of measurements each, in a picture over time."""


def draw_scene(experiment: Experiment) -> Figure:
    """Return the scenario's picture at the first grid point, from runs that it simulates.

    It is in the plane if the state has a position and velocity in x and y, else over time.

    Parameters
    ----------
    experiment
        experiment that is not run yet

    Returns
    -------
    matplotlib.figure.Figure
        figure with its layout done
    """
    scenario = experiment.points[0].scenario
    runs = min(_RUNS, experiment.settings.runs)
    data = simulate(scenario, experiment.settings.seed, 0, runs)
    with style.rc_context():
        if scenario.components[:4] == position_velocity_names(2):
            figure = _draw_scene_in_plane(scenario, data.truth, data.measurements)
        else:
            figure = _draw_scene_over_time(scenario, data.truth, data.measurements)
        add_title_and_legend(figure, experiment.settings.name)
        return file_formats.lay_out(figure)


def _draw_scene_in_plane(scenario: Scenario, truth: Array, measurements: Array) -> Figure:
    """Draw paths and measurements in the plane, and the speed over time, from simulated runs.

    ``truth`` (n_x, T + 1, runs) and ``measurements`` (n_z, T, runs).
    """
    figure, (plane, speed) = style.subplots(1, 2, 4.0, width_ratios=(2, 1))  # 4 inches high
    # The state begins with px, vx, py, vy.
    paths = truth[[0, 2]]
    times = scenario.times
    sensors = sensor_paths(scenario)
    meters_per_unit, unit = plane_unit(paths.reshape(2, -1), *(path for _, path in sensors))
    # Step 1: paths of all runs unless they are equal, measurements of the first run.
    are_equal = bool(np.all((paths == paths[..., :1]) | np.isnan(paths)))
    if not are_equal:
        x, y = paths / meters_per_unit
        plane.plot(x, y, color="#bbbbbb", linewidth=0.5, zorder=0)
        plane.plot([], [], color="#bbbbbb", label=f"Truth of {paths.shape[-1]} runs")
    measured = measured_positions(scenario, measurements[..., :1])
    if measured is not None:
        look: LineStyle = {
            "color": "#5599cc",
            "markersize": 2.5,
            "label": "Measurements, first run",
        }
        # x and y alone, without a height.
        plane.plot(*(measured[:2, :, 0] / meters_per_unit), ".", zorder=0.2, **look)
    first_path = paths[..., 0] / meters_per_unit
    # The look of the truth depends on the number of runs whose estimates are drawn; here there are none.
    draw_truth(plane, first_path, times, scenario.spans, estimated_runs=0)
    # Step 2: times along the path.
    # Times of a clock, such as seconds since 1970, are counted from the first one.
    is_late = time_axis.is_late(float(times[0]), float(times[-1]))
    for index in np.linspace(0, len(times) - 1, _MARKS).astype(int):
        x, y = first_path[:, index]
        plane.plot(x, y, ".", color="black", markersize=5)
        text = f"{times[index]:g} s"
        if is_late and index:
            text = f"+{times[index] - times[0]:g} s"
        elif is_late:
            text = f"{time_text(times[0])} s"
        plane.annotate(text, (x, y), (4, 4), textcoords="offset points", fontsize=7)
    # Step 3: sensors, and the way of those that move.
    for number, path in sensors:
        name = f"Sensor {number}" if len(sensors) > 1 else "Sensor"
        draw_sensor(plane, path / meters_per_unit, name)
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
    time_axis.count_times_from_start(figure, "Time (s)")
    return figure


def _draw_scene_over_time(scenario: Scenario, truth: Array, measurements: Array) -> Figure:
    """Draw each component of states and measurements of simulated runs over time.

    ``truth`` (n_x, T + 1, runs) and ``measurements`` (n_z, T, runs).
    """
    # A plugin's scenario may name fewer components than its truth has: the others are not drawn.
    states = list(zip(scenario.components, truth, strict=False))[:_MOST_ROWS]
    measured = list(zip(scenario.true_sensor.components, measurements, strict=True))
    shown_measured = measured[:_MOST_ROWS]
    height = 1.1 * (len(states) + len(shown_measured))  # inches
    figure, axes = style.subplots(len(states) + len(shown_measured), 1, height, sharex=True)
    panels: list[Axes] = list(np.atleast_1d(axes))
    state_panels = panels[: len(states)]
    measured_panels = panels[len(states) :]
    for ax, (name, values) in zip(state_panels, states, strict=True):
        ax.plot(scenario.times, values, color="#bbbbbb", linewidth=0.5, label="_")  # all runs
        first_run = values[:, 0]
        ax.plot(scenario.times, first_run, color="black", linewidth=1.2, label="Truth, first run")
        ax.set_ylabel(name)
    for ax, (name, values) in zip(measured_panels, shown_measured, strict=True):
        look: LineStyle = {"color": "#5599cc", "markersize": 3, "label": "Measurements, first run"}
        ax.plot(scenario.times[1:], values[:, 0], ".", **look)
        ax.set_ylabel(f"{name} (meas.)")
    panels[-1].set_xlabel("Time (s)")
    time_axis.count_times_from_start(figure, "Time (s)")
    return figure
