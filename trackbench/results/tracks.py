"""Tracks of runs as npz files: ``tracks.npz`` with all of them, ``shown.npz`` with those of figures."""

from itertools import chain
from pathlib import Path
from typing import Any, cast
from zipfile import ZIP_LZMA, ZipFile

import numpy as np

from trackbench.atomic_files import atomic_write
from trackbench.config.experiment import DrawnExhibit, Experiment
from trackbench.core.arrays import Array
from trackbench.evaluation.block import Tracks
from trackbench.evaluation.summary import FilterResult
from trackbench.execution.plan import Key
from trackbench.models.sensors.angular import AngularSensor
from trackbench.models.sensors.base import Sensors, StackedSensor
from trackbench.models.sensors.position import LinearSensor
from trackbench.results.point_facts import array_prefix
from trackbench.scenarios.base import Scenario
from trackbench.scenarios.starts.base import position_part

_LEVELS = 2048  # steps that the span of a drawn track has: finer than a dot of a printed page


class TrackFile:
    """Arrays ``truth``, ``measurements``, ``mean/<filter>`` and ``cov/<filter>`` of every run.

    Names of a grid's points have a prefix.
    """

    def __init__(self, experiment: Experiment) -> None:
        self.experiment = experiment
        self.arrays: dict[str, Any] = {}

    def add(self, key: Key, result: FilterResult) -> None:
        """Add one filter's tracks."""
        if result.tracks is None:
            return
        i, label = key
        prefix = array_prefix(i, len(self.experiment.points))
        scenario = self.experiment.points[i].scenario
        arrays = {"steps": scenario.steps, "times": scenario.times}
        if (span := self.experiment.shown_particles) is not None:
            arrays["particle_steps"] = np.arange(span[0], span[1] + 1)
        arrays |= self._arrays(label, result.tracks, scenario)
        self.arrays |= {f"{prefix}{name}": array for name, array in arrays.items()}

    def _arrays(self, label: str, tracks: Tracks, scenario: Scenario) -> dict[str, Array]:
        arrays = {"truth": tracks.truth, "measurements": tracks.measurements}
        arrays[f"mean/{label}"] = tracks.mean
        optional = {"cov": tracks.cov, "particles": tracks.particles}
        return arrays | {f"{name}/{label}": a for name, a in optional.items() if a is not None}

    def write(self, path: Path) -> None:
        """Write the file as `np.load` reads it, unless it would be empty."""
        if not self.arrays:
            return
        with atomic_write(path) as file, ZipFile(file, "w", ZIP_LZMA) as archive:
            for name, array in self.arrays.items():
                with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                    np.lib.format.write_array(member, np.asanyarray(array))


class FigureTracks(TrackFile):
    """Arrays of the filters and runs that figures draw, with no more detail than they draw.

    A figure that only draws lines over the plane names its components in ``shown_components``. Its
    estimates are float32, rounded to the resolution of the page, and NaN in the other components. If it
    draws measurements, ``seen`` has the positions of the first run's, ``sensor/<n>`` those of a sensor.
    """

    def _arrays(self, label: str, tracks: Tracks, scenario: Scenario) -> dict[str, Array]:
        figures = [f for f in self.experiment.figures.values() if f.shown_runs]
        exact = _most_runs([f for f in figures if f.shown_components is None])
        arrays = {"truth": tracks.truth[..., : max(exact, 1)]}
        if exact:
            arrays["measurements"] = tracks.measurements[..., :exact]
        if any(f.shown_measurements for f in figures):
            positions = measured_positions(scenario, tracks.measurements[..., :1])
            if positions is not None:
                arrays["seen"] = _quantized(positions, list(range(len(positions))))
            arrays |= {f"sensor/{n}": path for n, path in sensor_paths(scenario)}
        # A figure of one filter shows no other; any other figure may show the best, too.
        of_filter = [f for f in figures if len(f.filters or ()) != 1 or label in (f.filters or ())]
        only_lines = [f for f in of_filter if f.shown_components is not None]
        means = tracks.mean[..., : _most_runs(of_filter)]
        if len(only_lines) < len(of_filter):
            arrays[f"mean/{label}"] = means
        elif only_lines:
            shown = (figure.shown_components or () for figure in only_lines)
            components = sorted(set(chain.from_iterable(shown)))
            arrays[f"mean/{label}"] = _quantized(means, components)
        if tracks.cov is not None and any(f.shown_covariances for f in of_filter):
            arrays[f"cov/{label}"] = tracks.cov[..., :exact]
        if tracks.particles is not None and any(f.shown_particles for f in of_filter):
            arrays[f"particles/{label}"] = tracks.particles.astype(np.float32)
        return arrays


def sensor_paths(scenario: Scenario) -> list[tuple[int, Array]]:
    """Find the number and path (2, T) of each sensor that has a place."""
    sensor = scenario.true_sensor
    sensors = sensor.sensors if isinstance(sensor, StackedSensor) else (sensor,)
    paths = []
    for n, each in enumerate(sensors, 1):
        if isinstance(each, AngularSensor):
            places = [(each.place(int(k)) or (0.0, 0.0))[:2] for k in scenario.steps]
            paths.append((n, np.array(places).T))
    return paths


def measured_positions(scenario: Scenario, z: Array) -> Array | None:
    """Locate measurements (n_z, T, r): positions (axes, T, r), NaN for a missing one.

    None if no sensor measures a position at once.
    """
    sensor = scenario.true_sensor
    located = position_part(sensor) if isinstance(sensor, Sensors) else None
    if located is None:
        return None
    one, rows = located
    if isinstance(one, LinearSensor):
        return one.located(z[rows], 0).mean  # equal at every step
    steps = enumerate(scenario.steps[1:])
    return np.stack([one.located(z[rows, i], int(k)).mean for i, k in steps], axis=1)


def _most_runs(figures: list[DrawnExhibit]) -> int:
    return max((f.shown_runs for f in figures), default=0)


@np.errstate(over="ignore", invalid="ignore")  # a value beyond float32 is infinite: no page has it
def _quantized(mean: Array, components: list[int]) -> Array:
    """Round the components (n_x, T + 1, r) to a step of a power of two, which float32 represents."""
    values = mean[components]
    finite = values[np.isfinite(values)]
    span = float(np.ptp(finite)) if len(finite) else 0.0
    step = 2.0 ** np.floor(np.log2(span / _LEVELS)) if span > 0.0 else 1.0
    rounded = np.full(mean.shape, np.nan, dtype=np.float32)
    rounded[components] = step * np.round(values / step)
    return cast(Array, rounded)
