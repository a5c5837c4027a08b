"""Compare tuning.csv with the search that it records, and with recomputed trials.

The values that are tried depend on the ranks of the trials before them and on nothing else. So the
search is repeated with the stored ranks and without a run. The first and the best trial are recomputed,
or all trials if all runs are.
"""

from collections.abc import Iterator
from contextlib import suppress
from itertools import takewhile

import numpy as np

from trackbench.config.experiment import Experiment
from trackbench.config.tuning import tuned_label
from trackbench.evaluation.merge import merge
from trackbench.evaluation.run_block import run_whole_block
from trackbench.execution.cache import BlockStore, cache_folder
from trackbench.execution.engines import cpu_count, engine
from trackbench.report.results import Results
from trackbench.tuning.record import Record, Trial
from trackbench.tuning.search import Rank, Search, Values
from trackbench.tuning.tuner import Training, given_values, tune
from trackbench.verify.compare import FAR, TOLERANCE, Finding, changed, relative, rounding

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
        tasks = training.tasks(_values(record, trial))
        blocks = [run_whole_block(task)[task.runs_used] for task in tasks]
        score = training.score(merge(blocks).per_run) if blocks else None
        again.append(Trial.of(trial.values, score))
    return again


def _values(record: Record, trial: Trial) -> Values:
    return tuple(trial.values[axis.key] for axis in record.axes)


def _compare_search(
    experiment: Experiment, label: str, record: Record, training: Training
) -> Iterator[Finding]:
    """Yield the first trial that the search does not try after the stored ranks before it."""
    ranks: dict[Values, Rank] = {_values(record, t): t.rank for t in record.trials}
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
