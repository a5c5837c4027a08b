"""Check that a stored results folder is reproduced.

The first runs are recomputed, and tables, pairs and verdicts are made again from the stored runs. A
clone has digests in place of the runs: there all runs are recomputed. The verdict on a folder is one of
three: the same bytes, the same but for the rounding of another processor or library, or changed.

`verify_differences.py` tells rounding from a change, filter by filter. For a filter that draws and so
amplifies the last bit, only a change of its means over the recomputed runs is detected: with 20 runs
a change of two standard deviations of the paired difference, with 200 runs of half of that deviation.
Statistics over all runs are compared only if all runs are recomputed.

CPU times cannot be recomputed, and figures and report.html depend on the versions of matplotlib and of
this program. The manifest's digests protect these.

tuning.csv is compared with the search that it records. The values that are tried depend on the ranks of
the trials before them and on nothing else. So the search is repeated with the stored ranks and without
a run. The first and the best trial are recomputed, or all trials if all runs are.
"""

import shutil
from collections.abc import Iterator
from contextlib import closing, suppress
from dataclasses import replace
from itertools import takewhile
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple, TypeAlias

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
from trackbench.report.results import Results
from trackbench.results.point_facts import POINTS_FILE, points_in, points_text, same_points
from trackbench.results.write import write_results
from trackbench.statistics.intervals import holm
from trackbench.statistics.over_runs import mean
from trackbench.tuning.search import Rank, Record, Search, Trial, Values
from trackbench.tuning.tuner import Training, given_values, tune
from trackbench.verify_differences import (
    CHANGED,
    FALSE_ALARM,
    FAR,
    TOLERANCE,
    Finding,
    changed,
    compare_arrays,
    compare_derived,
    compare_digests,
    compare_rows,
    differences,
    p_of_chance,
    relative,
    rounding,
    usual,
    verdict,
)

__all__ = ["CHANGED", "Finding", "verdict", "verify"]


def verify(folder: Path, runs: int, allow_plugins: bool = False) -> list[Finding]:
    """Recompute so many runs and return what differs; nothing if all bytes are the same.

    Raises UserError if the folder has no results, or its config is invalid.
    """
    try:
        with explain_content_errors(folder):
            results = open_results(folder)
            options = api.Options(allow_plugins=allow_plugins)
            findings = [changed(line) for line in changed_files(results)]
            experiment = api.prepare(folder / "config.yaml", options)
            return findings + list(_compare(results, experiment, runs))
    except IncompleteResultsError as error:
        return [changed(str(line)) for line in error.problems]


def _compare(results: Results, experiment: Experiment, runs: int) -> Iterator[Finding]:
    folder = results.folder
    if any(results.index_of(point) is None for point in results.points()):
        yield changed("summary.csv: is of other points than the config's grid")
        return
    # The points of the grid, as the config gives them now.
    points = points_text(experiment.points, folder)
    stored = folder / POINTS_FILE
    if stored.is_file() and not same_points(stored.read_text(encoding="utf-8"), points):
        yield changed(f"{POINTS_FILE}: is not what the config makes of the points")
    with TemporaryDirectory() as temporary:
        target, recomputed = Path(temporary, "made"), Path(temporary, "again")
        target.mkdir()
        recomputed.mkdir()
        results = replace(results, out=target, point_facts=tuple(points_in(points)))
        yield from compare_tuning(results, experiment, runs)
        # With per_run.csv, recompute its first runs and derive the other files from it.
        if (folder / "per_run.csv").is_file():
            yield from compare_derived(results, folder)
            yield from _compare_first_runs(results, experiment, recomputed, runs)
            return
        # Without it, recompute all runs and compare digests.
        again = recompute(experiment, recomputed, experiment.settings.runs, tracks=False)
        if (folder / "tuning.csv").is_file():
            shutil.copy(folder / "tuning.csv", recomputed)
        facts = {**results.manifest, **(again.run_facts or {})}
        again = replace(again, out=target, run_facts=facts)
        yield from compare_digests(results, again, drawing_filters(experiment))


def _compare_first_runs(
    results: Results, experiment: Experiment, folder: Path, runs: int
) -> Iterator[Finding]:
    numbers = {len(x) for point in results.points() for x in results.runs(point).values()}
    if numbers - {experiment.settings.runs}:
        # As many runs as the config asks for may take for ever.
        yield changed("per_run.csv: has not as many runs of every metric as the config asks for")
        return
    has_tracks = (results.folder / "tracks.npz").is_file()
    again = recompute(experiment, folder, min(runs, experiment.settings.runs), has_tracks)
    yield from compare_runs(results, again, experiment)


ColumnKey: TypeAlias = tuple[Any, ...]
"""Values of the grid's paths, filter, metric."""


class Column(NamedTuple):
    """A metric of a filter over the runs (M,): stored, recomputed, and the relative difference."""

    key: ColumnKey
    stored: Array
    again: Array
    off: Array

    @property
    def label(self) -> str:
        """The filter."""
        return str(self.key[-2])

    @property
    def name(self) -> str:
        """The metric, and the point of the grid."""
        *point, _, metric = self.key
        return f"{metric} at {', '.join(map(str, point))}" if point else str(metric)

    @property
    def is_far(self) -> bool:
        """Return whether any run differs by more than rounding."""
        return bool((self.off > TOLERANCE).any())


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
    with closing(
        execute([plan], store, processes, workers, fresh=True, progress=False)
    ) as outcomes:
        _, facts = write_results(folder, fewer, next(outcomes), tracks)
    return Results(folder, facts)


def drawing_filters(experiment: Experiment) -> set[str]:
    """Return the labels of filters that draw: each has a number of particles."""
    return {
        label for p in experiment.points for label, f in p.filters.items() if f.particle_count > 1
    }


def compare_runs(results: Results, again: Results, experiment: Experiment) -> Iterator[Finding]:
    """Yield differences in the first runs, and in all other numbers if these are all runs."""
    runs = again.config["runs"]
    is_whole = runs == experiment.settings.runs
    stored, computed = _values(results, runs, is_whole), _values(again, runs, is_whole)
    odd = [k for k in {**stored, **computed} if len(stored.get(k, ())) != len(computed.get(k, ()))]
    if odd:
        first = ", ".join(map(str, odd[0]))
        what = "metrics are stored or computed again only; the first is"
        yield changed(f"per_run.csv: {len(odd)} {what} {first}")
    columns = [
        Column(key, x, computed[key], relative(x, computed[key], usual(x)))
        for key, x in stored.items()
        if key not in odd
    ]
    yield from _judge(columns, drawing_filters(experiment))
    steady = {c.label for c in columns} - {c.label for c in columns if c.is_far}
    equal = steady - {c.label for c in columns if c.off.any()}
    for name in ("shown.npz", "tracks.npz"):
        if (again.folder / name).is_file() and (results.folder / name).is_file():
            yield from compare_arrays(results, again, name, steady)
    bound = {str(experiment.settings.bound), *results.exact}
    yield from compare_rows(results, again, bound | steady if is_whole else bound, equal)


def _values(results: Results, runs: int, is_whole: bool) -> dict[ColumnKey, Array]:
    """Return the first runs' values; a run's share of an average over time depends on all runs."""
    return {
        (*point.values(), *key): values[:runs]
        for point in results.points()
        for key, values in results.runs(point).items()
        if is_whole or measured(key[1]).statistic != TIME_MEAN
    }


def _judge(columns: list[Column], drawing: set[str]) -> Iterator[Finding]:
    """Yield a finding for each filter of which any value differs."""
    tested = [c for c in columns if c.label in drawing and c.is_far]
    chances = holm(np.array([p_of_chance(differences(c.stored, c.again)) for c in tested]))
    p = {c.key: float(chance) for c, chance in zip(tested, chances, strict=True)}
    for label in dict.fromkeys(c.label for c in columns if c.off.any()):
        mine = [c for c in columns if c.label == label]
        yield _judge_filter(label, mine, p, label in drawing)


def _judge_filter(
    label: str, mine: list[Column], p: dict[ColumnKey, float], draws: bool
) -> Finding:
    off = np.concatenate([c.off for c in mine])
    worst = max(mine, key=lambda c: c.off.max())
    begin = f"per_run.csv: {label}: {np.count_nonzero(off)} of {off.size} values differ"
    begin += f" in the first {len(worst.off)} runs"
    if off.max() <= TOLERANCE:
        digits = int(-np.log10(off.max()))
        return rounding(f"{begin}, by {off.max():.1e} at most: they agree in {digits} digits")
    if not draws:
        run = int(worst.off.argmax())
        values = f"{worst.stored[run]:.7g}, computed again {worst.again[run]:.7g}"
        return changed(f"{begin}, by more than rounding: {worst.name} of run {run} is {values}")
    least = min((c for c in mine if c.key in p), key=lambda c: p[c.key])
    if p[least.key] >= FALSE_ALARM:
        what = "it draws, so that rounding grows, and no mean differs beyond chance"
        return rounding(f"{begin}, by up to {off.max():.1%}: {what}")
    value, stderr = mean(differences(least.stored, least.again))
    by = f"{least.name} by {value:.3g} ± {stderr:.2g}, p = {p[least.key]:.1g}"
    return changed(f"{begin}, on average beyond chance: {by}")


_FILE = "tuning.csv"
_DIGITS = 1e-6  # relative difference below which two stored objectives may be in either order


def compare_tuning(results: Results, experiment: Experiment, runs: int) -> Iterator[Finding]:
    """Yield differences in tuning.csv, and in the values that the config took from it."""
    is_whole = runs >= experiment.settings.runs
    repeated = _tune_again(experiment) if is_whole and results.tuning else {}
    for label in experiment.tuned:
        if label not in results.tuning:
            yield changed(f"{_FILE}: has no trials of {label}")
            continue
        record, training = results.tuning[label], Training(experiment, label)
        yield from _compare_search(experiment, label, record, training)
        for key, value in record.best.values.items():
            taken = given_values(experiment, tuned_label(label)).get(key)
            if taken != value:
                what = (
                    f"{tuned_label(label)}: {key} is {taken}, the best trial of {_FILE} has {value}"
                )
                yield changed(f"config.yaml: {what}")
        stored = record.trials if is_whole else [record.trials[0], record.best]
        again = repeated[label].trials if is_whole else _run_trials(record, training, stored)
        draws = experiment.points[0].filters[tuned_label(label)].particle_count > 1
        yield from _compare_trials(label, stored, again, draws)


def _tune_again(experiment: Experiment) -> dict[str, Record]:
    workers, store = cpu_count(), BlockStore(cache_folder())
    processes = engine("processes", workers)
    return tune(experiment, store, processes, workers, fresh=True, progress=False)


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
) -> Iterator[Finding]:
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
    if tried == list(ranks) or _is_close(record):
        return
    same = takewhile(lambda pair: pair[0] == pair[1], zip(tried, ranks, strict=False))
    what = "is not what the search asks for after those before it"
    yield changed(f"{_FILE}: {label}: trial {len(list(same))} {what}")


def _is_close(record: Record) -> bool:
    """Return whether the stored digits of two objectives do not order them, nor then the search."""
    heights = np.sort([t.objective for t in record.trials if np.isfinite(t.objective)])
    return bool(np.any(relative(heights[1:], heights[:-1]) < _DIGITS))


def _compare_trials(
    label: str, stored: list[Trial], again: list[Trial], draws: bool
) -> Iterator[Finding]:
    """Yield differences of recomputed trials, in the stored digits, up to the first large one."""
    if len(stored) != len(again):
        yield changed(f"{_FILE}: {label}: has {len(stored)} trials, computed again {len(again)}")
    for a, b in zip(stored, map(Trial.rounded, again), strict=False):
        if repr(a) == repr(b):
            continue
        numbers = np.array([a.objective, a.stderr]), np.array([b.objective, b.stderr])
        near = a.lost == b.lost and bool(np.all(relative(*numbers) <= TOLERANCE))
        apart = abs(a.objective - b.objective)
        near |= draws and bool(apart <= FAR * np.hypot(a.stderr, b.stderr))
        at = ", ".join(f"{key} = {value}" for key, value in a.values.items())
        what = f"{_FILE}: {label} at {at}: {a.objective:g} ± {a.stderr:g}"
        if a.values != b.values:
            near, at = False, ", ".join(f"{key} = {value}" for key, value in b.values.items())
            what += f", of a search that is computed again {at}"
        yield (rounding if near else changed)(
            f"{what}, computed again {b.objective:g} ± {b.stderr:g}"
        )
        if not near:
            return  # the next trials depend on it
