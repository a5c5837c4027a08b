"""Numbers of very long or very many runs: arrays in place of the rows of per_step.csv and per_run.csv.

A recording of 90 000 steps would fill per_step.csv with millions of rows, and 100 000 runs on a cluster
would fill per_run.csv. Such rows take longer to write and to read than a Kalman filter takes.
"""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import IO, Any, NamedTuple
from zipfile import ZIP_DEFLATED, ZIP_STORED, ZipFile, ZipInfo

import numpy as np

from trackbench.atomic_files import atomic_write
from trackbench.config.experiment import Experiment
from trackbench.config.stored_metrics import is_stored, stored_metrics
from trackbench.core.arrays import Array, Index
from trackbench.core.read_only import fixed
from trackbench.evaluation.metric_expression import measured
from trackbench.evaluation.per_step_columns import StepColumns
from trackbench.results.points_json import array_prefix
from trackbench.results.read_csv import Columns, PointRuns, Runs

PER_STEP_ARRAYS = "per_step.npz"
"""File of the numbers per step, if the runs are very long."""
PER_RUN_ARRAYS = "per_run.npz"
"""File of the numbers per run, if there are very many runs."""
MANY_RUNS = 20_000
"""Number of runs beyond which the numbers per run are arrays."""
LONG_RUN = 10_000
"""Steps of a run beyond which the numbers per step are arrays, and other files are packed faster."""
_NO_ROW = -1
"""Number of runs at a step that per_step.csv would have no row of; a bound has rows of no runs."""
_PRECISION = 6e-7
"""Relative error up to which a series is float32: less than the last digit of per_step.csv."""


def is_long(experiment: Experiment) -> bool:
    """Test whether the runs of any grid point have more than `LONG_RUN` steps."""
    return any(len(point.scenario.steps) > LONG_RUN for point in experiment.points)


def has_many_runs(experiment: Experiment) -> bool:
    """Test whether there are more than `MANY_RUNS` runs."""
    return experiment.settings.runs > MANY_RUNS


def file_of_runs(folder: Path) -> str:
    """Return the name of the file with the numbers per run: arrays if there are very many runs."""
    if (folder / PER_RUN_ARRAYS).is_file():
        return PER_RUN_ARRAYS
    return "per_run.csv"


def file_of_steps(folder: Path) -> str:
    """Return the name of the file with the numbers per step: arrays if the runs are very long."""
    if (folder / PER_STEP_ARRAYS).is_file():
        return PER_STEP_ARRAYS
    return "per_step.csv"


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
            runs = np.full(length, _NO_ROW, dtype=np.int32)
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


class Series(NamedTuple):
    """Rows of one metric of one filter at one grid point."""

    constants: dict[str, Any]
    """the one value of each column of the grid, of ``filter`` and of ``metric``"""
    numbers: dict[str, Any]
    """columns (S,) such as ``step``, ``time``, ``value``, ``stderr`` and ``runs``"""

    @property
    def rows(self) -> int:
        """Number of rows."""
        return len(self.numbers["value"])


class SeriesColumns(Columns):
    """Rows of arrays as those of a CSV file; only the series that are chosen are joined."""

    def __init__(self, series: Sequence[Series], names: Sequence[str]) -> None:
        """Begin with the rows of all ``series``; ``names`` are those of the columns, in order."""
        # `Columns` is a frozen dataclass, which takes no assignments.
        object.__setattr__(self, "_series", tuple(series))
        object.__setattr__(self, "_names", tuple(names))

    _series: tuple[Series, ...]
    _names: tuple[str, ...]

    @cached_property
    def arrays(self) -> dict[str, Array]:
        """All rows: a read-only array per column, by its name."""
        arrays: dict[str, Array] = {}
        for name in self._names:
            parts = [_column(series, name) for series in self._series]
            arrays[name] = fixed(np.concatenate(parts) if parts else np.empty(0))
        return arrays

    def rows_with(self, values: Mapping[str, Any]) -> Columns:
        """Return the rows that have the given ``values``, by the names of their columns."""
        # Constants, such as the filter's label, choose whole series; numbers choose rows of them.
        constant_columns = set(self._names).difference(_NUMBERS)
        constants = {name: value for name, value in values.items() if name in constant_columns}
        chosen = [
            series
            for series in self._series
            if all(series.constants[name] == value for name, value in constants.items())
        ]
        columns = SeriesColumns(chosen, self._names)
        numbers = {name: value for name, value in values.items() if name not in constant_columns}
        if not numbers:
            return columns
        return Columns(columns.arrays).rows_with(numbers)


_NUMBERS = ("run", "step", "time", "value", "stderr", "runs")


def _column(series: Series, name: str) -> Array:
    """Return one column (S,) of a series' rows."""
    if name in series.numbers:
        return series.numbers[name]
    # A text, such as the filter's label, or a number or truth value of the grid.
    value = series.constants[name]
    if isinstance(value, str):
        return np.full(series.rows, value, dtype=object)
    return np.full(series.rows, value)


def read_steps(
    path: Path, columns: Sequence[str], points: Sequence[Mapping[str, Any] | None]
) -> Columns:
    """Read ``per_step.npz`` as the rows of per_step.csv.

    ``columns`` are the names of that file's columns, the grid's paths first. ``points`` are the values
    of the grid's points by path, None for a point without results.
    """
    with path.open("rb") as file, np.load(file) as archive:
        arrays = dict(archive)
    series = []
    for i, point in enumerate(points):
        if point is None:
            continue
        prefix = array_prefix(i, len(points))
        head = f"{prefix}value/"
        for name, value in arrays.items():
            if not name.startswith(head):
                continue
            label_and_metric = name.removeprefix(head)
            label, _, metric = label_and_metric.rpartition("/")
            runs = arrays[f"{prefix}runs/{label_and_metric}"]
            stderr = arrays.get(f"{prefix}stderr/{label_and_metric}")
            if stderr is None:
                stderr = np.full(len(value), np.nan)
            # Steps of which per_step.csv would have a row.
            known = np.flatnonzero(runs != _NO_ROW)
            series.append(
                Series(
                    constants={**point, "filter": label, "metric": metric},
                    numbers={
                        "step": arrays[f"{prefix}step"][known],
                        "time": arrays[f"{prefix}time"][known],
                        "value": value[known].astype(float),
                        "stderr": stderr[known].astype(float),
                        "runs": runs[known],
                    },
                )
            )
    return SeriesColumns(series, columns)


def read_run_arrays(
    path: Path, points: Sequence[Mapping[str, Any] | None], labels: Collection[str]
) -> PointRuns:
    """Read ``per_run.npz``: the values per run by filter and metric, at each point of the grid.

    ``points`` are the values of the grid's points by path, None for a point without results; ``labels``
    are the filters to read. The key of a point in the result is the tuple of its values. Points of which
    no filter is read are left out.
    """
    with path.open("rb") as file, np.load(file) as archive:
        arrays = dict(archive)
    point_runs: PointRuns = {}
    for i, point in enumerate(points):
        if point is None:
            continue
        head = f"{array_prefix(i, len(points))}value/"
        runs_of_point: Runs = {}
        for name, values in arrays.items():
            label, _, metric = name.removeprefix(head).rpartition("/")
            if name.startswith(head) and label in labels:
                runs_of_point[label, metric] = fixed(values)
        if runs_of_point:
            point_runs[tuple(point.values())] = runs_of_point
    return point_runs


def rows_of_runs(runs: PointRuns, columns: Sequence[str]) -> Columns:
    """Return the values per run at each point as the rows of per_run.csv.

    ``columns`` are the names of that file's columns, the grid's paths first.
    """
    paths = [name for name in columns if name not in ("filter", "run", "metric", "value")]
    series = []
    for values_of_point, runs_of_point in runs.items():
        point = dict(zip(paths, values_of_point, strict=True))
        for (label, metric), values in runs_of_point.items():
            constants = {**point, "filter": label, "metric": metric}
            numbers = {"run": np.arange(len(values)), "value": values}
            series.append(Series(constants=constants, numbers=numbers))
    return SeriesColumns(series, columns)
