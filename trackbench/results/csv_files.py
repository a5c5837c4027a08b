"""CSV files of a run: numbers of its runs and steps, their summaries, and CPU times."""

from collections.abc import Iterable
from contextlib import ExitStack
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from trackbench.atomic_files import CsvWriter, Row, atomic_write, cells, shortened
from trackbench.config.experiment import Experiment
from trackbench.config.metric_names import is_stored, stored_metrics
from trackbench.core.arrays import Array, Index
from trackbench.evaluation.block import BlockTask
from trackbench.evaluation.consistency_and_calibration import sizes
from trackbench.evaluation.exact_errors import exact_series
from trackbench.evaluation.metric_expression import exact_label, measured
from trackbench.evaluation.summary import (
    FilterResult,
    StepColumns,
    SummaryRow,
    bound_steps,
    bound_summary,
    exact_rows,
    step_columns,
    summary_rows,
)
from trackbench.execution.plan import Key
from trackbench.results.folder_contents import COLUMNS, DIGITS, TIMING
from trackbench.statistics.over_runs import Estimate, Estimates, median


class CsvFiles:
    """Files of a results folder, to which each filter's rows are added."""

    def __init__(self, files: ExitStack, folder: Path, experiment: Experiment) -> None:
        self._experiment = experiment
        self._writers: dict[str, CsvWriter] = {}
        for name, columns in COLUMNS.items():
            path = folder / (TIMING if name == "timing.csv" else name)
            self._writers[name] = CsvWriter(files.enter_context(atomic_write(path)))
            self._writers[name].writerow([*experiment.settings.grid, *columns])

    def add(self, key: Key, result: FilterResult) -> None:
        """Add the rows of one filter at one grid point."""
        point, label = key
        scenario = self._experiment.points[point].scenario
        self._add_runs(self._head(point, label), result.per_run)
        self._add_steps(point, label, step_columns(result, sizes(scenario)))
        # Only metrics that are written need a summary.
        stored = stored_metrics(self._experiment.settings, "summary.csv")
        per_run = {
            metric: values
            for metric, values in result.per_run.items()
            if stored is None or measured(metric).base in {"lost", *stored}
        }
        result = result._replace(per_run=per_run)
        self._add_summary(point, label, summary_rows(result, sizes(scenario), scenario.windows))
        self._writers["timing.csv"].writerow([*self._cells(point, label), *_timing(result)])

    def add_numbers_without_runs(self) -> None:
        """Add lower bounds and exact errors, as of a filter; of exact errors no standard errors."""
        settings = self._experiment.settings
        for i, point in enumerate(self._experiment.points):
            scenario = point.scenario
            if settings.bound:
                bounds, without = scenario.bounds(), scenario.bounds_without_batch()
                rows = bound_summary(bounds, scenario.windows, without)
                self._add_summary(i, settings.bound, rows)
                self._add_steps(i, settings.bound, bound_steps(bounds, without))
            for name in settings.exact:
                tracker, assume = point.filters[name], point.assumed.get(name)
                task = BlockTask(
                    scenario, tracker, 0, 0, 1, 1, assume=assume, hold_out=settings.hold_out
                )
                summary, steps = exact_rows(exact_series(task), sizes(scenario), scenario.windows)
                label = exact_label(name)
                self._add_summary(i, label, [r._replace(stderr=np.nan, runs=0) for r in summary])
                self._add_steps(i, label, map(_without_runs, steps))

    def _add_runs(self, head: str, per_run: dict[str, Array]) -> None:
        """Add rows of per_run.csv, a metric at a time: for their number `csv` is too slow."""
        stored = stored_metrics(self._experiment.settings, "per_run.csv")
        for metric, values in per_run.items():
            if is_stored(stored, measured(metric).base):
                texts, name = _texts(values, "per_run.csv"), cells([metric])
                lines = [f"{head},{run},{name},{x}\n" for run, x in enumerate(texts)]
                self._writers["per_run.csv"].write("".join(lines))

    def _add_steps(self, point: int, label: str, columns: Iterable[StepColumns]) -> None:
        """Add rows of per_step.csv, a series at a time: all metrics of a step, then the next step."""
        file, head = "per_step.csv", self._head(point, label)
        scenario = self._experiment.points[point].scenario
        stored = stored_metrics(self._experiment.settings, file)
        times = zip(scenario.steps.tolist(), _texts(scenario.times, file), strict=True)
        heads = np.array([f"{head},{step},{time}" for step, time in times], dtype=object)
        for of_series in columns:
            lines: list[list[str]] = []
            at, runs = heads[of_series.positions].tolist(), _texts(of_series.runs, file)
            for metric, estimates in of_series.metrics.items():
                if is_stored(stored, measured(metric).base):
                    name, value, stderr = cells([metric]), *(_texts(x, file) for x in estimates)
                    rows = zip(at, value, stderr, runs, strict=True)
                    lines.append([f"{a},{name},{x},{s},{n}\n" for a, x, s, n in rows])
            self._writers[file].write("".join(chain.from_iterable(zip(*lines, strict=True))))

    def _add_summary(self, point: int, label: str, rows: Iterable[SummaryRow]) -> None:
        stored = stored_metrics(self._experiment.settings, "summary.csv")
        before, digits = self._cells(point, label), DIGITS["summary.csv"]
        for row in rows:
            if is_stored(stored, measured(row.metric).base):
                value, stderr = (float(f"{x:.{digits}g}") for x in (row.value, row.stderr))
                row = row._replace(value=value, stderr=stderr)
                self._writers["summary.csv"].writerow([*before, *row])

    def _cells(self, point: int, label: str) -> list[Any]:
        """Begin a row: values of the grid point, and the filter."""
        return [*self._experiment.points[point].values.values(), label]

    def _head(self, point: int, label: str) -> str:
        return cells(self._cells(point, label))


def _texts(values: Array | Index, file: str) -> list[str]:
    """Write numbers as the file has them."""
    bits = np.ascontiguousarray(values).view(f"u{values.itemsize}")
    if len(values) > 1 and (bits == bits[0]).all():
        return _texts(values[:1], file) * len(values)
    if values.dtype.kind != "f":
        return [str(x) for x in values.tolist()]
    return shortened(values.tolist(), DIGITS[file])


def _without_runs(columns: StepColumns) -> StepColumns:
    """Return exact numbers, which no runs and so no standard errors belong to."""
    metrics = {
        name: Estimates(estimates.value, np.full_like(estimates.stderr, np.nan))
        for name, estimates in columns.metrics.items()
    }
    return columns._replace(metrics=metrics, runs=np.zeros_like(columns.runs))


def _timing(result: FilterResult) -> Row:
    """Return the CPU time of all blocks, and of a run: the median of its measured times, if any."""
    runs = sum(t.runs for t in result.timing)
    cpu_s = sum(t.cpu_s for t in result.timing)
    seconds, *operations = result.measured or ([], None, None)
    of_run = median(np.array(seconds)) if seconds else Estimate(cpu_s / runs, np.nan)
    repeats = ";".join(f"{s:.6g}" for s in seconds)
    return runs, cpu_s, *of_run, repeats, *("-" if n is None else f"{n:.6g}" for n in operations)
