"""Whole tracks of the runs that are shown or asked for, as one npz file."""

from pathlib import Path
from typing import Any, cast
from zipfile import ZIP_LZMA, ZipFile

import numpy as np

from trackbench.atomic_files import atomic_write
from trackbench.config.experiment import DrawnExhibit, Experiment
from trackbench.core.arrays import Array
from trackbench.evaluation.block import Tracks
from trackbench.evaluation.merge import FilterResult
from trackbench.execution.plan import Key
from trackbench.models.sensors.stacked import Sensors
from trackbench.results.point_facts import array_prefix
from trackbench.scenarios.base import Scenario
from trackbench.scenarios.starts.base import locating

_LEVELS = 2048  # that a drawn track's span is divided into: finer than a dot of the printed page


class TrackFile:
    """``truth``, ``measurements``, ``mean/<filter>`` and, where it was kept, ``cov/<filter>``.

    Of every run. Names of a grid's points have a prefix.
    """

    def __init__(self, experiment: Experiment) -> None:
        self.experiment = experiment
        self.arrays: dict[str, Any] = {}

    def add(self, key: Key, result: FilterResult) -> None:
        """Take over one filter's tracks."""
        if result.tracks is None:
            return
        i, label = key
        prefix = array_prefix(i, len(self.experiment.points))
        scenario = self.experiment.points[i].scenario
        arrays = {"steps": scenario.steps, "times": scenario.times}
        arrays |= self._arrays(label, result.tracks, scenario)
        self.arrays |= {f"{prefix}{name}": array for name, array in arrays.items()}

    def _arrays(self, label: str, tracks: Tracks, scenario: Scenario) -> dict[str, Array]:
        arrays = {"truth": tracks.truth, "measurements": tracks.measurements}
        arrays[f"mean/{label}"] = tracks.mean
        return arrays if tracks.cov is None else arrays | {f"cov/{label}": tracks.cov}

    def write(self, path: Path) -> None:
        """Write the file as `np.load` reads it, if there is anything in it."""
        if not self.arrays:
            return
        with atomic_write(path) as file, ZipFile(file, "w", ZIP_LZMA) as archive:
            for name, array in self.arrays.items():
                with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                    np.lib.format.write_array(member, np.asanyarray(array))


class FigureTracks(TrackFile):
    """The same of the filters and runs that figures show, and no more than they show of them.

    A figure that only draws lines over the plane says so by ``shown_components``, the components it
    draws. Its estimates are float32, rounded to the page's grain, NaN in the other components; where it
    draws measurements, ``seen`` are the positions of the first run's.
    """

    def _arrays(self, label: str, tracks: Tracks, scenario: Scenario) -> dict[str, Array]:
        figures = [f for f in self.experiment.figures.values() if f.shown_runs]
        exact = _most_runs([f for f in figures if f.shown_components is None])
        arrays = {"truth": tracks.truth[..., : max(exact, 1)]}
        if exact:
            arrays["measurements"] = tracks.measurements[..., :exact]
        seen = None
        if any(f.shown_measurements for f in figures):
            seen = measured_positions(scenario, tracks.measurements[..., :1])
        if seen is not None:
            arrays["seen"] = _quantised(seen, list(range(len(seen))))
        mine = [f for f in figures if f.filters is None or label in f.filters]
        drawn = [f for f in mine if f.shown_components is not None]
        runs = _most_runs(mine)
        if len(drawn) < len(mine):
            arrays[f"mean/{label}"] = tracks.mean[..., :runs]
        elif drawn:
            components = sorted({c for f in drawn for c in f.shown_components or ()})
            arrays[f"mean/{label}"] = _quantised(tracks.mean[..., :runs], components)
        if tracks.cov is not None and any(f.shown_covariances for f in mine):
            arrays[f"cov/{label}"] = tracks.cov[..., :exact]
        return arrays


def measured_positions(scenario: Scenario, z: Array) -> Array | None:
    """Positions (axes, T, r) that measurements (n_z, T, r) tell, NaN where there is none.

    None if no sensor tells a position in one measurement.
    """
    sensor = scenario.true_sensor
    found = locating(sensor) if isinstance(sensor, Sensors) else None
    if found is None:
        return None
    one, rows = found
    each = [one.located(z[rows, i], int(k)).mean for i, k in enumerate(scenario.steps[1:])]
    return np.stack(each, axis=1)


def _most_runs(figures: list[DrawnExhibit]) -> int:
    return max((f.shown_runs for f in figures), default=0)


@np.errstate(
    over="ignore", invalid="ignore"
)  # what a float32 cannot hold is infinite: no page has it
def _quantised(mean: Array, components: list[int]) -> Array:
    """The components (n_x, T + 1, r) in steps of a power of two, which a float32 holds exactly."""
    chosen = mean[components]
    finite = chosen[np.isfinite(chosen)]
    span = float(np.ptp(finite)) if len(finite) else 0.0
    grain = 2.0 ** np.floor(np.log2(span / _LEVELS)) if span > 0.0 else 1.0
    rounded = np.full(mean.shape, np.nan, dtype=np.float32)
    rounded[components] = grain * np.round(chosen / grain)
    return cast(Array, rounded)
