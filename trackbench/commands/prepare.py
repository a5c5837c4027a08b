"""Options of a command, and its configs as jobs, validated before anything runs."""

import csv
import json
import os
import stat
import sys
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from itertools import chain
from math import ceil
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from trackbench.commands import check_keywords
from trackbench.config import load as configurations
from trackbench.config.dump import as_yaml, data_from_python, resolved
from trackbench.config.experiment import Experiment
from trackbench.config.python_tables import name_rows
from trackbench.config.shipped_experiments import folder as shipped_folder
from trackbench.config.shipped_experiments import listed, located
from trackbench.config.tuned_entries import Chosen
from trackbench.errors import Mark, Problem, UserError, reason
from trackbench.evaluation.block import BlockTask
from trackbench.evaluation.precision_check import checkpoints
from trackbench.execution.cache import BlockStore, cache_folder
from trackbench.execution.engines import Engine, cpu_count, engine
from trackbench.execution.plan import Key, Plan, announced, check_memory, make_plan
from trackbench.execution.runner import first_batch
from trackbench.report.sweep import as_sweep
from trackbench.results.folder_contents import DERIVED_FILES, RUN_FILES, TIMING, read_manifest
from trackbench.tuning.search import Record
from trackbench.tuning.tuner import tune
from trackbench.yaml_source import Assembled, Config, read


@dataclass(frozen=True, kw_only=True)
class Options:
    """Options of a run. Those from `out` on, but `filters`, change no number."""

    set: Sequence[str] = ()
    """overrides of keys, `PATH=VALUE` as on the command line"""
    only: Sequence[str] = ()
    """labels of the filters to be run"""
    measurements: Any = None
    """recorded measurements in place of the target's file: a data frame, a mapping of columns, an array
    (steps, n_z) or (runs, steps, n_z), or a list of them, one for each sensor"""
    truth: Any = None
    """truth of these measurements: a data frame, a mapping of columns, or an array (runs, steps, n_x)"""
    runs: int | None = None
    """Monte Carlo runs"""
    quick: bool = False
    """20 runs unless `runs` says how many, and no more than there are recordings"""
    seed: int | None = None
    """seed of every random number"""
    grid: Sequence[str] = ()
    """grids, `PATH=V1,V2,...`, `a..b:n` or `log:a..b:n`"""
    product: bool = False
    """run every combination of keys of different filters, not one filter after the other"""
    out: Path | str | None = None
    """results folder; of several configs the one that holds theirs; default: results/NAME"""
    engine: Engine = "processes"
    """processes, serial or dask"""
    workers: int | None = None
    """worker processes; default: all processors"""
    scheduler: str | None = None
    """address of a dask cluster, tcp://host:port"""
    fresh: bool = False
    """compute again what is kept from before"""
    times: bool = True
    """measure CPU times where a table, a figure, a published number or a claim names them"""
    save_tracks: bool = False
    """write every run's track to tracks.npz"""
    formats: Sequence[str] = ("png", "svg")
    """of figures and tables: png, svg, pdf, tex"""
    allow_plugins: bool = False
    """run the code of the config's plugins"""
    filters: Sequence[Path | str] = ()
    """Python files whose filters run beside those of the config, each under its kind; their code runs"""
    quiet: bool = False
    """say nothing of the progress"""
    spare: bool = False
    """write to NAME-quick/ if the results folder has results of more runs"""

    shard: str = ""
    """i/n: compute the i-th of n parts of the blocks into the cache, and write no results"""

    def __new__(cls, **options: Any) -> "Options":
        """Return options to initialize; raises UserError for a wrong name."""
        check_keywords("Options", options, [field.name for field in fields(cls)])
        return super().__new__(cls)

    def changed(self, changes: Mapping[str, Any]) -> "Options":
        """Return the options with changes by name; raises UserError for a wrong name."""
        return replace(self, **changes)


OPTION_NAMES = tuple(field.name for field in fields(Options))
"""Names of the options, which Python functions take as keywords."""


def file_of(config: Config, options: Options) -> Path | Mapping[str, Any] | Assembled:
    """Find the path of a config or shipped experiment of this name; other configs stay themselves."""
    if isinstance(config, Mapping | Assembled):
        return config
    return located(Path(config), lambda line: say(line, options))


def prepare(
    config: Config, options: Options, tuned: Mapping[str, Chosen] | None = None
) -> Experiment:
    """Read and validate a config with the options' overrides; ``tuned`` are tuned values."""
    tables = {"measurements": options.measurements, "truth": options.truth}
    try:
        return configurations.load(
            file_of(config, options),
            options.set,
            options.only,
            options.runs,
            options.seed,
            options.grid,
            options.product,
            options.allow_plugins,
            tuned,
            [Path(file) for file in options.filters],
            options.quick,
            {key: table for key, table in tables.items() if table is not None},
        )
    except UserError as error:
        name_rows(error)
        raise


class Job(NamedTuple):
    """An experiment to run, its results folder, and the line that announces it."""

    config: Config
    experiment: Experiment
    folder: Path
    plan: Plan
    line: str
    most: int
    """runs at most"""
    tuning: Mapping[str, Record] = MappingProxyType({})
    """what tuning tried, by label"""


def jobs_of(configs: Sequence[Config], options: Options) -> list[Job]:
    """Prepare a job for each config; raises UserError with the mistakes of all of them."""
    jobs: list[Job] = []
    problems: dict[Problem | str, None] = {}
    for config in configs:
        try:
            job = _job(config, options, alone=len(configs) == 1)
        except UserError as error:
            problems |= dict.fromkeys(error.problems)
            continue
        if job.folder in [other.folder for other in jobs]:
            mark = job.experiment.source.mark(("name",))
            what = f"another config of this command writes into {job.folder}/, too"
            problems[Problem(mark, "name", what)] = None
        jobs.append(job)
    if not _may_write(cache_folder()):
        store = BlockStore(cache_folder())
        tasks = chain.from_iterable(job.plan.unique for job in jobs)
        if options.fresh or any(store.get(task) is None for task in tasks):
            what = "may not be written in; finished blocks are kept where TRACKBENCH_CACHE says"
            problems[Problem(Mark(f"{cache_folder()}/"), "", what)] = None
    if problems:
        raise UserError(*problems)
    return jobs


def _job(config: Config, options: Options, alone: bool) -> Job:
    experiment = prepare(config, options)
    if options.grid:
        experiment = as_sweep(experiment)
    folder = Path("results" if options.out is None else options.out)
    if options.out is None or not alone:
        # The folder is named after the experiment and the files of its additional filters.
        added = ["with", *(Path(file).stem for file in options.filters)] if options.filters else []
        folder /= "-".join([experiment.settings.name, *added])
    if options.spare and (stored := _stored_runs(folder)) > experiment.settings.runs:
        say(f"note: {folder}/ has {stored} runs and stays; --force replaces them", options)
        folder = folder.with_name(f"{folder.name}-quick")
    _check_out(folder, data_from_python(experiment, folder))
    check_memory(experiment, options.save_tracks)
    most = experiment.settings.runs
    plan = plan_of(experiment, most, options)
    workers = min(most_workers(options), len(plan.unique))
    is_new = options.fresh or experiment.tuned  # what is tuned has other keys
    kept = 0 if is_new else sum(map(BlockStore(cache_folder()).has_file, plan.unique))
    line = announced(experiment, plan, workers, kept)
    first = first_batch(experiment)
    return Job(config, first, folder, plan_of(first, most, options), line, most)


def expected_time(job: Job, options: Options) -> str:
    """Estimate the time of the missing blocks from stored results of the same scenario and filters.

    It is that of the filters. Simulation, errors, tables and figures take more.
    """
    store, workers = BlockStore(cache_folder()), min(most_workers(options), len(job.plan.unique))
    missing = [t for t in job.plan.unique if options.fresh or not store.has_file(t)]
    if not missing:
        return CACHED
    cost = _cost_in_folder(job, missing) or _cost_of_shipped(job, options, missing)
    if cost is None:
        return "time unknown: no results of the same scenario and filters are stored"
    # The plan has the first batch of runs, which `until` may continue up to the most.
    seconds = cost.cpu_s * job.most / job.experiment.settings.runs / workers
    bound = "at most " if cost.is_bound else ""
    return f"{bound}about {duration(seconds)} of filtering"


CACHED = "every block is in the cache"
"""Time of a job whose blocks are all kept."""


def duration(seconds: float) -> str:
    """Write a duration with two digits in hours, minutes or seconds, at least one second."""
    for size, unit in _LONG:
        if seconds >= 2 * size:
            return f"{_two_digits(seconds / size)} {unit}"
    return f"{_two_digits(max(seconds, 1.0))} s"


_LONG = ((3600, "h"), (60, "min"))
_SIMILAR = 1.2
"""Ratio of two filters' shares of work below which one share stands for both."""


def _two_digits(number: float) -> str:
    """Round to two digits, and write a larger number without an exponent."""
    return f"{float(f'{number:.2g}'):g}"


class _Cost(NamedTuple):
    """CPU seconds of blocks."""

    cpu_s: float
    is_bound: bool
    """whether the blocks may take less, such as those that are wider than the stored ones"""


def _cost_in_folder(job: Job, missing: Sequence[BlockTask]) -> _Cost | None:
    """Scale the times of each filter's blocks in the results folder to the missing blocks.

    A block is computed whole: one run that is stored may have taken the time of 500.
    """
    wanted = resolved(job.experiment, job.folder)
    grid = job.experiment.settings.grid
    with suppress(OSError, UserError, ValueError, LookupError, TypeError):
        read_manifest(job.folder)
        stored = read(job.folder / "config.yaml").data
        if any(as_yaml({k: stored.get(k)}) != as_yaml({k: wanted.get(k)}) for k in _SAME):
            return None
        with (job.folder / TIMING).open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
        times = {(*(row[path] for path in grid), row["filter"]): row for row in rows}
        cpu_s = 0.0
        is_bound = False
        for (i, label), task in _passes(job.plan, missing):
            values = map(str, job.experiment.points[i].values.values())
            # A filter that failed has no time, and will fail again.
            row = times.get((*values, label))
            if row is not None:
                computed_runs = int(row["runs"])
                cpu_s += float(row["cpu_s"]) / computed_runs * task.width
                is_bound = is_bound or computed_runs < task.width
        return _Cost(cpu_s, is_bound) if times else None
    return None


def _passes(plan: Plan, missing: Sequence[BlockTask]) -> Iterator[tuple[Key, BlockTask]]:
    """Yield the missing tasks of each filter; tasks that share the filter's estimates count once."""
    wanted = set(missing)
    passes = set[BlockTask]()
    for key, tasks in plan.tasks.items():
        for task in tasks:
            if task in wanted and task.filtering_key not in passes:
                passes.add(task.filtering_key)
                yield key, task


def _cost_of_shipped(job: Job, options: Options, missing: Sequence[BlockTask]) -> _Cost | None:
    """Scale the time of the shipped experiment, of all filters together, to the missing blocks.

    The filter that has most to do scales it, so that others may need less.
    """
    is_changed = options.grid or options.only or any(w != FIT for w in options.set)
    if isinstance(job.config, Mapping | Assembled) or is_changed:
        return None
    with suppress(UserError):
        path = located(Path(job.config), lambda line: None)
        for shipped in listed() if path.parent.samefile(shipped_folder()) else []:
            if shipped.name == path.stem and shipped.cpu_s is not None:
                shipped_runs = int(read(path).data.get("runs", 1))
                wanted = set(missing)
                ratios = list[float]()
                for tasks in job.plan.tasks.values():
                    shipped_blocks = ceil(shipped_runs / tasks[0].width)
                    ratios.append(len(wanted.intersection(tasks)) / shipped_blocks)
                is_bound = max(ratios) > _SIMILAR * min(ratios)
                return _Cost(shipped.cpu_s * max(ratios), is_bound)
    return None


FIT = "block=fit"
"""Override of `--quick`, which changes no filter."""
_SAME = ("scenario", "filters", "grid", "only")


def plan_of(experiment: Experiment, most: int, options: Options) -> Plan:
    """Plan an experiment of at most ``most`` runs, which `until` may end earlier."""
    settings = experiment.settings
    stops = list(checkpoints(settings.min_runs, most)) if settings.until else []
    return make_plan(experiment, options.save_tracks, stops)


def with_tuned(job: Job, options: Options) -> Job:
    """Tune on training runs; return the job with the tuned values."""
    workers, store = most_workers(options), BlockStore(cache_folder())
    open_engine = engine(options.engine, workers, options.scheduler)
    tuning = tune(job.experiment, store, open_engine, workers, options.fresh, not options.quiet)
    tuned = {label: record.best.values for label, record in tuning.items()}
    experiment = first_batch(prepare(job.config, options, tuned))
    plan = plan_of(experiment, job.most, options)
    return job._replace(experiment=experiment, plan=plan, tuning=tuning)


def most_workers(options: Options) -> int:
    """Limit the number of workers."""
    return 1 if options.engine == "serial" else options.workers or cpu_count()


def most_drawers(options: Options) -> int:
    """Limit the number of processes that draw figures to those that compute on this machine."""
    return most_workers(options) if options.engine == "processes" else 1


def say(text: str, options: Options) -> None:
    """Print a line for the user unless ``quiet``."""
    if not options.quiet:
        print(text, file=sys.stderr)


def _check_out(folder: Path, data: Collection[str]) -> None:
    """Raise UserError if the results folder's path is taken by something else."""
    for path in (folder, *folder.parents):
        try:
            bad = "" if stat.S_ISDIR(path.stat().st_mode) else f"{path} is a file, not a folder"
        except (FileNotFoundError, NotADirectoryError):
            bad = f"{path} is a link to nothing" if path.is_symlink() else ""
        except OSError as error:
            bad = f"{path}: {reason(error)}"
        if bad:
            raise UserError(Problem(Mark(f"--out {folder}"), "", bad))
    if (foreign := _foreign_file(folder, data)) is not None:
        what = "no run wrote this file, and this run would replace it; choose another --out"
        raise UserError(Problem(Mark(str(foreign)), "", what))
    if not _may_write(folder):
        what = "may not be written in; another folder: --out DIR"
        raise UserError(Problem(Mark(f"{folder}/"), "", what))


def _stored_runs(folder: Path) -> int:
    """Count the runs of the results in a folder; 0 without results."""
    with suppress(OSError, ValueError, LookupError, TypeError):
        return int(json.loads((folder / "manifest.json").read_bytes())["runs"])
    return 0


def _foreign_file(folder: Path, data: Collection[str]) -> Path | None:
    """Find a file that a run would replace in a folder that no run has written.

    A run that was killed has left a manifest, its points, or its config alone.
    """
    if any((folder / name).exists() for name in ("manifest.json", "points.json")):
        return None
    for name in ("config.yaml", *data, *RUN_FILES, *DERIVED_FILES):
        path = folder / name
        if path.is_file() and not (name == "config.yaml" and _is_written(path)):
            return path
    return None


def _is_written(config: Path) -> bool:
    """Test whether a config has the form in which runs write theirs."""
    with suppress(OSError, UserError, ValueError, LookupError):
        text = config.read_text(encoding="utf-8")
        return as_yaml(read(config).data) == text
    return False


def _may_write(folder: Path) -> bool:
    """Test whether the folder, or its first existing parent, is writable."""
    existing = next((f for f in (folder, *folder.absolute().parents) if f.exists()), folder)
    return os.access(existing, os.W_OK | os.X_OK)
