"""Options of a command, and its configs as jobs, validated before anything runs."""

import csv
import json
import os
import stat
import sys
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from math import ceil, nan
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from trackbench.commands.keyword_arguments import check_keywords
from trackbench.config import load as configurations
from trackbench.config.dump import as_yaml, data_from_python, resolved
from trackbench.config.experiment import Experiment
from trackbench.config.python_tables import name_rows
from trackbench.config.shipped_experiments import files as shipped_files
from trackbench.config.shipped_experiments import listed, located
from trackbench.config.tuned_entries import Chosen
from trackbench.durations import expected_time_in_words
from trackbench.errors import Mark, Problem, UserError, few_names, reason
from trackbench.evaluation.block import BlockTask
from trackbench.evaluation.precision_check import checkpoints
from trackbench.evaluation.trial import estimate_cpu_s
from trackbench.execution.cache import BlockStore, cache_folder
from trackbench.execution.engines import Engine, cpu_count, engine
from trackbench.execution.plan import Key, Plan, announced, check_memory, make_plan
from trackbench.execution.stop_when_precise import first_batch
from trackbench.models.description import sensor_places
from trackbench.plugins.errors import guarded
from trackbench.report.sweep_files import as_sweep
from trackbench.results.folder_contents import DERIVED_FILES, RUN_FILES, TIMING, read_manifest
from trackbench.tuning.search import Record
from trackbench.tuning.tuner import Training, tune
from trackbench.yaml_source import Assembled, Config, read


@dataclass(frozen=True, kw_only=True)
class Options:
    """Options of a run. Those from `out` on, but `filters`, change no number."""

    set: Sequence[str] = ()
    """values for keys of the config, each as `PATH=VALUE`"""
    only: Sequence[str] = ()
    """labels of the filters that run; default: all"""
    measurements: Any = None
    """recorded measurements, in place of those in a file: a data frame, a mapping of columns, an array
    `(steps, n_z)` or `(runs, steps, n_z)`, or a list with one of these for each sensor"""
    truth: Any = None
    """true states that belong to `measurements`: a data frame, a mapping of columns, or an array
    `(steps, n_x)` or `(runs, steps, n_x)`"""
    runs: int | None = None
    """number of Monte Carlo runs; default: that of the config"""
    quick: bool = False
    """20 runs, or all recordings if there are fewer; `runs` sets another number"""
    seed: int | None = None
    """seed of all random numbers; default: that of the config"""
    grid: Sequence[str] = ()
    """values of keys, each as `PATH=V1,V2,...`, `PATH=a..b:n` or `PATH=log:a..b:n`; the experiment runs
    at all of them; an error if the config has the key `tune`"""
    product: bool = False
    """if `grid` has keys of several filters, run every combination of their values; by default the
    filters vary one after the other, while each other filter keeps the first of its values"""
    out: Path | str | None = None
    """results folder, by default `results/NAME`, and of `sweep` `results/NAME-sweep`; if several
    experiments run, the folder in which each of them gets a results folder"""
    engine: Engine = "processes"
    """where blocks are computed: `processes`, `serial` or `dask`"""
    workers: int | None = None
    """number of worker processes; default: one for each processor"""
    scheduler: str | None = None
    """address of a dask cluster, `tcp://host:port`"""
    fresh: bool = False
    """compute and draw everything again, in place of reading it from the cache"""
    times: bool = True
    """measure CPU times again after the runs, with the filters in turns; this is done only if a table, a
    figure, a published number or a claim needs CPU times; with `False` the CPU times are those measured
    while the blocks were computed"""
    save_tracks: bool = False
    """write the truth, measurements and estimates of every run to `tracks.npz`"""
    formats: Sequence[str] = ("png", "svg")
    """formats of figures and tables: `png`, `svg`, `pdf`, `tex`"""
    allow_plugins: bool = False
    """run the code of the config's plugins"""
    filters: Sequence[Path | str] = ()
    """Python files whose filters run beside those of the config, each labelled with the
    `kind` that its class registers; you permit the code of these files to run, even without
    `allow_plugins`"""
    quiet: bool = False
    """print no progress and no notes"""
    spare: bool = False
    """if the results folder has results of more runs, keep them and write to `NAME-quick/` beside it"""
    shard: str = ""
    """`i/n`: compute the i-th of n parts of the blocks into the cache, and write no results; only for
    `run_all`"""

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
            overrides=options.set,
            only=options.only,
            runs=options.runs,
            seed=options.seed,
            grid=options.grid,
            product=options.product,
            allow_plugins=options.allow_plugins,
            tuned_values=tuned,
            filter_files=[Path(file) for file in options.filters],
            quick=options.quick,
            tables={key: table for key, table in tables.items() if table is not None},
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
    """trials of tuning, by label"""


def jobs_of(
    configs: Sequence[Config], options: Options, validated: Sequence[Experiment] = ()
) -> list[Job]:
    """Prepare a job for each config; raises UserError with the mistakes of all of them.

    ``validated`` are the experiments of the configs with these options, where a suite has them already.
    """
    jobs: list[Job] = []
    problems: dict[Problem | str, None] = {}
    for i, config in enumerate(configs):
        try:
            experiment = validated[i] if validated else prepare(config, options)
            job = _prepare_job(config, experiment, options, is_only_config=len(configs) == 1)
        except UserError as error:
            problems |= dict.fromkeys(error.problems)
            continue
        if job.folder in [other.folder for other in jobs]:
            mark = job.experiment.source.mark(("name",))
            message = f"another config of this command writes into {job.folder}/, too"
            problems[Problem(mark, "name", message)] = None
        jobs.append(job)
    if not _may_write(cache_folder()) and _has_blocks_to_store(jobs, options):
        message = "may not be written in; finished blocks are kept where TRACKBENCH_CACHE says"
        problems[Problem(Mark(f"{cache_folder()}/"), "", message)] = None
    if problems:
        raise UserError(*problems)
    return jobs


def _has_blocks_to_store(jobs: Sequence[Job], options: Options) -> bool:
    """Test whether a run would write blocks into the cache."""
    if options.fresh:
        return True
    store = BlockStore(cache_folder())

    def misses_block(job: Job) -> bool:
        return any(store.get(task) is None for task in job.plan.unique)

    return any(misses_block(job) for job in jobs)


def _prepare_job(
    config: Config, experiment: Experiment, options: Options, is_only_config: bool
) -> Job:
    """Choose the results folder of an experiment, and plan its first batch of runs.

    The option ``out`` is the results folder of an only config. Of several configs it contains their
    folders.
    """
    if options.grid:
        omitted_figures = list(experiment.settings.figures)
        experiment = as_sweep(experiment)
        if omitted_figures:
            names = ", ".join(omitted_figures)
            say(f"note: a sweep draws figures over its keys, not the config's ({names})", options)
    # Step 1: its folder.
    folder = Path("results" if options.out is None else options.out)
    if options.out is None or not is_only_config:
        # The folder is named after the experiment and the files of its additional filters.
        words = [experiment.settings.name]
        if options.filters:
            words.append("with")
            words += [Path(file).stem for file in options.filters]
        folder /= "-".join(words)
    if options.spare:
        # A quick run leaves results of more runs as they are.
        stored_runs = _stored_runs(folder)
        if stored_runs > experiment.settings.runs:
            say(f"note: {folder}/ has {stored_runs} runs and stays; --force replaces them", options)
            folder = folder.with_name(f"{folder.name}-quick")
    # Data files from Python are also written into the folder.
    _check_out(folder, data_from_python(experiment, folder))
    # Step 2: the plan.
    check_memory(experiment, options.save_tracks)
    most_runs = experiment.settings.runs
    plan = plan_of(experiment, most_runs, options)
    workers = min(most_workers(options), len(plan.unique))
    stored_blocks = 0
    if not options.fresh and not experiment.tuned:  # a tuned filter has other keys
        store = BlockStore(cache_folder())
        stored_blocks = sum(store.has_file(task) for task in plan.unique)
    first = first_batch(experiment)
    return Job(
        config=config,
        experiment=first,
        folder=folder,
        plan=plan_of(first, most_runs, options),
        line=announced(experiment, plan, workers, stored_blocks),
        most=most_runs,
    )


def expected_time(job: Job, options: Options, tries: bool = True) -> str:
    """Write how long the filters will take for the missing blocks, in words.

    The estimate is made from stored results of the same scenario and filters. Without such results each
    filter is timed over the beginning of a block, if ``tries``. Simulation, errors, tables and figures
    take further time.
    """
    # Step 1: CPU time of the missing blocks.
    missing = _missing_blocks(job.plan.unique, options)
    if not missing:
        return CACHED
    cost = _cost_in_folder(job, missing) or _cost_of_shipped(job, options, missing)
    basis = ""
    if cost is None and tries:
        cost = _cost_by_trial(job, missing)
        basis = ", by a trial of the first steps"
    if cost is None:
        return "time unknown: no results of the same scenario and filters are stored"
    # Step 2: time on all workers. The plan has the first batch of runs, and `until` may continue up to
    # ``job.most`` runs. The filters take at least as long as their longest block.
    workers = min(most_workers(options), len(job.plan.unique))
    seconds = cost.cpu_s * job.most / job.experiment.settings.runs / workers
    seconds = max(seconds, cost.longest_block_s)
    about = "at most about" if cost.is_bound else "about"
    return f"{about} {expected_time_in_words(seconds)} of filtering{basis}"


def expected_time_of_tuning(job: Job, options: Options) -> str:
    """Write how long tuning will take at most, in words.

    The text is empty if the time is unknown or too short to matter. Each tuned filter is timed over the
    beginning of its first trial, unless that trial is stored. The trials of a filter mostly follow each
    other, those of several filters run on all workers.
    """
    experiment = job.experiment
    if not experiment.tuned or len(experiment.tuned) > _MOST_TRIALS:
        return ""
    workers = most_workers(options)
    all_cpu_s = 0.0
    longest_s = 0.0
    for label in experiment.tuned:
        tasks = Training(experiment, label).first_tasks
        if not _missing_blocks(tasks, options) or tasks[0].filter.runs_program:
            continue
        block_s = _block_s_by_trial(tasks[0])
        if block_s is None:
            return ""
        trials = experiment.settings.tuning.evaluations
        all_cpu_s += trials * len(tasks) * block_s
        longest_s = max(longest_s, trials * ceil(len(tasks) / workers) * block_s)
    seconds = max(all_cpu_s / workers, longest_s)
    if seconds < _SHORT_TUNING_S:
        return ""
    return f"at most about {expected_time_in_words(seconds)} of tuning"


_SHORT_TUNING_S = 10.0
"""Seconds of tuning below which nothing is said about its time."""


def dry_run_line(job: Job, time: str) -> str:
    """Return what a dry run prints of a job: its size, state and measurement, and the expected time.

    A filter with components of its own may run on the problem only if it has these names. Places of
    sensors are printed unless all are the origin.
    """
    model = job.experiment.points[0].scenario.model
    motion, sensor = model
    names = f"state {few_names(motion.components)}, measurement {few_names(sensor.components)}"
    places = sensor_places(model)
    is_elsewhere = any(any(place) for place in places)
    if is_elsewhere:
        texts = []
        for place in places:
            numbers = ", ".join(f"{number:g}" for number in place)
            texts.append(f"[{numbers}]")
        noun = "sensor" if len(places) == 1 else "sensors"
        names += f", {noun} at {few_names(texts)}"
    return f"{job.line} ({names}); {time}"


CACHED = "every block is in the cache"
"""Time of a job whose blocks are all kept."""


_SIMILAR_RATIO = 1.2
"""Ratio of two filters' shares of work below which one share stands for both."""


class _Cost(NamedTuple):
    """CPU seconds of blocks."""

    cpu_s: float
    is_bound: bool
    """whether the blocks may take less, such as those that are wider than the stored ones"""
    longest_block_s: float = 0.0
    """CPU seconds of the block that takes longest, if that is known"""


def _cost_in_folder(job: Job, missing: Sequence[BlockTask]) -> _Cost | None:
    """Estimate the CPU time of the missing blocks from the times in the results folder.

    None if the folder is not of the same scenario and filters. The estimate is a bound if a stored block
    has fewer runs than a missing one, as wide blocks take less time per run.
    """
    config = resolved(job.experiment, job.folder)
    grid = job.experiment.settings.grid
    with suppress(OSError, UserError, ValueError, LookupError, TypeError):
        # Step 1: the folder must be of the same scenario and filters.
        read_manifest(job.folder)
        stored_config = read(job.folder / "config.yaml").data
        for key in _KEYS_OF_TIME:
            if as_yaml({key: stored_config.get(key)}) != as_yaml({key: config.get(key)}):
                return None
        # Step 2: the times, by the grid's values and the filter's label.
        with (job.folder / TIMING).open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
        if not rows:
            return None
        times = {}
        for row in rows:
            times[(*(row[path] for path in grid), row["filter"])] = row
        # Step 3: scale them.
        cpu_s = 0.0
        is_bound = False
        for (point_number, label), task in _filter_passes(job.plan, missing):
            values = job.experiment.points[point_number].values.values()
            # A filter that failed has no time, and will fail again.
            time = times.get((*(str(value) for value in values), label))
            if time is not None:
                computed_runs = int(time["runs"])
                cpu_s += float(time["cpu_s"]) / computed_runs * task.width
                is_bound = is_bound or computed_runs < task.width
        return _Cost(cpu_s=cpu_s, is_bound=is_bound)
    return None


def _filter_passes(plan: Plan, missing: Sequence[BlockTask]) -> Iterator[tuple[Key, BlockTask]]:
    """Yield the missing blocks with the point and filter of each.

    Several blocks may share one pass of the filter over its data: the first one is yielded.
    """
    missing_tasks = set(missing)
    filtering_keys: set[BlockTask] = set()
    for key, tasks in plan.tasks.items():
        for task in tasks:
            if task in missing_tasks and task.filtering_key not in filtering_keys:
                filtering_keys.add(task.filtering_key)
                yield key, task


def _cost_of_shipped(job: Job, options: Options, missing: Sequence[BlockTask]) -> _Cost | None:
    """Estimate the CPU time of the missing blocks from the known time of a shipped experiment.

    None if the config is no shipped experiment, or is changed by options. The known time is that of all
    filters together. It is scaled by the largest ratio, over filters and points of the grid, of missing
    blocks to shipped ones. The estimate is a bound unless the ratios are similar.
    """
    # `--quick` sets FIT, the override block=fit, which changes no filter.
    is_changed = options.grid or options.only or any(word != FIT for word in options.set)
    if isinstance(job.config, Mapping | Assembled) or is_changed:
        return None
    with suppress(UserError):
        path = located(Path(job.config), lambda line: None)
        shipped_file = shipped_files().get(path.stem)
        if shipped_file is None or not path.samefile(shipped_file):
            return None
        cpu_s_by_name = {shipped.name: shipped.cpu_s for shipped in listed()}
        cpu_s = cpu_s_by_name.get(path.stem)
        if cpu_s is None:
            return None
        shipped_runs = int(read(path).data.get("runs", 1))
        missing_tasks = set(missing)
        ratios = []
        for tasks in job.plan.tasks.values():  # the blocks of one filter at one point of the grid
            shipped_blocks = ceil(shipped_runs / tasks[0].width)
            ratios.append(len(missing_tasks.intersection(tasks)) / shipped_blocks)
        is_bound = max(ratios) > _SIMILAR_RATIO * min(ratios)
        return _Cost(cpu_s=cpu_s * max(ratios), is_bound=is_bound)
    return None


def _cost_by_trial(job: Job, missing: Sequence[BlockTask]) -> _Cost | None:
    """Estimate the CPU time of the missing blocks by a trial of each filter's first missing block.

    None if there are too many filters for a short trial, if a filter fails, or if it is a program.
    """
    passes: dict[Key, list[BlockTask]] = {}
    for key, task in _filter_passes(job.plan, missing):
        passes.setdefault(key, []).append(task)
    if len(passes) > _MOST_TRIALS:
        return None
    cpu_s = 0.0
    longest_block_s = 0.0
    for tasks in passes.values():
        if tasks[0].filter.runs_program:
            return None
        block_s = _block_s_by_trial(tasks[0])
        if block_s is None:
            return None
        cpu_s += block_s * len(tasks)
        longest_block_s = max(longest_block_s, block_s)
    return _Cost(cpu_s=cpu_s, is_bound=False, longest_block_s=longest_block_s)


def cpu_s_of_filter(job: Job, label: str, options: Options, tries: bool) -> tuple[float, float]:
    """Estimate the CPU seconds that one filter takes for its missing blocks, and the size of its work.

    The size is the number of runs times steps of the missing blocks. The seconds are found by a trial if
    ``tries``, and NaN without a trial or if the filter fails in it.
    """
    tasks: list[BlockTask] = []
    for (_, name), tasks_of_point in job.plan.tasks.items():
        if name == label:
            tasks += tasks_of_point
    missing = _missing_blocks(tasks, options)
    if not missing:
        return 0.0, 0.0
    size = sum(task.width * len(task.scenario.steps) for task in missing)
    block_s = None
    if tries:
        block_s = _block_s_by_trial(missing[0])
    if block_s is None:
        return nan, size
    return block_s * len(missing), size


def _missing_blocks(tasks: Sequence[BlockTask], options: Options) -> list[BlockTask]:
    """List the blocks that a run with these options would compute."""
    if options.fresh:
        return list(tasks)
    store = BlockStore(cache_folder())
    return [task for task in tasks if not store.has_file(task)]


def _block_s_by_trial(task: BlockTask) -> float | None:
    """Estimate the CPU seconds of a block by a trial of its first steps; None if the filter fails."""
    try:
        with guarded():
            return estimate_cpu_s(task)
    except Exception:  # of a plugin: the run itself, or tuning, will report it
        return None


_MOST_TRIALS = 40
"""Largest number of filters, over all points of the grid, that a dry run tries.

A trial takes some 0.3 s.
"""
FIT = "block=fit"
"""Override of `--quick`: equal blocks of fewer runs, which change no filter."""
_KEYS_OF_TIME = ("scenario", "filters", "grid", "only")
"""Keys of a config that its time depends on, apart from the runs."""


def plan_of(experiment: Experiment, most: int, options: Options) -> Plan:
    """Plan an experiment of at most ``most`` runs, which `until` may end earlier."""
    settings = experiment.settings
    stops = []
    if settings.until:
        stops = list(checkpoints(settings.min_runs, most))
    return make_plan(experiment, options.save_tracks, stops)


def with_tuned(job: Job, options: Options) -> Job:
    """Tune on training runs; return the job with the tuned values."""
    workers = most_workers(options)
    store = BlockStore(cache_folder())
    open_engine = engine(options.engine, workers, options.scheduler)
    tuning = tune(
        job.experiment,
        store,
        open_engine,
        workers,
        fresh=options.fresh,
        progress=not options.quiet,
    )
    tuned_values = {label: record.best.values for label, record in tuning.items()}
    experiment = first_batch(prepare(job.config, options, tuned_values))
    plan = plan_of(experiment, job.most, options)
    return job._replace(experiment=experiment, plan=plan, tuning=tuning)


def most_workers(options: Options) -> int:
    """Limit the number of workers."""
    if options.engine == "serial":
        return 1
    return options.workers or cpu_count()


def most_drawers(options: Options) -> int:
    """Limit the number of processes that draw figures to those that compute on this machine."""
    if options.engine == "processes":
        return most_workers(options)
    return 1


def say(text: str, options: Options) -> None:
    """Print a line for the user unless ``quiet``."""
    if not options.quiet:
        print(text, file=sys.stderr)


def _check_out(folder: Path, data: Collection[str]) -> None:
    """Raise UserError if a run cannot write into the results folder, or would replace foreign files.

    ``data`` names the data files that the run writes.
    """
    for path in (folder, *folder.parents):
        message = ""
        try:
            if not stat.S_ISDIR(path.stat().st_mode):
                message = f"{path} is a file, not a folder"
        except (FileNotFoundError, NotADirectoryError):
            if path.is_symlink():
                message = f"{path} is a link to nothing"
        except OSError as error:
            message = f"{path}: {reason(error)}"
        if message:
            raise UserError(Problem(Mark(f"--out {folder}"), "", message))
    foreign_file = _foreign_file(folder, data)
    if foreign_file is not None:
        message = "no run wrote this file, and this run would replace it; choose another --out"
        raise UserError(Problem(Mark(str(foreign_file)), "", message))
    if not _may_write(folder):
        message = "may not be written in; another folder: --out DIR"
        raise UserError(Problem(Mark(f"{folder}/"), "", message))


def _stored_runs(folder: Path) -> int:
    """Count the runs of the results in a folder; 0 without results."""
    with suppress(OSError, ValueError, LookupError, TypeError):
        return int(json.loads((folder / "manifest.json").read_bytes())["runs"])
    return 0


def _foreign_file(folder: Path, data: Collection[str]) -> Path | None:
    """Find a file that a run would replace in a folder that no run has written; None without one.

    ``data`` names the data files that the run writes. A folder is one of a run, even of a killed one, if
    it has a manifest or points.json. A config.yaml as runs write it may be replaced.
    """
    if any((folder / name).exists() for name in ("manifest.json", "points.json")):
        return None
    for name in ("config.yaml", *data, *RUN_FILES, *DERIVED_FILES):
        path = folder / name
        if not path.is_file():
            continue
        is_config_of_run = name == "config.yaml" and _is_written_by_run(path)
        if not is_config_of_run:
            return path
    return None


def _is_written_by_run(config: Path) -> bool:
    """Test whether a config has the form in which runs write theirs."""
    with suppress(OSError, UserError, ValueError, LookupError):
        text = config.read_text(encoding="utf-8")
        return as_yaml(read(config).data) == text
    return False


def _may_write(folder: Path) -> bool:
    """Test whether the folder, or its first existing parent, is writable."""
    first_existing = folder
    for path in (folder, *folder.absolute().parents):
        if path.exists():
            first_existing = path
            break
    return os.access(first_existing, os.W_OK | os.X_OK)
