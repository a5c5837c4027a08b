"""Check that a stored results folder is reproduced, byte for byte.

The first runs are recomputed, and tables, pairs and verdicts are made again from the stored runs. With
all runs, or in a clone, which has digests in place of the runs, everything is recomputed. The core's
arithmetic has equal bytes on every machine, so any difference is a change; its size per filter tells
rounding, of an older version or of a plugin that calls numpy's functions, from another algorithm.

CPU times cannot be recomputed, and figures and report.html depend on the versions of matplotlib and of
this program. The manifest's digests protect these.
"""

import filecmp
import shutil
from collections.abc import Iterator
from contextlib import closing, suppress
from dataclasses import replace
from itertools import chain, takewhile, zip_longest
from math import isfinite
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np

from trackbench import api
from trackbench.config.experiment import Experiment
from trackbench.config.tuning import tuned_label
from trackbench.core.arrays import Array
from trackbench.evaluation.metric_expression import TIME_MEAN, measured
from trackbench.evaluation.run_block import run_whole_block
from trackbench.evaluation.summary import merge
from trackbench.execution.cache import BlockStore, cache_folder
from trackbench.execution.engines import cpu_count, engine
from trackbench.execution.plan import check_memory, make_plan
from trackbench.execution.runner import execute
from trackbench.report.open import (
    IncompleteResultsError,
    changed_files,
    explain_content_errors,
    open_results,
)
from trackbench.report.render import write_tables
from trackbench.report.results import Results
from trackbench.report.sweep import write_sweep
from trackbench.report.verdicts.files import FILES, write_comparison, write_paired
from trackbench.report.verdicts.numbers import compare
from trackbench.results.folder_contents import DATA_FILES, TIME_VERDICTS, check_digests
from trackbench.results.point_facts import POINTS_FILE, points_in, points_text, same_points
from trackbench.results.write import write_results
from trackbench.tuning.search import Rank, Record, Search, Trial, Values
from trackbench.tuning.tuner import Training, given_values, tune

if TYPE_CHECKING:
    import pandas as pd

_TRACKS = ("shown.npz", "tracks.npz")
_NUMBERS = ("value", "stderr")
_FILE = "tuning.csv"


def verify(folder: Path, runs: int, allow_plugins: bool = False) -> list[str]:
    """Recompute so many runs; return what differs, a line each. Raises UserError for no results."""
    try:
        with explain_content_errors(folder):
            results = open_results(folder)
            options = api.Options(allow_plugins=allow_plugins)
            experiment = api.prepare(folder / "config.yaml", options)
            return changed_files(results) + list(_compare(results, experiment, runs))
    except IncompleteResultsError as error:
        return [str(line) for line in error.problems]


def _compare(results: Results, experiment: Experiment, runs: int) -> Iterator[str]:
    folder, every = results.folder, experiment.settings.runs
    if any(results.index_of(point) is None for point in results.points()):
        yield "summary.csv: is of other points than the config's grid"
        return
    # The points of the grid, as the config gives them now.
    points = points_text(experiment.points, folder)
    stored = folder / POINTS_FILE
    if stored.is_file() and not same_points(stored.read_text(encoding="utf-8"), points):
        yield f"{POINTS_FILE}: is not what the config makes of the points"
    with TemporaryDirectory() as temporary:
        target, recomputed = Path(temporary, "derived"), Path(temporary, "recomputed")
        target.mkdir()
        recomputed.mkdir()
        results = replace(results, out=target, point_facts=tuple(points_in(points)))
        yield from compare_tuning(results, experiment, runs)
        has_runs = (folder / "per_run.csv").is_file()
        if has_runs:
            yield from compare_derived(results, folder)
            columns = chain.from_iterable(results.runs(p).values() for p in results.points())
            numbers = set(map(len, columns))
            if numbers - {every}:
                # As many runs as the config asks for may take for ever.
                yield "per_run.csv: has not as many runs of every metric as the config asks for"
                return
        tracks = (folder / "tracks.npz").is_file()
        if has_runs and runs < every:
            computed = recompute(experiment, recomputed, runs, tracks)
            yield from compare_first_runs(results, computed)
            return
        computed = recompute(experiment, recomputed, every, tracks)
        differences = [*compare_all_runs(results, computed)]
        yield from differences
        if not has_runs and not differences:
            if (folder / "tuning.csv").is_file():
                shutil.copy(folder / "tuning.csv", recomputed)
            facts = {**results.manifest, **(computed.run_facts or {})}
            yield from compare_derived(replace(computed, out=target, run_facts=facts), folder)


def recompute(experiment: Experiment, folder: Path, runs: int, tracks: bool) -> Results:
    """Write the results of the first runs to a folder and return them.

    Blocks are as wide as for all runs: `block: fit` depends on their number.
    """
    if min(experiment.shown_runs, experiment.settings.runs) > runs:
        experiment = replace(experiment, figures={})
    plan = make_plan(experiment, tracks).first(runs)
    workers = min(cpu_count(), len(plan.unique))
    check_memory(experiment, tracks)
    fewer = replace(experiment, settings=replace(experiment.settings, runs=runs))
    store, processes = BlockStore(cache_folder()), engine("processes", workers)
    outcomes = execute([plan], store, processes, workers, fresh=True, progress=False)
    with closing(outcomes):
        _, facts = write_results(folder, fewer, next(outcomes), tracks)
    return Results(folder, facts)


def compare_first_runs(stored: Results, computed: Results) -> Iterator[str]:
    """Yield differences in the first runs, and in the numbers that do not depend on runs."""
    runs, grid = computed.config["runs"], stored.grid
    frames = [_values_of_runs(results, runs) for results in (stored, computed)]
    yield from compare_frames("per_run.csv", *frames)
    without_runs = [stored.config.get("bound"), *stored.exact]
    for name in ("summary", "per_step"):
        if not (stored.folder / f"{name}.csv").is_file():
            continue
        whole = [getattr(results, name) for results in (stored, computed)]
        # Whether any component is left out of a NEES depends on all runs.
        whole = [frame[~frame["metric"].str.startswith("unused_")] for frame in whole]
        names = [set(frame[[*grid, "filter", "metric"]].itertuples(False, None)) for frame in whole]
        if names[0] != names[1]:
            yield f"{name}.csv: has other rows than are computed again"
        else:
            frames = [frame[frame["filter"].isin(without_runs)] for frame in whole]
            yield from compare_frames(f"{name}.csv", *frames)
    for name in _TRACKS:
        if (computed.folder / name).is_file() and (stored.folder / name).is_file():
            yield from compare_arrays(name, stored, computed)


def _values_of_runs(results: Results, runs: int) -> "pd.DataFrame":
    """Select the first runs' values without contributions to an average: they depend on all runs."""
    frame = results.per_run
    metrics = frame["metric"].unique()
    whole = [metric for metric in metrics if measured(metric).statistic == TIME_MEAN]
    return frame[(frame["run"] < runs) & ~frame["metric"].isin(whole)]


def compare_all_runs(stored: Results, computed: Results) -> Iterator[str]:
    """Yield differences of all recomputed runs from the stored files, or from their digests."""
    digests = stored.manifest["files"]
    for name in (*DATA_FILES, "summary.csv", "tracks.npz"):
        paths = stored.folder / name, computed.folder / name
        if paths[0].is_file():
            if not paths[1].is_file() or not filecmp.cmp(*paths, shallow=False):
                yield from _explain(name, stored, computed)
        elif name in digests and check_digests(computed.folder, {name: digests[name]}).changed:
            yield f"{name}: has another digest when it is computed again"


def _explain(name: str, stored: Results, computed: Results) -> Iterator[str]:
    """Yield the differences of two files with other bytes; the same arrays may be packed otherwise."""
    if name in _TRACKS:
        yield from compare_arrays(name, stored, computed)
        return
    frames = [getattr(results, name.removesuffix(".csv")) for results in (stored, computed)]
    lines = [*compare_frames(name, *frames)]
    yield from lines or [f"{name}: has other bytes when it is computed again, of equal numbers"]


def compare_frames(name: str, stored: "pd.DataFrame", computed: "pd.DataFrame") -> Iterator[str]:
    """Yield a line for each filter with other numbers, or one if the rows are of other things."""
    keys = [column for column in computed if column not in _NUMBERS]
    a, b = (frame.reset_index(drop=True) for frame in (stored, computed))
    if not a[keys].equals(b[keys]):
        rows = [frame[keys].itertuples(index=False, name=None) for frame in (a, b)]
        odd = next((pair for pair in zip_longest(*rows) if pair[0] != pair[1]), ((), ()))
        first, expected = (", ".join(map(str, row or ["nothing"])) for row in odd)
        what = "has other rows than are computed again"
        yield f"{name}: {what}; the first is {first!r}, it should be {expected!r}"
        return
    for label in a["filter"].unique():
        mine = (a["filter"] == label).to_numpy()
        columns = [column for column in _NUMBERS if column in a]
        numbers = (frame.loc[mine, columns].to_numpy() for frame in (a, b))
        yield from describe_difference(f"{name}: {label}", *numbers)


def compare_arrays(name: str, stored: Results, computed: Results) -> Iterator[str]:
    """Yield differences in a file of tracks, of the runs that are computed."""
    arrays, again = stored.arrays(name), computed.arrays(name)
    if arrays.keys() != again.keys():
        yield f"{name}: holds other arrays than are computed again"
        return
    for key, array in again.items():
        first = arrays[key][..., : array.shape[-1]]
        yield from describe_difference(f"{name}: {key}", first, array)


def describe_difference(what: str, stored: Array, computed: Array) -> Iterator[str]:
    """Yield a line on unequal numbers: how many, and the largest relative difference."""
    if stored.shape != computed.shape:
        yield f"{what}: has shape {stored.shape}, computed again {computed.shape}"
        return
    differs = (stored != computed) & ~(np.isnan(stored) & np.isnan(computed))
    if differs.any():
        largest = largest_share(stored[differs], computed[differs])
        by = f"by {largest:.1e} of the value at most"
        yield f"{what}: {differs.sum()} of {differs.size} numbers differ, {by}"


@np.errstate(all="ignore")
def largest_share(a: Array, b: Array) -> float:
    """Find the largest difference of two arrays (n,) relative to the larger value; inf for a NaN."""
    share = np.abs(a - b) / np.maximum(np.abs(a), np.abs(b))
    return float(np.nan_to_num(share, nan=np.inf).max())


def compare_derived(results: Results, folder: Path) -> Iterator[str]:
    """Yield differences of a folder's tables and verdicts from those made of the results."""
    write_tables(results, tex=True)
    for what, line in zip(results.unmade, results.unmade_lines, strict=True):
        if (folder / "tables" / f"{what.removeprefix('table ')}.csv").is_file():
            yield line
    write_paired(results)
    write_comparison(results, compare(results))
    if (folder / "sweep.csv").is_file():
        write_sweep(results)
    written = {p.relative_to(results.target) for p in results.target.rglob("*") if p.is_file()}
    for name in sorted(written):
        stored, computed = folder / name, results.target / name
        is_optional = name.suffix == ".tex" or name.parts[0] == "run"
        if not stored.is_file():
            if not is_optional:
                yield f"{name}: is not there"
        elif stored.read_bytes() != computed.read_bytes():
            yield _first_other_row(name, stored, computed)
    for name in map(Path, (*FILES, TIME_VERDICTS)):
        if (folder / name).is_file() and name not in written:
            yield f"{name}: nothing is published about this experiment"


def _first_other_row(name: Path, stored: Path, computed: Path) -> str:
    texts = (path.read_text(encoding="utf-8", errors="replace") for path in (stored, computed))
    a, b = (text.splitlines() for text in texts)
    if len(a) != len(b):
        return f"{name}: has {len(a)} lines, of the stored runs it has {len(b)}"
    pairs = [(x, y) for x, y in zip(a, b, strict=True) if x != y]
    if not pairs:
        return f"{name}: has other line ends than are written from the stored runs"
    what = f"{len(pairs)} rows do not follow from the stored runs; the first is"
    return f"{name}: {what} {pairs[0][0]!r}, it should be {pairs[0][1]!r}"


# The values that a search tries depend on the ranks of the trials before them and on nothing else. So
# the search is repeated with the stored ranks and without a run. The first and the best trial are
# recomputed, or all trials if all runs are.
def compare_tuning(results: Results, experiment: Experiment, runs: int) -> Iterator[str]:
    """Yield differences in tuning.csv, and in the values that the config took from it."""
    is_whole = runs >= experiment.settings.runs
    repeated: dict[str, Record] = {}
    if is_whole and results.tuning:
        workers, store = cpu_count(), BlockStore(cache_folder())
        processes = engine("processes", workers)
        repeated = tune(experiment, store, processes, workers, fresh=True, progress=False)
    for label in experiment.tuned:
        if label not in results.tuning:
            yield f"{_FILE}: has no trials of {label}"
            continue
        record, training = results.tuning[label], Training(experiment, label)
        yield from _compare_search(experiment, label, record, training)
        for key, value in record.best.values.items():
            taken = given_values(experiment, tuned_label(label)).get(key)
            if taken != value:
                what = f"{key} is {taken}, the best trial of {_FILE} has {value}"
                yield f"config.yaml: {tuned_label(label)}: {what}"
        stored = record.trials if is_whole else [record.trials[0], record.best]
        again = repeated[label].trials if is_whole else _run_trials(record, training, stored)
        yield from _compare_trials(label, stored, again)


def _run_trials(record: Record, training: Training, trials: list[Trial]) -> list[Trial]:
    again = []
    for trial in trials:
        tasks = training.tasks(_trial_values(record, trial))
        blocks = [run_whole_block(task)[task.runs_used] for task in tasks]
        score = training.score(merge(blocks).per_run) if blocks else None
        again.append(Trial.of(trial.values, score))
    return again


def _trial_values(record: Record, trial: Trial) -> Values:
    return tuple(trial.values[axis.key] for axis in record.axes)


def _compare_search(
    experiment: Experiment, label: str, record: Record, training: Training
) -> Iterator[str]:
    """Yield the first trial that the search does not try after the stored ranks before it."""
    ranks: dict[Values, Rank] = {_trial_values(record, t): t.rank for t in record.trials}
    tried: list[Values] = []
    search = Search(record.axes, training.start, experiment.settings.tuning.evaluations).run()
    with suppress(StopIteration):
        wanted = next(search)
        while set(wanted) <= ranks.keys():
            tried += wanted
            wanted = search.send({values: ranks[values] for values in wanted})
        tried += wanted
    # The stored digits of two equal objectives do not order them, nor then the search.
    finite = [rank for rank in ranks.values() if isfinite(rank[1])]
    is_ordered = len(set(finite)) == len(finite)
    if is_ordered and tried != list(ranks):
        same = takewhile(lambda pair: pair[0] == pair[1], zip(tried, ranks, strict=False))
        what = "is not what the search asks for after those before it"
        yield f"{_FILE}: {label}: trial {len(list(same))} {what}"


def _compare_trials(label: str, stored: list[Trial], again: list[Trial]) -> Iterator[str]:
    if len(stored) != len(again):
        yield f"{_FILE}: {label}: has {len(stored)} trials, computed again {len(again)}"
    for a, b in zip(stored, map(Trial.rounded, again), strict=False):
        if repr(a) != repr(b):
            texts = []
            for trial in (a, b):
                at = ", ".join(f"{key} = {value}" for key, value in trial.values.items())
                texts.append(f"{at}: {trial.objective:g} ± {trial.stderr:g}")
            yield f"{_FILE}: {label} at {texts[0]}, computed again at {texts[1]}"
            return
