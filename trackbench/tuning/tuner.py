"""Tune the filters of an experiment: all trials are blocks of training runs in one queue.

Searches run independently, and a trial is scored when its last block is complete, from the
blocks in their order. So the result does not depend on workers, interruptions or other filters.
"""

from collections.abc import Iterable, Mapping
from contextlib import closing
from math import ceil
from types import MappingProxyType
from typing import NamedTuple

from trackbench.config import tuned_filters
from trackbench.config.computed_on_request import predictions_for
from trackbench.config.experiment import Experiment
from trackbench.config.tuning_axes import Axis
from trackbench.config.tuning_objective import Objective
from trackbench.config.values_of_filter import configured_values
from trackbench.errors import Problem, UserError
from trackbench.evaluation.block_result import BlockResult
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.nees import sizes as sizes_of_nees
from trackbench.execution.block_file import PackedBlock
from trackbench.execution.block_scheduler import Queue
from trackbench.execution.block_size import block_width
from trackbench.execution.cache import BlockStore
from trackbench.execution.engines import OpenEngine
from trackbench.execution.joined_filters import algorithm
from trackbench.execution.merge_finished_blocks import merge
from trackbench.execution.run_plans import stored_block
from trackbench.progress_bar import progress_bar
from trackbench.statistics.estimates import RunEstimate
from trackbench.tuning.record_of_trials import Record, Trial
from trackbench.tuning.search import Search, Shares, Values, first_place


def tune(
    experiment: Experiment,
    store: BlockStore,
    open_engine: OpenEngine,
    workers: int,
    fresh: bool = False,
    progress: bool = True,
) -> dict[str, Record]:
    """Search the keys of every tuned filter; return the trials of each, by label.

    A trial is a filter with certain values of its keys, run over blocks of training runs. Finished
    blocks are written to ``store``, and those of earlier runs are read from it unless ``fresh`` is set.
    A trial whose filter raises ranks last. ``progress`` shows a progress bar.
    """
    store.prepare()
    queue = Queue(workers, store)
    blocks = _SessionBlocks(store, fresh)
    tuners = [_Tuner(experiment, label, blocks, queue.failed) for label in experiment.tuned]
    budget = sum(tuner.budget for tuner in tuners)
    bar = progress_bar(budget, "trial", progress, desc="tuning")
    with bar, closing(queue.run(open_engine)) as finished:
        while True:
            for tuner in tuners:
                bar.update(tuner.advance())
                # In the order of their runs: training blocks have the indices -1, -2, and so on.
                missing = sorted(tuner.missing, key=lambda task: abs(task.index))
                queue.add(missing, experiment.plugins)
            if not any(tuner.missing for tuner in tuners):
                break
            task, result = next(finished)
            if isinstance(result, Exception):
                # The filter failed with these values: drop its blocks that wait.
                for dropped_task in queue.give_up(task, result):
                    for tuner in tuners:
                        tuner.receive(dropped_task, None)
            else:
                blocks.put(task, result)
                block = stored_block(store, task)
                for tuner in tuners:
                    tuner.receive(task, block)
        next(finished, None)  # no block is left: this closes the engine
    return {tuner.label: tuner.record for tuner in tuners}


class StoredTrials(NamedTuple):
    """Trials of one tuned filter whose blocks are stored, and the number of the others."""

    record: Record
    """trials up to the first one with a missing block"""
    missing: int
    """number of trials, at most, that `tune` would have to compute"""


def stored_trials(
    experiment: Experiment, store: BlockStore, fresh: bool = False
) -> dict[str, StoredTrials]:
    """Repeat the search of every tuned filter with the blocks of the ``store``.

    Return the trials by the filter's label. A search ends where a block is missing. With ``fresh`` the
    store has no blocks.
    """
    blocks = _SessionBlocks(store, fresh)
    trials_by_label = {}
    for label in experiment.tuned:
        tuner = _Tuner(experiment, label, blocks)
        tuner.advance()
        has_ended = not tuner.missing
        missing = 0 if has_ended else tuner.budget - len(tuner.record.trials)
        trials_by_label[label] = StoredTrials(record=tuner.record, missing=missing)
    return trials_by_label


class _SessionBlocks:
    """Blocks of the store; if ``fresh``, only those that this session has computed."""

    def __init__(self, store: BlockStore, fresh: bool) -> None:
        self._store = store
        self._fresh = fresh
        self._finished: set[BlockTask] = set()

    def get(self, task: BlockTask) -> PackedBlock | None:
        """Return a block, or None if it is to be computed.

        With ``fresh`` only the blocks that this session finished are taken from the store.
        """
        if self._fresh and task not in self._finished:
            return None
        return self._store.get(task)

    def put(self, task: BlockTask, results: dict[int, BlockResult]) -> None:
        self._store.put(task, results)
        self._finished.add(task)


class _Tuner:
    """Search of one filter with the blocks that it waits for."""

    def __init__(
        self,
        experiment: Experiment,
        label: str,
        blocks: _SessionBlocks,
        failed: Mapping[tuple[object, ...], str] = MappingProxyType({}),
    ) -> None:
        """Begin the search for the filter ``label``, and request its first trials.

        ``blocks`` has the finished blocks, and ``failed`` the reasons why filters failed, by
        `algorithm`.
        """
        self.label = label
        self.budget = experiment.settings.tuning.evaluations
        self.training = Training(experiment, label)
        self.record = Record(experiment.tuned[label])
        self.missing: set[BlockTask] = set()
        """blocks of the requested trials that are to be computed"""
        self._blocks = blocks
        self._failed = failed
        self._search = Search(self.training.axes, self.training.start, self.budget)
        self._search_requests = self._search.run()
        self._requested: dict[Values, list[BlockTask]] = {}
        """tasks of each requested trial, by the values of its keys; empty once the search has ended"""
        self._results: dict[BlockTask, PackedBlock | None] = {}
        """finished blocks of the requested trials; None for a block whose filter failed"""
        self._request(next(self._search_requests))

    def advance(self) -> int:
        """Continue the search as far as finished blocks allow; return the number of new trials.

        Blocks that the next trials need are added to ``missing``.
        """
        trials_before = len(self.record.trials)
        keys = [axis.key for axis in self.record.axes]
        while self._requested and not self.missing:
            # Step 1: score the requested trials, as all of their blocks are complete.
            trials = {}
            for values, tasks in self._requested.items():
                value_by_key = dict(zip(keys, values, strict=True))
                trial = Trial.of(value_by_key, self._score(tasks))
                if trial.has_failed and not self.record.first_failure:
                    self.record.first_failure = self._why_failed(values, tasks)
                trials[values] = trial
            self.record.trials += trials.values()
            self.record.cpu_s += sum(block.cpu_s for block in self._results.values() if block)
            self._results.clear()
            # Step 2: send their ranks to the search, and request its next values.
            ranks = {values: trial.rank for values, trial in trials.items()}
            try:
                self._request(self._search_requests.send(ranks))
            except StopIteration:
                self._requested = {}
        return len(self.record.trials) - trials_before

    def receive(self, task: BlockTask, result: PackedBlock | None) -> None:
        """Record the results of a block, None if its filter failed; ignore a block not waited for."""
        if task in self.missing:
            self.missing.remove(task)
            self._results[task] = result

    def _request(self, trial_values: list[Values]) -> None:
        """Request trials with these values: look up their blocks, and note those that are missing.

        The values of a trial are in the order of the tuned keys. A trial has a task for each block of
        training runs. ``_blocks`` are the finished ones of all trials, and ``_results`` collects those
        of the requested trials until these are scored.
        """
        self._requested = {values: self.training.tasks(values) for values in trial_values}
        for tasks in self._requested.values():
            for task in tasks:
                result = self._blocks.get(task)
                if result is None:
                    self.missing.add(task)
                else:
                    self._results[task] = result

    def _score(self, tasks: list[BlockTask]) -> RunEstimate | None:
        """Return the objective of a trial over its blocks; None for an invalid or failed filter.

        An invalid filter has no blocks.
        """
        blocks = []
        for task in tasks:
            block = self._results.get(task)
            if block is None:
                return None
            blocks.append(block)
        if not blocks:
            return None
        return self.training.score(blocks)

    def _why_failed(self, values: Values, tasks: list[BlockTask]) -> str:
        """Return the reason why the trial with these values failed; it has no tasks if it is invalid."""
        if not tasks:
            return self.training.why_invalid(values)
        return self._failed.get(algorithm(tasks[0]), "")


class Training:
    """Training runs of one filter of an experiment; the runs are the same for every filter."""

    def __init__(self, experiment: Experiment, label: str) -> None:
        """Take the scenario, the axes and the objective of the filter ``label`` from the experiment."""
        self.axes: tuple[Axis, ...] = experiment.tuned[label]
        self._experiment = experiment
        self._label = label
        assert experiment.training is not None
        self._point = experiment.training
        # A scenario may have another one for training: the first part of its recordings.
        self._scenario = self._point.scenario.training or self._point.scenario
        metric = experiment.settings.tuning.metric
        assert metric is not None
        # The number of the state's components in each NEES is that of the whole scenario.
        self.objective = Objective.of(metric, sizes_of_nees(self._point.scenario))

    @property
    def start(self) -> Shares:
        """Place at which the search starts: that of the config's own values."""
        return first_place(self.axes, configured_values(self._experiment, self._label))

    @property
    def first_tasks(self) -> list[BlockTask]:
        """Tasks of the first trial, with the config's own values."""
        start = zip(self.axes, self.start, strict=True)
        values = tuple(axis.at(share) for axis, share in start)
        return self.tasks(values)

    def tasks(self, values: Values) -> list[BlockTask]:
        """Return the tasks of a trial: its training runs in blocks, as few as its particles allow.

        ``values`` are those of the tuned keys, in the order of the axes. There are no tasks if the
        filter would be invalid with these values.
        """
        trial = self._make_trial(values)
        if not isinstance(trial, tuned_filters.Trial):  # a list of mistakes
            return []
        return [self._block_task(trial, i) for i in range(self._number_of_blocks(trial))]

    def why_invalid(self, values: Values) -> str:
        """Return the first mistake of a filter that is invalid with these values; empty without any."""
        trial = self._make_trial(values)
        return "" if isinstance(trial, tuned_filters.Trial) else trial[0].message

    def _make_trial(self, values: Values) -> tuned_filters.Trial | list[Problem]:
        """Build the filter with these values of the tuned keys, or return its mistakes."""
        keys = [axis.key for axis in self.axes]
        chosen = dict(zip(keys, values, strict=True))
        return tuned_filters.make_trial(self._experiment.source, self._point, self._label, chosen)

    def score(self, blocks: Iterable[PackedBlock]) -> RunEstimate:
        """Return the objective of a trial over its ``blocks``, with its standard error.

        Raises UserError if a metric of the objective is missing.
        """
        # The metrics of the trial's runs (M,) by name.
        per_run = merge(blocks, self._experiment.settings.tuning.runs).per_run
        for name in self.objective.metrics:
            if name not in per_run:  # the metrics of recorded data are not all known beforehand
                message = f"{self._label} has no {name!r} here"
                raise UserError(self._experiment.source.problem(("tuning", "metric"), message))
        return self.objective.score(per_run)

    def _number_of_blocks(self, trial: tuned_filters.Trial) -> int:
        """Return the number of blocks of a trial, each with as many runs as config or filter allow."""
        widest = self._experiment.settings.block
        if not isinstance(widest, int):  # "fit" or None: the config gives no number of runs
            # By the filter's number of particles and the length of the track.
            widest = block_width(trial.filter, self._scenario)
        return ceil(self._experiment.settings.tuning.runs / widest)

    def _block_task(self, trial: tuned_filters.Trial, number: int) -> BlockTask:
        """Return the task of the trial's block of this number, counted from 0.

        The blocks are equally wide, and no wider than necessary. Only the last one may have fewer runs.
        """
        settings = self._experiment.settings
        width = ceil(settings.tuning.runs / self._number_of_blocks(trial))
        # An RMSD is the RMS difference from the estimates of the reference filter, which then runs, too.
        # Without a reference in the config there is no such metric.
        reference = None
        if any(name.startswith("rmsd") for name in self.objective.metrics):
            reference = self._point.filters[settings.reference or ""]
        # Metrics without their windows.
        metric_names = [name.partition("[")[0] for name in self.objective.metrics]
        return BlockTask(
            scenario=self._scenario,
            filter=trial.filter,
            assume=trial.assume,
            seed=settings.seed,
            index=-1 - number,  # negative: other runs than those of the results
            width=width,
            runs_used=min(width, settings.tuning.runs - number * width),
            reference=reference,
            reference_assume=self._point.assumed.get(settings.reference or ""),
            predictive_metrics=predictions_for(metric_names),
            hold_out=settings.hold_out,
        )
