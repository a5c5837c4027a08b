"""Write numbers of very long or very many runs as arrays, in place of per_step.csv and per_run.csv.

A recording of 90 000 steps would fill per_step.csv with millions of rows, and 100 000 runs on a cluster
would fill per_run.csv. Such rows take longer to write and to read than a Kalman filter takes.
"""

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import IO, Any
from zipfile import ZIP_DEFLATED, ZIP_STORED, ZipFile, ZipInfo

import numpy as np

from trackbench.atomic_files import atomic_write
from trackbench.config.experiment import Experiment
from trackbench.config.stored_metrics import is_stored, stored_metrics
from trackbench.core.arrays import Array, Index
from trackbench.evaluation.metric_expression import measured
from trackbench.evaluation.per_step_columns import StepColumns
from trackbench.results.file_names import PER_RUN_ARRAYS, PER_STEP_ARRAYS
from trackbench.results.points_json import array_prefix
from trackbench.results.read_npz import NO_ROW

MANY_RUNS = 20_000
"""Number of runs beyond which the numbers per run are arrays."""
LONG_RUN = 10_000
"""Steps of a run beyond which the numbers per step are arrays, and other files are packed faster."""
_PRECISION = 6e-7
"""Relative error up to which a series is float32: less than the last digit of per_step.csv."""


def is_long(experiment: Experiment) -> bool:
    """Test whether the runs of any grid point have more than `LONG_RUN` steps."""
    return any(len(point.scenario.steps) > LONG_RUN for point in experiment.points)


def has_many_runs(experiment: Experiment) -> bool:
    """Test whether there are more than `MANY_RUNS` runs."""
    return experiment.settings.runs > MANY_RUNS


def array_notes(experiment: Experiment) -> Iterator[str]:
    """Yield a note on each file of arrays that a run writes in place of a CSV file."""
    if is_long(experiment):
        # Without the step of the initial state.
        steps = max(len(point.scenario.steps) - 1 for point in experiment.points)
        yield (
            f"{PER_STEP_ARRAYS} has the numbers of all {steps} steps in place of per_step.csv, which "
            "would be large and slow; in Python trackbench.load(FOLDER).per_step reads either"
        )
    if has_many_runs(experiment):
        yield (
            f"{PER_RUN_ARRAYS} has the numbers of all {experiment.settings.runs} runs in place of "
            "per_run.csv, which would be large and slow; in Python trackbench.load(FOLDER).per_run "
            "reads either"
        )


def write_arrays(path: Path, arrays: Mapping[str, Any], stored: Iterable[str] = ()) -> None:
    """Write arrays to a file for `np.load`.

    Those named in ``stored`` are not compressed, the others at the fastest level.
    """
    uncompressed = set(stored)
    with atomic_write(path) as file, ZipFile(file, "w", ZIP_DEFLATED, compresslevel=1) as archive:
        for name, array in arrays.items():
            # `ZipInfo` has a fixed date, so that equal arrays give equal bytes.
            member_info = ZipInfo(f"{name}.npy")
            member_info.compress_type = ZIP_STORED if name in uncompressed else ZIP_DEFLATED
            with archive.open(member_info, "w", force_zip64=True) as member:
                _write_npy(member, np.ascontiguousarray(array))


def _write_npy(file: IO[bytes], array: Array) -> None:
    """Write what `np.lib.format.write_array` writes of a contiguous array, without copying it."""
    header = np.lib.format.header_data_from_array_1_0(array)
    np.lib.format.write_array_header_1_0(file, header)
    file.write(array.reshape(-1).view(np.uint8).data)


class StepArrays:
    """Writer of ``per_step.npz``: arrays (T + 1,) over the steps, by filter and metric.

    ``step`` and ``time`` are the numbers and times of the steps. ``value/<filter>/<metric>`` is NaN
    where ``runs/<filter>/<metric>``, the number of runs with a value, is -1. Series with standard errors
    have ``stderr/<filter>/<metric>``. Names of a grid's points have a prefix.
    """

    def __init__(self, experiment: Experiment) -> None:
        self._experiment = experiment
        self._stored = stored_metrics(experiment.settings, "per_step.csv")
        self._arrays: dict[str, Any] = {}

    def add(self, point: int, label: str, columns: Iterable[StepColumns]) -> None:
        """Add the metrics of one filter at one grid point.

        ``point`` is the number of the point, and ``label`` that of the filter. Each of the ``columns``
        has the metrics that are computed from one series, such as RMSE and MSE from the squared error. A
        series has no values at steps where no run has one, as at those without a measurement.
        """
        prefix = array_prefix(point, len(self._experiment.points))
        scenario = self._experiment.points[point].scenario
        self._arrays[f"{prefix}step"] = scenario.steps
        self._arrays[f"{prefix}time"] = scenario.times
        length = len(scenario.steps)
        for series_columns in columns:
            # Indices in `scenario.steps` of the steps that the series has.
            positions = series_columns.positions
            # Steps that the series lacks would have no row in per_step.csv.
            runs = np.full(length, NO_ROW, dtype=np.int32)
            runs[positions] = series_columns.runs
            for metric, estimates in series_columns.metrics.items():
                # The config lists metrics by their base names, such as nees for ANEES.
                if not is_stored(self._stored, measured(metric).base):
                    continue
                name = f"{label}/{metric}"
                value = _spread(estimates.value, positions, length)
                self._arrays[f"{prefix}value/{name}"] = value
                self._arrays[f"{prefix}runs/{name}"] = runs
                if not np.isnan(estimates.stderr).all():
                    stderr = _spread(estimates.stderr, positions, length)
                    self._arrays[f"{prefix}stderr/{name}"] = stderr

    def write(self, path: Path) -> None:
        """Write the file."""
        numbers = [name for name in self._arrays if "value/" in name or "stderr/" in name]
        write_arrays(path, self._arrays, stored=numbers)


def _spread(values: Array, positions: Index, length: int) -> Any:
    """Return an array (length,) with the values (S,) at the indices ``positions`` (S,), else NaN.

    It is float32 if its relative error is then at most `_PRECISION`.
    """
    whole = np.full(length, np.nan)
    whole[positions] = values
    with np.errstate(over="ignore", under="ignore"):
        short = whole.astype(np.float32)
    is_exact = np.allclose(short, whole, rtol=_PRECISION, atol=0.0, equal_nan=True)
    return short if is_exact else whole


class RunArrays:
    """Writer of ``per_run.npz``: ``value/<filter>/<metric>`` (M,), NaN of a lost run.

    Names of a grid's points have a prefix.
    """

    def __init__(self, experiment: Experiment) -> None:
        self._points = len(experiment.points)
        self._arrays: dict[str, Array] = {}

    def add(self, point: int, label: str, metric: str, values: Array) -> None:
        """Add the values (M,) of one metric of one filter at one grid point."""
        self._arrays[f"{array_prefix(point, self._points)}value/{label}/{metric}"] = values

    def write(self, path: Path) -> None:
        """Write the file."""
        write_arrays(path, self._arrays, stored=self._arrays)
