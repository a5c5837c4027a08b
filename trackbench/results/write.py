"""Write the files of a run into a results folder, each whole or not at all."""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from trackbench.atomic_files import (
    CsvWriter,
    Row,
    atomic_write,
    cells,
    ensure_folder,
    shortened,
    within,
    write_text,
)
from trackbench.config.dump import as_yaml, resolved
from trackbench.config.experiment import Experiment
from trackbench.config.metric_names import is_stored, stored_metrics
from trackbench.config.requested_metrics import Contributions, requested_contributions
from trackbench.core.sums import total
from trackbench.evaluation.block import BlockTask
from trackbench.evaluation.consistency import sizes
from trackbench.evaluation.error_series import LOST_BECAUSE, NOT_FINITE
from trackbench.evaluation.exact_errors import exact_label, exact_series
from trackbench.evaluation.merge import FilterResult
from trackbench.evaluation.metric_expression import measured
from trackbench.evaluation.run_contributions import with_shares
from trackbench.evaluation.statistics import Estimate, median
from trackbench.evaluation.summary import (
    StepRow,
    bound_steps,
    bound_summary,
    exact_rows,
    step_rows,
    summary_rows,
)
from trackbench.evaluation.timing import Measured
from trackbench.execution.plan import Key
from trackbench.execution.runner import Outcome
from trackbench.results.folder_contents import COLUMNS, DIGITS, TIMING, remove_outputs
from trackbench.results.manifest import facts_of_run
from trackbench.results.point_facts import POINTS_FILE, points_text
from trackbench.results.tracks import FigureTracks, TrackFile
from trackbench.scenarios.base import Scenario


class TimedRow(NamedTuple):
    """A metric at one step, with the step's number and time, s."""

    step: int
    time: float
    metric: str
    value: float
    stderr: float
    runs: int


class Losses(NamedTuple):
    """Number of runs of one filter, and of the lost ones by reason."""

    runs: int
    by_code: dict[float, int]

    @classmethod
    def of(cls, result: FilterResult) -> "Losses":
        """Count the codes of the metric ``lost``."""
        codes = result.per_run["lost"]
        return cls(len(codes), {code: int((codes == code).sum()) for code in LOST_BECAUSE})

    @property
    def lost(self) -> int:
        """Runs lost for any reason."""
        return sum(self.by_code.values())

    @property
    def is_total(self) -> bool:
        """Return whether no run has finite estimates, so that the filter does not work here."""
        return self.by_code[NOT_FINITE] == self.runs

    def __str__(self) -> str:
        reasons = [f"{n} because {LOST_BECAUSE[code]}" for code, n in self.by_code.items() if n]
        return f"{self.lost} of {self.runs} runs lost, {', '.join(reasons)}"


class Written(NamedTuple):
    """Lost runs of each filter, and the facts for the manifest."""

    losses: dict[Key, Losses]
    facts: dict[str, Any]


def write_results(
    folder: Path,
    experiment: Experiment,
    outcome: Outcome,
    tracks: bool,
    times: Mapping[Key, Measured] = MappingProxyType({}),
) -> Written:
    """Write the files of a run in place of what earlier runs left, from which all others are made.

    ``times`` are measured CPU times. The caller writes the manifest, after all other files.
    """
    published = experiment.published.files
    inputs = {"config.yaml", *(f"published/{name}" for name in published)}
    remove_outputs(folder, keep=inputs)  # the run may read these; they are replaced whole
    write_text(folder / "config.yaml", as_yaml(resolved(experiment, folder)))
    for name, text in published.items():
        write_text(ensure_folder(within(folder, "published")) / name, text)
    write_text(folder / POINTS_FILE, points_text(experiment.points, folder))
    track_files: dict[str, TrackFile] = {"shown.npz": FigureTracks(experiment)}
    if tracks:
        track_files["tracks.npz"] = TrackFile(experiment)
    ensure_folder(within(folder, "run"))
    paths = {name: folder / (TIMING if name == "timing.csv" else name) for name in COLUMNS}
    losses, requested = {}, requested_contributions(experiment)
    spent: dict[BlockTask, float] = {}  # several points may share a filtered block
    with ExitStack() as files:
        writers = {name: _open(files, path, experiment) for name, path in paths.items()}
        for key, result in outcome.results():
            result = _with_shares(experiment, key, result, requested)
            result = result._replace(measured=times.get(key))
            losses[key] = Losses.of(result)
            passes = (task.filtering_key for task in outcome.plan.tasks[key])
            spent.update(zip(passes, (t.cpu_s for t in result.timing), strict=True))
            for name in COLUMNS:
                writers[name].writerows(_filter_rows(experiment, key, name, result))
            _write_runs(writers["per_run.csv"], experiment, key, result)
            for track_file in track_files.values():
                track_file.add(key, result)
        for name, row in _rows_without_runs(experiment):
            writers[name].writerow(row)
    for name, track_file in track_files.items():
        track_file.write(folder / name)
    cpu_s = round(float(total(np.array([*spent.values()]))), 3)
    return Written(losses, facts_of_run(experiment, outcome) | {"cpu_s": cpu_s})


def _with_shares(
    experiment: Experiment, key: Key, result: FilterResult, requested: Contributions
) -> FilterResult:
    """Add each run's share in the requested measures; drop the series that only they need."""
    scenario, settings = experiment.points[key[0]].scenario, experiment.settings
    windows, steps, parts = scenario.windows, scenario.steps.tolist(), sizes(scenario)
    result = with_shares(result, requested.of(key[1], steps), windows, steps, parts)
    series = {name: rows for name, rows in result.run_series.items() if name in settings.medians}
    return result._replace(run_series=series)


def _open(files: ExitStack, path: Path, experiment: Experiment) -> CsvWriter:
    writer = CsvWriter(files.enter_context(atomic_write(path)))
    writer.writerow([*experiment.settings.grid, *COLUMNS[path.name]])
    return writer


def _filter_rows(
    experiment: Experiment, key: Key, name: str, result: FilterResult
) -> Iterator[Row]:
    """Yield one filter's rows of a file, beginning with the values of the grid point."""
    columns, rows = COLUMNS[name], _ROWS[name]
    metrics = stored_metrics(experiment.settings, name)
    if rows is None or (metrics is not None and not metrics):
        return
    if metrics is not None:  # save the summaries that are not written
        per_run = result.per_run.items()
        wanted = {"lost", *metrics}
        result = result._replace(per_run={m: x for m, x in per_run if measured(m).base in wanted})
    prefix = _prefix(experiment, key)
    metric = columns.index("metric") - 1 if "metric" in columns else None
    for row in rows(result, experiment.points[key[0]].scenario):
        if metric is None or is_stored(metrics, measured(row[metric]).base):
            yield [*prefix, *_plain(row, DIGITS.get(name))]


def _prefix(experiment: Experiment, key: Key) -> list[Any]:
    return [*experiment.points[key[0]].values.values(), key[1]]


def _write_runs(writer: CsvWriter, experiment: Experiment, key: Key, result: FilterResult) -> None:
    """Write rows of per_run.csv, a metric at a time: for their number `csv` is too slow."""
    head = cells(_prefix(experiment, key))
    metrics = stored_metrics(experiment.settings, "per_run.csv")
    for metric, values in result.per_run.items():
        if is_stored(metrics, measured(metric).base):
            plain, name = values.tolist(), cells([metric])
            if values.dtype.kind == "f":
                plain = shortened(plain, DIGITS["per_run.csv"])
            writer.write("".join([f"{head},{run},{name},{x}\n" for run, x in enumerate(plain)]))


def _rows_without_runs(experiment: Experiment) -> Iterator[tuple[str, Row]]:
    """Yield files and rows of lower bounds and exact errors, which stand there like a filter's."""
    settings = experiment.settings
    for point in experiment.points:
        scenario, rows = point.scenario, dict[str, tuple[Iterable[Any], Iterable[Any]]]()
        if settings.bound:
            bounds = scenario.bounds()
            rows[settings.bound] = bound_summary(bounds, scenario.windows), bound_steps(bounds)
        for label in settings.exact:
            tracker, assume = point.filters[label], point.assumed.get(label)
            task = BlockTask(
                scenario, tracker, 0, 0, 1, 1, assume=assume, hold_out=settings.hold_out
            )
            means = exact_series(task)
            rows[exact_label(label)] = exact_rows(means, sizes(scenario), scenario.windows)
        for label, found in rows.items():
            for name, of_file in zip(("summary.csv", "per_step.csv"), found, strict=True):
                metrics = stored_metrics(settings, name)
                for row in of_file if name == "summary.csv" else _timed(of_file, scenario):
                    if is_stored(metrics, measured(row.metric).base):
                        plain = _plain(row._replace(stderr=np.nan, runs=0), DIGITS[name])
                        yield name, [*point.values.values(), label, *plain]


def _timed(rows: Iterable[StepRow], scenario: Scenario) -> Iterator[TimedRow]:
    steps, times = scenario.steps.tolist(), scenario.times.tolist()
    for i, metric, value, stderr, runs in rows:
        yield TimedRow(steps[i], times[i], metric, value, stderr, runs)


def _per_step(result: FilterResult, scenario: Scenario) -> Iterable[Row]:
    return _timed(step_rows(result, sizes(scenario)), scenario)


def _summary(result: FilterResult, scenario: Scenario) -> Iterable[Row]:
    return summary_rows(result, sizes(scenario), scenario.windows)


def _timing(result: FilterResult, scenario: Scenario) -> Iterator[Row]:
    """Yield the CPU time of all blocks, and of a run: the median of its measured times, if any."""
    runs = sum(t.runs for t in result.timing)
    cpu_s = sum(t.cpu_s for t in result.timing)
    seconds, *operations = result.measured or ([], None, None)
    of_run = median(np.array(seconds)) if seconds else Estimate(cpu_s / runs, np.nan)
    repeats = ";".join(f"{s:.6g}" for s in seconds)
    yield runs, cpu_s, *of_run, repeats, *("-" if n is None else f"{n:.6g}" for n in operations)


def _plain(row: Row, digits: int | None) -> list[Any]:
    """Convert numpy's numbers to Python's, with so many significant digits unless that is None."""
    plain = (x.item() if isinstance(x, np.generic) else x for x in row)
    if digits is None:
        return list(plain)
    return [float(f"{x:.{digits}g}") if isinstance(x, float) else x for x in plain]


_ROWS: dict[str, Any] = {
    "per_run.csv": None,
    "per_step.csv": _per_step,
    "summary.csv": _summary,
    "timing.csv": _timing,
}
