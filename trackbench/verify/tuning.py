"""tuning.csv held to the experiment: the search followed again, and trials of each filter computed.

Which values are tried hangs on the ranks of those before and on nothing else, so the whole search is
followed by the stored ranks, without a run. Of the trials the first and the best are computed again, or
all of them where all runs are.
"""

from collections.abc import Iterator
from contextlib import suppress
from itertools import takewhile

import numpy as np

from trackbench.config.experiment import Experiment
from trackbench.config.tuning import tuned_label
from trackbench.evaluation.block_metrics import run_whole_block
from trackbench.evaluation.merge import merge
from trackbench.execution.cache import BlockStore, cache_folder
from trackbench.execution.engines import cpu_count, engine
from trackbench.report.results import Results
from trackbench.tuning.record import Record, Trial
from trackbench.tuning.search import Rank, Search, Values
from trackbench.tuning.training import Training, given_values
from trackbench.tuning.tuner import tune
from trackbench.verify.findings import Finding, changed, rounding
from trackbench.verify.rounding import ROUNDING, relative

_FILE = "tuning.csv"
_DIGITS = 1e-6  # share of an objective below which two of the file may be in either order
_FAR = 4.0  # standard errors of an objective that draws: as good as other noise


def tuning_again(results: Results, experiment: Experiment, runs: int) -> Iterator[Finding]:
    """What differs in tuning.csv, or in what the config took from it."""
    whole = runs >= experiment.settings.runs
    found = _tuned_again(experiment) if whole and results.tuning else {}
    for label in experiment.tuned:
        if label not in results.tuning:
            yield changed(f"{_FILE}: has no trials of {label}")
            continue
        record, training = results.tuning[label], Training(experiment, label)
        yield from _followed(experiment, label, record, training)
        yield from _taken(experiment, label, record)
        again = found[label].trials if whole else _some_again(record, training)
        stored = record.trials if whole else _some(record)
        draws = experiment.points[0].filters[tuned_label(label)].particle_count > 1
        yield from _beside(label, stored, again, draws)


def _tuned_again(experiment: Experiment) -> dict[str, Record]:
    workers = cpu_count()
    opened = engine("processes", workers)
    return tune(experiment, BlockStore(cache_folder()), opened, workers, fresh=True, progress=False)


def _some(record: Record) -> list[Trial]:
    return [record.trials[0], record.best]


def _some_again(record: Record, training: Training) -> list[Trial]:
    """The first trial and the best one, computed here."""
    again = []
    for trial in _some(record):
        tasks = training.tasks(_values(record, trial))
        blocks = [run_whole_block(task)[task.runs_used] for task in tasks]
        score = training.score(merge(blocks).per_run) if blocks else None
        again.append(Trial.of(trial.values, score))
    return again


def _values(record: Record, trial: Trial) -> Values:
    return tuple(trial.values[axis.key] for axis in record.axes)


def _followed(
    experiment: Experiment, label: str, record: Record, training: Training
) -> Iterator[Finding]:
    """Whether the search asks for these values when it is told these ranks."""
    ranks: dict[Values, Rank] = {_values(record, t): t.rank for t in record.trials}
    asked: list[Values] = []
    asking = Search(record.axes, training.start, experiment.settings.tuning.evaluations).run()
    with suppress(StopIteration):
        wanted = next(asking)
        while set(wanted) <= ranks.keys():
            asked += wanted
            wanted = asking.send({values: ranks[values] for values in wanted})
        asked += wanted
    if asked == list(ranks) or _is_close(record):
        return
    alike = takewhile(lambda pair: pair[0] == pair[1], zip(asked, ranks, strict=False))
    place = len(list(alike))
    what = "is not what the search asks for after those before it"
    yield changed(f"{_FILE}: {label}: trial {place} {what}")


def _is_close(record: Record) -> bool:
    """Whether two objectives are so near each other that their stored digits do not order them.

    Then the search cannot be followed by them.
    """
    heights = np.sort([t.objective for t in record.trials if np.isfinite(t.objective)])
    return bool(np.any(relative(heights[1:], heights[:-1]) < _DIGITS))


def _taken(experiment: Experiment, label: str, record: Record) -> Iterator[Finding]:
    """Whether the tuned filter has the best values."""
    there = given_values(experiment, tuned_label(label))
    for key, value in record.best.values.items():
        if there.get(key) != value:
            found = f"{there.get(key)}, the best trial of {_FILE} has {value}"
            yield changed(f"config.yaml: {tuned_label(label)}: {key} is {found}")


def _beside(label: str, stored: list[Trial], again: list[Trial], draws: bool) -> Iterator[Finding]:
    """Trials as stored and computed again, to the digits that are stored."""
    if len(stored) != len(again):
        yield changed(f"{_FILE}: {label}: has {len(stored)} trials, computed again {len(again)}")
    for a, b in zip(stored, map(Trial.rounded, again), strict=False):
        if repr(a) == repr(b):
            continue
        numbers = np.array([a.objective, a.stderr]), np.array([b.objective, b.stderr])
        near = a.lost == b.lost and bool(np.all(relative(*numbers) <= ROUNDING))
        apart = abs(a.objective - b.objective)
        near |= draws and bool(apart <= _FAR * np.hypot(a.stderr, b.stderr))
        at = ", ".join(f"{key} = {value}" for key, value in a.values.items())
        what = f"{_FILE}: {label} at {at}: {a.objective:g} ± {a.stderr:g}"
        if a.values != b.values:
            near, at = False, ", ".join(f"{key} = {value}" for key, value in b.values.items())
            what += f", of a search that is computed again {at}"
        yield (rounding if near else changed)(
            f"{what}, computed again {b.objective:g} ± {b.stderr:g}"
        )
        if not near:
            return  # what follows hangs on it
