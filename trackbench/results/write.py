"""Write the files of a run into a results folder, each whole or not at all: CSV, tracks, config."""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack
from itertools import chain
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, cast

import numpy as np

from trackbench.atomic_files import (
    CsvWriter,
    Row,
    atomic_write,
    cells,
    ensure_folder,
    note,
    shortened,
    within,
    write_bytes,
    write_csv,
    write_text,
)
from trackbench.config.dump import as_yaml, data_files, resolved
from trackbench.config.experiment import Experiment
from trackbench.config.metric_names import is_stored, stored_metrics
from trackbench.config.requested_metrics import requested_contributions
from trackbench.core.arrays import Array, Index
from trackbench.core.sums import total
from trackbench.evaluation.block import BlockTask
from trackbench.evaluation.consistency_and_calibration import sizes
from trackbench.evaluation.error_series import LOST_BECAUSE, NO_TRUTH, NOT_FINITE
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
    with_shares,
)
from trackbench.evaluation.timing import Measured
from trackbench.execution.plan import Key
from trackbench.execution.runner import Outcome
from trackbench.models.sensors.base import Sensors, rows_of
from trackbench.results.folder_contents import (
    ARRIVAL_COLUMNS,
    ARRIVALS,
    COLUMNS,
    DIGITS,
    EXACT_DIGITS,
    TIMING,
    remove_outputs,
)
from trackbench.results.point_facts import POINTS_FILE, points_text
from trackbench.results.run_facts import facts_of_run
from trackbench.results.tracks import FigureTracks, TrackFile
from trackbench.statistics.over_runs import Estimate, Estimates, median


class Losses(NamedTuple):
    """Number of runs of one filter, and of the lost ones by reason."""

    runs: int
    by_code: dict[float, int]
    has_distance: bool = True
    """whether the reference could be run, if there is one"""

    @classmethod
    def of(cls, result: FilterResult) -> "Losses":
        """Count the codes of the metric ``lost``."""
        codes = result.per_run["lost"]
        distances = [
            x for name, x in result.per_run.items() if measured(name).family[0].name == "rmsd"
        ]
        known = any(np.isfinite(x).any() for x in distances) or not distances or (codes > 0).all()
        by_code = {code: int((codes == code).sum()) for code in LOST_BECAUSE}
        return cls(len(codes), by_code, bool(known))

    @property
    def lost(self) -> int:
        """Runs lost for any reason."""
        return sum(self.by_code.values())

    @property
    def is_total(self) -> bool:
        """True if no run has finite estimates and a finite truth, so that there is nothing to show."""
        return self.by_code[NOT_FINITE] + self.by_code[NO_TRUTH] == self.runs

    def __str__(self) -> str:
        reasons = [f"{n} because {LOST_BECAUSE[code]}" for code, n in self.by_code.items() if n]
        return f"{self.lost} of {self.runs} runs lost, {', '.join(reasons)}"


def write_results(
    folder: Path,
    experiment: Experiment,
    outcome: Outcome,
    tracks: bool,
    times: Mapping[Key, Measured] = MappingProxyType({}),
) -> tuple[dict[Key, Losses], dict[str, Any]]:
    """Write the files of a run in place of what earlier runs left, from which all others are made.

    ``times`` are measured CPU times. Return the lost runs of each filter, and the facts for the
    manifest, which the caller writes after all other files.
    """
    published = experiment.published.files
    inputs = {"config.yaml", *(f"published/{name}" for name in published)}
    remove_outputs(folder, keep=inputs)  # the run may read these; they are replaced whole
    write_text(folder / "config.yaml", as_yaml(resolved(experiment, folder)))
    for name, text in published.items():
        write_text(ensure_folder(within(folder, "published")) / name, text)
    write_text(folder / POINTS_FILE, points_text(experiment.points, folder))
    for name, path in data_files(experiment, folder).items():
        if path.resolve() != (folder / name).resolve():
            write_bytes(folder / name, path.read_bytes())
        elif path.is_file():  # not so a pattern of names
            note(folder / name)
    track_files: dict[str, TrackFile] = {"shown.npz": FigureTracks(experiment)}
    if tracks:
        track_files["tracks.npz"] = TrackFile(experiment)
    ensure_folder(within(folder, "run"))
    losses, requested, settings = {}, requested_contributions(experiment), experiment.settings
    spent: dict[BlockTask, float] = {}  # several points may share a filtered block
    with ExitStack() as files:
        csv_files = CsvFiles(files, folder, experiment)
        for key, result in outcome.results():
            # Add each run's share in the requested measures; drop the series that only they need.
            scenario = experiment.points[key[0]].scenario
            steps, parts = scenario.steps.tolist(), sizes(scenario)
            shares = requested.of(key[1], steps)
            result = with_shares(result, shares, scenario.windows, steps, parts)
            series = {n: rows for n, rows in result.run_series.items() if n in settings.medians}
            result = result._replace(run_series=series, measured=times.get(key))
            losses[key] = Losses.of(result)
            passes = (task.filtering_key for task in outcome.plan.tasks[key])
            spent.update(zip(passes, (t.cpu_s for t in result.timing), strict=True))
            csv_files.add(key, result)
            for track_file in track_files.values():
                track_file.add(key, result)
        csv_files.add_numbers_without_runs()
    for name, track_file in track_files.items():
        track_file.write(folder / name)
    if any(point.scenario.longest_delay for point in experiment.points):
        columns = [*experiment.settings.grid, *ARRIVAL_COLUMNS]
        write_csv(folder / ARRIVALS, columns, _arrival_rows(experiment, outcome))
    cpu_s = round(float(total(np.array([*spent.values()]))), 3)
    return losses, facts_of_run(experiment, outcome) | {"cpu_s": cpu_s}


_ARRIVAL_RUNS = 20
"""Runs whose arrivals are written, at most."""
_ARRIVAL_ROWS = 20_000
"""Arrivals that are written at most, unless the first run alone has more: git keeps the file."""


def _arrival_rows(experiment: Experiment, outcome: Outcome) -> Iterator[Row]:
    """Yield a row for each measurement of the first runs, with the step at which it arrives.

    Steps have the numbers of per_step.csv. The last cell is empty if the run ends before the arrival.
    """
    delayed = [i for i, point in enumerate(experiment.points) if point.scenario.longest_delay]
    for i in delayed:
        point = experiment.points[i]
        good = [key for key in outcome.plan.tasks if key[0] == i and key not in outcome.failures]
        if not good:
            continue
        steps = point.scenario.steps[1:].tolist()
        sensors = rows_of(cast(Sensors, point.scenario.true_sensor))
        rows_of_a_run = len(steps) * len(sensors) * len(delayed)
        runs = min(max(_ARRIVAL_ROWS // rows_of_a_run, 1), _ARRIVAL_RUNS)
        # All filters of a point get the same data: those of the first one's blocks.
        for task in outcome.plan.tasks[good[0]]:
            if task.first_run >= runs or task.data.arrival is None:
                break
            for m in range(min(task.runs_used, runs - task.first_run)):
                head = [*point.values.values(), task.first_run + m]
                for n, rows in enumerate(sensors):
                    is_measured = ~np.isnan(task.data.measurements[rows, :, m]).all(axis=0)
                    arrivals = task.data.arrival[n, :, m].tolist()
                    for j in np.flatnonzero(is_measured).tolist():
                        arrived = steps[arrivals[j]] if arrivals[j] < len(steps) else ""
                        yield [*head, n + 1, steps[j], arrived]


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
        digits = _digits_of_runs(self._experiment, key)
        self._add_runs(self._head(point, label), result.per_run, digits)
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
            for name in [name for name in settings.exact if name in point.filters]:
                tracker, assume = point.filters[name], point.assumed.get(name)
                task = BlockTask(
                    scenario, tracker, 0, 0, 1, 1, assume=assume, hold_out=settings.hold_out
                )
                summary, steps = exact_rows(exact_series(task), sizes(scenario), scenario.windows)
                label = exact_label(name)
                self._add_summary(i, label, [r._replace(stderr=np.nan, runs=0) for r in summary])
                self._add_steps(i, label, map(_without_runs, steps))

    def _add_runs(self, head: str, per_run: dict[str, Array], digits: int) -> None:
        """Add rows of per_run.csv, a metric at a time: for their number `csv` is too slow."""
        stored = stored_metrics(self._experiment.settings, "per_run.csv")
        for metric, values in per_run.items():
            if is_stored(stored, measured(metric).base):
                texts = _texts(values, digits)
                name = cells([metric])
                lines = [f"{head},{run},{name},{x}\n" for run, x in enumerate(texts)]
                self._writers["per_run.csv"].write("".join(lines))

    def _add_steps(self, point: int, label: str, columns: Iterable[StepColumns]) -> None:
        """Add rows of per_step.csv, a series at a time: all metrics of a step, then the next step."""
        file, head = "per_step.csv", self._head(point, label)
        scenario = self._experiment.points[point].scenario
        stored = stored_metrics(self._experiment.settings, file)
        digits = DIGITS[file]
        times = zip(scenario.steps.tolist(), _texts(scenario.times, digits), strict=True)
        heads = np.array([f"{head},{step},{time}" for step, time in times], dtype=object)
        for of_series in columns:
            lines: list[list[str]] = []
            at = heads[of_series.positions].tolist()
            runs = _texts(of_series.runs, digits)
            for metric, estimates in of_series.metrics.items():
                if is_stored(stored, measured(metric).base):
                    name, value, stderr = cells([metric]), *(_texts(x, digits) for x in estimates)
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


def _digits_of_runs(experiment: Experiment, key: Key) -> int:
    """Return the significant digits of a filter's values per run.

    Printed numbers of as many digits are compared digit by digit if nothing is random.
    """
    point = experiment.points[key[0]]
    label = key[1]
    is_random = point.scenario.recorded_runs is None or not point.filters[label].deterministic
    of_filter = [number for number in experiment.published.numbers if label in number.labels]
    longest = max((number.significant_digits for number in of_filter), default=0)
    usual = DIGITS["per_run.csv"]
    return usual if is_random or longest < usual else EXACT_DIGITS


def _texts(values: Array | Index, digits: int) -> list[str]:
    """Write numbers with so many significant digits."""
    bits = np.ascontiguousarray(values).view(f"u{values.itemsize}")
    if len(values) > 1 and (bits == bits[0]).all():
        return _texts(values[:1], digits) * len(values)
    if values.dtype.kind != "f":
        return [str(x) for x in values.tolist()]
    return shortened(values.tolist(), digits)


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
