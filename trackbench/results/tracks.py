"""Tracks of runs as npz files: ``tracks.npz`` with all of them, ``shown.npz`` with those of figures."""

from pathlib import Path
from typing import Any, cast
from zipfile import ZIP_LZMA, ZipFile

import numpy as np

from trackbench.atomic_files import atomic_write
from trackbench.config.experiment import DrawnExhibit, Experiment
from trackbench.core.arrays import Array
from trackbench.evaluation.block_result import Tracks
from trackbench.evaluation.filter_result import FilterResult
from trackbench.execution.plan import Key
from trackbench.models.sensors.angular import AngularSensor
from trackbench.models.sensors.base import SensorBase
from trackbench.models.sensors.landmark import Landmark
from trackbench.models.sensors.stacked import Sensors, sensors_of
from trackbench.models.sensors.steps_at_once import is_equal_at_every_step
from trackbench.results.number_arrays import is_long, write_arrays
from trackbench.results.points_json import array_prefix
from trackbench.scenarios.base import Scenario
from trackbench.scenarios.position_from_one_scan import position_part

_LEVELS = 2048  # steps that the span of a drawn track has: finer than a dot of a printed page


class TrackFile:
    """Arrays ``truth``, ``measurements``, ``mean/<filter>`` and ``cov/<filter>`` of every run.

    Names of a grid's points have a prefix.
    """

    def __init__(self, experiment: Experiment) -> None:
        self.experiment = experiment
        self.arrays: dict[str, Any] = {}

    def add(self, key: Key, result: FilterResult) -> None:
        """Add one filter's tracks at one grid point, if tracks of any run were kept.

        ``key`` is the number of the point and the label of the filter.
        """
        if result.tracks is None:
            return
        i, label = key
        prefix = array_prefix(i, len(self.experiment.points))
        scenario = self.experiment.points[i].scenario
        arrays = {"steps": scenario.steps, "times": scenario.times}
        arrays |= self._arrays(label, result.tracks, scenario)
        self.arrays |= {f"{prefix}{name}": array for name, array in arrays.items()}

    def _arrays(self, label: str, tracks: Tracks, scenario: Scenario) -> dict[str, Array]:
        """Return one filter's arrays by name. A subclass also uses the ``scenario`` of the tracks."""
        arrays = {
            "truth": tracks.truth,
            "measurements": tracks.measurements,
            f"mean/{label}": tracks.mean,
        }
        if tracks.cov is not None:
            arrays[f"cov/{label}"] = tracks.cov
        return arrays

    def write(self, path: Path) -> None:
        """Write the file as `np.load` reads it, unless it would be empty."""
        if self.arrays:
            write_arrays(path, self.arrays)


class FigureTracks(TrackFile):
    """Arrays of the filters and runs that figures draw, with no more detail than they draw.

    A figure that only draws lines over the plane names its components in ``shown_components``. Its
    estimates are float32, rounded to the resolution of the page, and NaN in the other components. If it
    draws measurements, ``seen`` has the positions of the first run's, ``sensor/<n>`` those of a sensor,
    and ``landmark/<n>`` the place of a landmark.
    """

    def write(self, path: Path) -> None:
        """Write the file as `np.load` reads it, unless it would be empty.

        It is packed by LZMA, to be small, as every results folder has it.
        """
        if not self.arrays or is_long(self.experiment):  # LZMA would take longer than the filters
            super().write(path)
            return
        with atomic_write(path) as file, ZipFile(file, "w", ZIP_LZMA) as archive:
            for name, array in self.arrays.items():
                with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                    np.lib.format.write_array(member, np.asanyarray(array))

    def _arrays(self, label: str, tracks: Tracks, scenario: Scenario) -> dict[str, Array]:
        """Return one filter's arrays by name: no more runs and digits than the figures show.

        ``label`` is that of the filter. Its ``tracks`` have at least the runs that figures show.
        """
        figures = [figure for figure in self.experiment.figures.values() if figure.shown_runs]
        # Number of runs that are drawn in all detail: a figure without `shown_components` may draw
        # anything.
        exact_runs = _most_runs([f for f in figures if f.shown_components is None])
        # Every figure of tracks shows the truth of the first run.
        arrays = {"truth": tracks.truth[..., : max(exact_runs, 1)]}
        if exact_runs:
            arrays["measurements"] = tracks.measurements[..., :exact_runs]
        # Of measurements that figures draw as points ("seen") only the positions of the first run are
        # stored.
        if any(figure.shown_measurements for figure in figures):
            positions = measured_positions(scenario, tracks.measurements[..., :1])
            if positions is not None:
                arrays["seen"] = _quantize(positions, list(range(len(positions))))
            for n, path in sensor_paths(scenario):
                arrays[f"sensor/{n}"] = path
            for n, place in landmark_places(scenario):
                arrays[f"landmark/{n}"] = place
        # A figure that names one filter shows no other. Any other figure may show the best filters, too.
        figures_of_filter = []
        for figure in figures:
            labels = figure.filters or ()
            if len(labels) != 1 or label in labels:
                figures_of_filter.append(figure)
        # Figures that draw lines of some components alone. If all figures do, the means are rounded.
        only_lines = [f for f in figures_of_filter if f.shown_components is not None]
        means = tracks.mean[..., : _most_runs(figures_of_filter)]
        if len(only_lines) < len(figures_of_filter):
            arrays[f"mean/{label}"] = means
        elif only_lines:
            components: set[int] = set()
            for figure in only_lines:
                components.update(figure.shown_components_of(scenario) or ())
            arrays[f"mean/{label}"] = _quantize(means, sorted(components))
        # A figure that shows covariances draws its runs in all detail.
        if tracks.cov is not None and any(f.shown_covariances for f in figures_of_filter):
            arrays[f"cov/{label}"] = tracks.cov[..., :exact_runs]
        return arrays


def sensor_paths(scenario: Scenario) -> list[tuple[int, Array]]:
    """Find the number, from 1, and the path (2, T + 1), m, of each sensor that measures from a place.

    Such a sensor is an `AngularSensor`, as a radar is. Sensors of positions stand nowhere.
    """
    sensors = sensors_of(cast(Sensors, scenario.true_sensor))
    paths = []
    for n, sensor in enumerate(sensors, 1):
        if isinstance(sensor, AngularSensor):
            places = []
            for k in scenario.steps:
                # An empty place is the origin; a height is left out.
                place = sensor.place(int(k)) or (0.0, 0.0)
                places.append(place[:2])
            paths.append((n, np.array(places).T))
    return paths


def landmark_places(scenario: Scenario) -> list[tuple[int, Array]]:
    """Find the place (2,), m, of each measured landmark, after the number of its sensor, from 1."""
    sensors = sensors_of(cast(Sensors, scenario.true_sensor))
    places = []
    for n, sensor in enumerate(sensors, 1):
        if isinstance(sensor, Landmark):
            places.append((n, np.array(sensor.at)))
    return places


def measured_positions(scenario: Scenario, z: Array) -> Array | None:
    """Return the positions (axes, T, r) that the measurements z (n_z, T, r) of r runs show.

    The T steps are those after the first, which has no measurement. A missing measurement gives NaN.
    None if no sensor alone measures a position.
    """
    sensor = scenario.true_sensor
    # The sensor that measures a position, among one or several, and its rows of z.
    sensor_and_rows = position_part(sensor) if isinstance(sensor, Sensors) else None
    if sensor_and_rows is None:
        return None
    locating_sensor, rows = sensor_and_rows
    if is_equal_at_every_step(cast(SensorBase, locating_sensor)):
        # All steps in one call: the axes of steps and runs become one. The sensor is the same at every
        # step, so that 0 stands for any.
        measured = z[rows]
        located = locating_sensor.located(measured.reshape(len(measured), -1), 0).mean
        return located.reshape(-1, *z.shape[1:])
    positions = []
    for i, k in enumerate(scenario.steps[1:]):  # the first step has no measurement
        positions.append(locating_sensor.located(z[rows, i], int(k)).mean)
    return np.stack(positions, axis=1)


def _most_runs(figures: list[DrawnExhibit]) -> int:
    return max((f.shown_runs for f in figures), default=0)


@np.errstate(over="ignore", invalid="ignore")
def _quantize(mean: Array, components: list[int]) -> Array:
    """Return states (n_x, T + 1, r) as float32, rounded in ``components`` and NaN in the others.

    ``components`` are indices of rows. The resolution is a power of two, which float32 represents
    exactly: about 1 / `_LEVELS` of the span. A value beyond float32 becomes infinite without a warning,
    and a figure leaves out its point, which would be far outside the axes.
    """
    values = mean[components]
    finite = values[np.isfinite(values)]
    span = float(np.ptp(finite)) if len(finite) else 0.0
    step = 1.0
    if span > 0.0:
        step = 2.0 ** np.floor(np.log2(span / _LEVELS))
    rounded = np.full(mean.shape, np.nan, dtype=np.float32)
    rounded[components] = step * np.round(values / step)
    return cast(Array, rounded)
