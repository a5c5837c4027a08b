"""Training runs of a filter, and the metric that scores its trials."""

from collections.abc import Iterator, Mapping
from math import ceil
from typing import Any

from trackbench.config.dump import as_config
from trackbench.config.experiment import Experiment
from trackbench.config.requested_metrics import predictions_for
from trackbench.config.tuned_entries import Trial, make_trial
from trackbench.config.tuning import Axis, Objective, Score
from trackbench.core.arrays import Array
from trackbench.errors import UserError
from trackbench.evaluation.block import BlockTask
from trackbench.evaluation.consistency import sizes
from trackbench.execution.plan import block_width
from trackbench.tuning.search import Shares, Values


class Training:
    """Training runs of one filter of an experiment; the runs are the same for every filter."""

    def __init__(self, experiment: Experiment, label: str) -> None:
        self.axes: tuple[Axis, ...] = experiment.tuned[label]
        self._experiment, self._label = experiment, label
        assert experiment.training is not None
        self._point = experiment.training
        self._scenario = self._point.scenario.training or self._point.scenario
        metric = experiment.settings.tuning.metric
        assert metric is not None
        self.objective = Objective.of(metric, sizes(self._point.scenario))

    @property
    def start(self) -> Shares:
        """Return the shares of the config's own values; the middle for values outside the axes."""
        given = given_values(self._experiment, self._label)
        shares = (axis.share(given.get(axis.key)) for axis in self.axes)
        return tuple(0.5 if share is None else share for share in shares)

    def tasks(self, values: Values) -> list[BlockTask]:
        """Return the blocks of a trial, as few as its particles allow; none if the filter is
        invalid.
        """
        keys = [axis.key for axis in self.axes]
        chosen = dict(zip(keys, values, strict=True))
        trial = make_trial(self._experiment.source, self._point, self._label, chosen)
        if not isinstance(trial, Trial):
            return []
        return [self._block(trial, i) for i in range(self._blocks(trial))]

    def score(self, per_run: Mapping[str, Array]) -> Score:
        """Return the score of a trial's values per run; raises UserError if the metric is
        missing.
        """
        for name in self.objective.metrics:
            if name not in per_run:  # of recorded data it is not known beforehand what there is
                what = f"{self._label} has no {name!r} here"
                raise UserError(self._experiment.source.problem(("tuning", "metric"), what))
        return self.objective.score(per_run)

    def _blocks(self, trial: Trial) -> int:
        return ceil(self._experiment.settings.tuning.runs / self._most(trial))

    def _most(self, trial: Trial) -> int:
        asked = self._experiment.settings.block
        return asked if isinstance(asked, int) else block_width(trial.filter, self._scenario)

    def _block(self, trial: Trial, number: int) -> BlockTask:
        """Return a block: all but the last are full, and none is wider than necessary."""
        settings = self._experiment.settings
        width = ceil(settings.tuning.runs / self._blocks(trial))
        measured = any(name.startswith("rmsd") for name in self.objective.metrics)
        return BlockTask(
            scenario=self._scenario,
            filter=trial.filter,
            assume=trial.assume,
            seed=settings.seed,
            index=-1 - number,
            width=width,
            runs_used=min(width, settings.tuning.runs - number * width),
            reference=self._point.filters[settings.reference or ""] if measured else None,
            predictive_metrics=predictions_for(
                name.partition("[")[0] for name in self.objective.metrics
            ),
            hold_out=settings.hold_out,
        )


def given_values(experiment: Experiment, label: str) -> dict[str, Any]:
    """Return the values of a filter's own keys by path, with presets and defaults."""
    point = experiment.points[0]
    config = as_config((point.filters | experiment.left_out)[label])
    if label in point.assumed:
        config["assume"] = as_config(point.assumed[label])
    return dict(_flat(config))


def _flat(part: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    if not isinstance(part, dict | list):
        yield path, part
        return
    for key, value in part.items() if isinstance(part, dict) else enumerate(part):
        yield from _flat(value, f"{path}.{key}" if path else str(key))
