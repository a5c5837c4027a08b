"""Metrics that an experiment requests from its filters: predictions, and each run's contributions."""

import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain

from trackbench.config.experiment import Experiment
from trackbench.config.metric_checks import asked_by_parts
from trackbench.evaluation.block import Kind
from trackbench.evaluation.metric_expression import Measure, measured
from trackbench.evaluation.run_contributions import series_of

_OF_SCORE = ("log_score", "log_likelihood")
_OF_PREDICTIONS = re.compile(
    r"(rmse|bias|std|squared|error)_predicted_.+|anis|innovations|autocorrelation_.+"
)


def requested_predictions(experiment: Experiment) -> tuple[Kind, ...]:
    """Return the requested predictions; all of them for scenarios without a truth."""
    if not all(p.scenario.has_truth for p in experiment.points):
        return ("score", "prediction")
    return kinds_of(m.metric for m in _measures(experiment))


def kinds_of(metrics: Iterable[str]) -> tuple[Kind, ...]:
    """Return the predictions that metrics of these names need, without statistic and window."""
    names = set(metrics)
    heads = {name.partition("_")[0] for name in names}
    wanted: dict[Kind, bool] = {
        "score": not names.isdisjoint((*_OF_SCORE, "likelihood_ratio")),
        "prediction": any(map(_OF_PREDICTIONS.fullmatch, names)),
        "calibration": not heads.isdisjoint(("pit", "coverage", "nci", "rank")),
        "ranks": "rank" in heads,
        "crps": "crps" in heads,
        "likelihood_ratio": "likelihood_ratio" in names,
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


def takes_times(experiment: Experiment) -> bool:
    """Return whether a table, a figure, a published number or a claim names CPU times."""
    return any(m.is_cpu_time for m in _measures(experiment))


@dataclass(frozen=True)
class Contributions:
    """Measures that per_run.csv has each run's share in, since anything asks for them.

    Those that every filter has shares in; and those of many steps, by label: these are many.
    """

    everywhere: tuple[Measure, ...]
    of_steps: Mapping[str, tuple[Measure, ...]]

    @property
    def series(self) -> list[str]:
        """Return names of the series that the shares are made of."""
        found = map(series_of, (*self.everywhere, *chain(*self.of_steps.values())))
        return list(dict.fromkeys(name for name in found if name is not None))

    def of(self, label: str, steps: Sequence[int]) -> list[Measure]:
        """Return a filter's contributions, each at one step, for a scenario with these steps."""
        found = chain(*(many.at_each(steps) for many in self.of_steps.get(label, ())))
        return list(dict.fromkeys([*self.everywhere, *found]))


def requested_contributions(experiment: Experiment) -> Contributions:
    """Return the contributions that tables, figures and published files request."""
    asked = [asked.measure for asked in asked_by_parts(experiment.parts)]
    asked += experiment.published.expressions
    everywhere = {m.plain for m in asked if not m.is_many and series_of(m.plain) is not None}
    of_steps: dict[str, dict[Measure, None]] = defaultdict(dict)
    for claim in experiment.published.claims:
        for expression in claim.expressions:
            for label in filter(None, [*claim.labels, expression.other]):
                if expression.is_many:
                    of_steps[label][expression.plain] = None
    return Contributions(
        tuple(sorted(everywhere, key=str)), {label: tuple(m) for label, m in of_steps.items()}
    )
