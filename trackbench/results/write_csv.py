"""Write the CSV files of a results folder, to which each filter's rows are added."""

from collections.abc import Iterable
from contextlib import ExitStack
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from trackbench.atomic_files import atomic_write
from trackbench.config.experiment import Experiment
from trackbench.config.stored_metrics import is_stored, stored_metrics
from trackbench.core.arrays import Array
from trackbench.core.read_only import fixed
from trackbench.csv_writer import CsvWriter, Row, cells, number_texts, numbered_rows
from trackbench.evaluation.measure_cpu_times import Measured
from trackbench.evaluation.metric_expression import measured
from trackbench.evaluation.nees import sizes as sizes_of_nees
from trackbench.evaluation.per_step_columns import StepColumns, step_columns
from trackbench.evaluation.result_over_all_runs import FilterResult
from trackbench.evaluation.summary_rows import SummaryRow, summary_rows
from trackbench.execution.plan import Key
from trackbench.results.file_names import COLUMNS, TIMING
from trackbench.results.rows_and_columns import Runs
from trackbench.results.rows_of_bound_and_exact_errors import rows_without_runs
from trackbench.results.significant_digits import DIGITS, digits_of_times, digits_per_run
from trackbench.results.write_npz import RunArrays, StepArrays, has_many_runs, is_long
from trackbench.statistics.sample_statistics import Estimate, median


class CsvFiles:
    """Files of a results folder, to which each filter's rows are added.

    The rows of per_step.csv are arrays in ``step_arrays`` if the runs are very long, and those of
    per_run.csv in ``run_arrays`` if there are very many. ``run_values`` has the numbers of per_run.csv
    at each point, as they are read from it.
    """

    def __init__(self, files: ExitStack, folder: Path, experiment: Experiment) -> None:
        """Open each CSV file and write its heading; ``files`` closes them all.

        `COLUMNS` names all files by their plain names. timing.csv is in the folder `run/`, since times
        belong to this run alone, and the others are in the results folder itself.
        """
        self._experiment = experiment
        self.run_values: list[Runs] = [{} for _ in experiment.points]
        self.step_arrays = StepArrays(experiment) if is_long(experiment) else None
        self.run_arrays = RunArrays(experiment) if has_many_runs(experiment) else None
        self._writers: dict[str, CsvWriter] = {}
        for name, columns in COLUMNS.items():
            if name == "per_step.csv" and self.step_arrays is not None:
                continue
            if name == "per_run.csv" and self.run_arrays is not None:
                continue
            path = folder / (TIMING if name == "timing.csv" else name)
            writer = CsvWriter(files.enter_context(atomic_write(path)))
            writer.writerow([*experiment.settings.grid, *columns])
            self._writers[name] = writer

    def add(self, key: Key, result: FilterResult) -> None:
        """Add the rows of one filter at one grid point to every file.

        ``key`` is the number of the point and the label of the filter.
        """
        point, label = key
        scenario = self._experiment.points[point].scenario
        sizes = sizes_of_nees(scenario)  # number of the state's components in each NEES
        digits = digits_per_run(self._experiment, key)
        self._add_runs(point, label, result.per_run, digits)
        self._add_steps(point, label, step_columns(result, sizes))
        # Only metrics that are written need a summary; every row has the number of lost runs. If
        # ``stored`` is None, all metrics are written.
        stored = stored_metrics(self._experiment.settings, "summary.csv")
        per_run = {
            metric: values
            for metric, values in result.per_run.items()
            if stored is None or measured(metric).base in {"lost", *stored}
        }
        summarized = result._replace(per_run=per_run)
        rows = summary_rows(summarized, sizes, scenario.windows)
        self._add_summary(point, label, rows)
        timing_cells = _timing_cells(summarized)
        self._writers["timing.csv"].writerow([*self._head_cells(point, label), *timing_cells])

    def add_numbers_without_runs(self) -> None:
        """Add lower bounds and exact errors like filters."""
        for rows in rows_without_runs(self._experiment):
            self._add_summary(rows.point, rows.label, rows.summary)
            self._add_steps(rows.point, rows.label, rows.steps)

    def _add_runs(self, point: int, label: str, per_run: dict[str, Array], digits: int) -> None:
        """Add rows of per_run.csv, a metric at a time, and store the values in ``run_values``.

        ``point`` is the number of the grid point, ``per_run`` has the values (M,) by metric, and
        ``digits`` is the number of significant digits. The rows are so many that they are written as
        text, which is faster than `csv`.
        """
        head = self._head_text(point, label)
        stored = stored_metrics(self._experiment.settings, "per_run.csv")
        for metric, values in per_run.items():
            # The config lists metrics by their base names: rmse_position for rmse_position[turns].
            if not is_stored(stored, measured(metric).base):
                continue
            # Very many runs have arrays in a binary file in place of per_run.csv.
            if self.run_arrays is not None:
                self.run_arrays.add(point, label, metric, values)
                self.run_values[point][label, metric] = fixed(values)  # read-only
            else:
                rows, as_read = numbered_rows(f"{head},", f",{cells([metric])},", values, digits)
                self._writers["per_run.csv"].write(rows)
                self.run_values[point][label, metric] = fixed(as_read)

    def _add_steps(self, point: int, label: str, columns: Iterable[StepColumns]) -> None:
        """Add rows of per_step.csv, a series at a time: all metrics of a step, then the next step.

        ``point`` is the number of the grid point. Each of the ``columns`` has the metrics that are
        computed from one series, such as RMSE and MSE from the squared error, at the steps that it has
        values at: ``positions`` are the indices of these steps.
        """
        # Very long runs have arrays in a binary file in place of per_step.csv.
        if self.step_arrays is not None:
            self.step_arrays.add(point, label, columns)
            return
        scenario = self._experiment.points[point].scenario
        stored = stored_metrics(self._experiment.settings, "per_step.csv")
        digits = DIGITS["per_step.csv"]
        head = self._head_text(point, label)
        times = number_texts(scenario.times, digits_of_times(scenario.times, digits))
        steps_and_times = zip(scenario.steps.tolist(), times, strict=True)
        heads = np.array([f"{head},{step},{time}" for step, time in steps_and_times], dtype=object)
        for series_columns in columns:
            step_heads = heads[series_columns.positions].tolist()
            runs = number_texts(series_columns.runs, digits)
            # Lines of each metric, a line per step.
            lines_by_metric: list[list[str]] = []
            for metric, estimates in series_columns.metrics.items():
                # The config lists metrics by their base names, such as nees for ANEES.
                if not is_stored(stored, measured(metric).base):
                    continue
                name = cells([metric])
                values = number_texts(estimates.value, digits)
                stderrs = number_texts(estimates.stderr, digits)
                rows = zip(step_heads, values, stderrs, runs, strict=True)
                lines = [
                    f"{step_head},{name},{value},{stderr},{number}\n"
                    for step_head, value, stderr, number in rows
                ]
                lines_by_metric.append(lines)
            lines_by_step = zip(*lines_by_metric, strict=True)
            lines_in_order = "".join(chain.from_iterable(lines_by_step))
            self._writers["per_step.csv"].write(lines_in_order.encode())

    def _add_summary(self, point: int, label: str, rows: Iterable[SummaryRow]) -> None:
        """Add rows of summary.csv, of the metrics that are stored, rounded to the file's digits."""
        stored = stored_metrics(self._experiment.settings, "summary.csv")
        head = self._head_cells(point, label)
        digits = DIGITS["summary.csv"]
        for row in rows:
            if is_stored(stored, measured(row.metric).base):
                value = float(f"{row.value:.{digits}g}")
                stderr = float(f"{row.stderr:.{digits}g}")
                rounded = row._replace(value=value, stderr=stderr)
                self._writers["summary.csv"].writerow([*head, *rounded])

    def _head_cells(self, point: int, label: str) -> list[Any]:
        """Return the cells that begin a row: values of the grid point by its number, and the label."""
        return [*self._experiment.points[point].values.values(), label]

    def _head_text(self, point: int, label: str) -> str:
        """Return the cells that begin a row as text of a CSV."""
        return cells(self._head_cells(point, label))


def _timing_cells(result: FilterResult) -> Row:
    """Return the cells of a row of timing.csv: runs, CPU times, repeats and numbers of operations.

    The CPU time of a run is the median over the repeats that measured it. Without repeats it is that of
    the blocks, and has no standard error.
    """
    runs = sum(timing.runs for timing in result.timing)
    cpu_s = sum(timing.cpu_s for timing in result.timing)
    times = result.measured or Measured(seconds=[], likelihoods=None, covariances=None)
    per_run = Estimate(value=cpu_s / runs, stderr=np.nan)
    if times.seconds:
        per_run = median(np.array(times.seconds))
    repeats = ";".join(f"{seconds:.6g}" for seconds in times.seconds)
    # A number is None if the filter uses no kernel that counts the operation.
    operations = [
        "-" if number is None else f"{number:.6g}"
        for number in (times.likelihoods, times.covariances)
    ]
    return runs, cpu_s, per_run.value, per_run.stderr, repeats, *operations
