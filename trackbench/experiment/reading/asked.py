"""What an experiment asks its filters to say of measurements before they are given them."""

import re
from collections.abc import Iterable, Iterator
from itertools import chain

from trackbench.evaluation.block import Kind
from trackbench.evaluation.measure import Measure, measured
from trackbench.experiment.reading.definition import Experiment
from trackbench.experiment.reading.metric_checks import asked_by_parts

_OF_SCORE = ("log_score", "log_likelihood")
_OF_PREDICTIONS = re.compile(
    r"(rmse|bias|std|squared|error)_predicted_.+|anis|innovations|autocorrelation_.+"
)


def foretold(experiment: Experiment) -> tuple[Kind, ...]:
    """What any part of the config names; without a truth it is all that can be said, and is."""
    if not all(p.scenario.has_truth for p in experiment.points):
        return ("score", "prediction")
    return kinds_of(m.metric for m in _measures(experiment))


def kinds_of(metrics: Iterable[str]) -> tuple[Kind, ...]:
    """What has to be told for metrics of these names, without statistic and window."""
    names = set(metrics)
    heads = {name.partition("_")[0] for name in names}
    wanted: dict[Kind, bool] = {
        "score": not names.isdisjoint((*_OF_SCORE, "evidence")),
        "prediction": any(map(_OF_PREDICTIONS.fullmatch, names)),
        "calibration": not heads.isdisjoint(("pit", "coverage", "nci", "rank")),
        "ranks": "rank" in heads,
        "crps": "crps" in heads,
        "evidence": "evidence" in names,
    }
    return tuple(kind for kind, is_wanted in wanted.items() if is_wanted)


def _measures(experiment: Experiment) -> Iterator[Measure]:
    settings = experiment.settings
    named = (settings.medians, settings.metrics or (), settings.per_step or (), settings.until)
    yield from map(measured, chain(*named))
    if settings.tune:
        metric = settings.tuning.metric or ()
        yield from map(measured, [metric] if isinstance(metric, str) else metric)
    yield from (asked.measure for asked in asked_by_parts(experiment.parts))
    yield from experiment.published.expressions
