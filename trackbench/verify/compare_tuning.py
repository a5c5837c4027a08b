"""Compare tuning.csv with the search that it records.

The values that are tried depend on the ranks of the trials before them and on nothing else. So the
search is repeated with the stored ranks and without a run. The first and the best trial are recomputed,
or all trials if all runs are.
"""

from collections.abc import Iterator
from contextlib import suppress
from math import isfinite

from trackbench.config.experiment import Experiment
from trackbench.config.tuning import tuned_label
from trackbench.config.values_of_filter import configured_values
from trackbench.errors import counted
from trackbench.evaluation.run_blocks_side_by_side import run_whole_block
from trackbench.execution.block_file import pack
from trackbench.execution.cache import BlockStore, cache_folder
from trackbench.execution.engines import cpu_count, engine
from trackbench.report.tables_and_figures import Results
from trackbench.tuning.record_of_trials import Record, Trial
from trackbench.tuning.search import Rank, Search, Values
from trackbench.tuning.tuner import Training, tune

_FILE = "tuning.csv"


def compare_tuning(results: Results, experiment: Experiment, runs: int) -> Iterator[str]:
    """Yield differences in tuning.csv, and in the values that the config took from it.

    The first and the best trial are recomputed, or all trials if ``runs`` are all runs.
    """
    is_whole = runs >= experiment.settings.runs
    repeated: dict[str, Record] = {}
    if is_whole and results.tuning:
        workers = cpu_count()
        store = BlockStore(cache_folder())
        open_engine = engine("processes", workers)
        repeated = tune(experiment, store, open_engine, workers, fresh=True, progress=False)
    for label in experiment.tuned:
        if label not in results.tuning:
            yield f"{_FILE}: has no trials of {label}"
            continue
        record = results.tuning[label]
        training = Training(experiment, label)
        yield from _compare_search(experiment, label, record, training)
        for key, value in record.best.values.items():
            taken = configured_values(experiment, tuned_label(label)).get(key)
            if taken != value:
                values = f"{key} is {taken}, the best trial of {_FILE} has {value}"
                yield f"config.yaml: {tuned_label(label)}: {values}"
        if is_whole:
            trials = record.trials
            computed = repeated[label].trials
        else:
            trials = [record.trials[0], record.best]
            computed = _run_trials(record, training, trials)
        yield from _compare_trials(label, trials, computed)


def _run_trials(record: Record, training: Training, trials: list[Trial]) -> list[Trial]:
    """Run the filter with the values of each trial again; return the trials with new objectives."""
    computed = []
    for trial in trials:
        # No tasks: the filter is invalid with these values.
        tasks = training.tasks(_trial_values(record, trial))
        blocks = []
        # The filter may fail with these values, and then the trial has no score.
        with suppress(Exception):
            # The results of a block are by the number of runs that they are computed from.
            blocks = [pack(run_whole_block(task)[task.runs_used]) for task in tasks]
        score = None
        if blocks:
            score = training.score(blocks)
        computed.append(Trial.of(trial.values, score))
    return computed


def _trial_values(record: Record, trial: Trial) -> Values:
    return tuple(trial.values[axis.key] for axis in record.axes)


def _compare_search(
    experiment: Experiment, label: str, record: Record, training: Training
) -> Iterator[str]:
    """Yield a line on the first stored trial that the search would not have tried.

    The search is deterministic, given the ranks of the trials: lost runs, then the objective. So it is
    repeated with the stored ranks, without any run. ``record`` has the stored trials of the filter
    ``label``.
    """
    ranks: dict[Values, Rank] = {_trial_values(record, t): t.rank for t in record.trials}
    tried: list[Values] = []
    search = Search(record.axes, training.start, experiment.settings.tuning.evaluations).run()
    with suppress(StopIteration):  # the search has ended
        wanted = next(search)
        while set(wanted) <= ranks.keys():
            tried += wanted
            wanted = search.send({values: ranks[values] for values in wanted})
        tried += wanted  # values without a stored rank: the search cannot go on
    # Objectives may be equal in their stored digits. Their order is then unknown, and so is the search.
    # Those of failed filters are infinite, which rounding does not change: they were equal in the
    # search, too.
    finite_ranks = []
    for lost, objective in ranks.values():
        if isfinite(objective):
            finite_ranks.append((lost, objective))
    is_ordered = len(set(finite_ranks)) == len(finite_ranks)
    # The order of the stored trials must be that of the repeated search.
    if is_ordered and tried != list(ranks):
        number = 0  # of the first trial that differs
        for values, stored_values in zip(tried, ranks, strict=False):
            if values != stored_values:
                break
            number += 1
        mistake = "is not what the search asks for after those before it"
        yield f"{_FILE}: {label}: trial {number} {mistake}"


def _compare_trials(label: str, stored: list[Trial], computed: list[Trial]) -> Iterator[str]:
    """Yield a line on the first trial whose numbers differ, after rounding to the stored digits.

    Later trials depend on it. Another line is on the number of trials, if that differs.
    """
    if len(stored) != len(computed):
        trials = counted(len(stored), "trial")
        yield f"{_FILE}: {label}: has {trials}, computed again {len(computed)}"
    for trial, again in zip(stored, map(Trial.rounded, computed), strict=False):
        if repr(trial) != repr(again):  # texts, as NaN equals no number
            yield f"{_FILE}: {label} at {_text_of(trial)}, computed again at {_text_of(again)}"
            return


def _text_of(trial: Trial) -> str:
    """Write ``q = 0.1, N = 50: 12.5 ± 0.3``."""
    values = ", ".join(f"{key} = {value}" for key, value in trial.values.items())
    return f"{values}: {trial.objective:g} ± {trial.stderr:g}"
