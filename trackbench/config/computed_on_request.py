"""Numbers that runs compute only on request: predictions, CPU times, contributions of each run."""

import re
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from trackbench.config.experiment import Experiment
from trackbench.config.requested_metrics import requested_measures, requests_of
from trackbench.evaluation.block import Kind
from trackbench.evaluation.metric_expression import Measure
from trackbench.evaluation.run_contributions import series_of

_SCORE_METRICS = ("log_score", "log_likelihood", "likelihood_ratio")
_PREDICTION_METRICS = re.compile(
    r"(rmse|bias|std|squared|error)_predicted_.+|anis|innovations|autocorrelation_.+"
)


def requested_predictions(experiment: Experiment) -> tuple[Kind, ...]:
    """Return the kinds of predictions that the experiment's metrics need.

    For a recording without a truth these are scores and one-step predictions.
    """
    if not all(p.scenario.has_truth for p in experiment.points):
        return ("score", "prediction")
    return predictions_for(m.metric for m in requested_measures(experiment))


def predictions_for(metrics: Iterable[str]) -> tuple[Kind, ...]:
    """Return the kinds of predictions that ``metrics`` need, which are names without statistic."""
    names = set(metrics)
    heads = {name.partition("_")[0] for name in names}
    requested: dict[Kind, bool] = {
        "score": not names.isdisjoint(_SCORE_METRICS),
        "prediction": any(_PREDICTION_METRICS.fullmatch(name) for name in names),
        "calibration": not heads.isdisjoint(("pit", "coverage", "nci", "rank")),
        "ranks": "rank" in heads,
        "crps": "crps" in heads,
        "likelihood_ratio": "likelihood_ratio" in names,
    }
    return tuple(kind for kind, is_requested in requested.items() if is_requested)


def takes_times(experiment: Experiment) -> bool:
    """Test whether a table, a figure, a published number or a claim names CPU times."""
    return any(m.is_cpu_time for m in requested_measures(experiment))


@dataclass(frozen=True)
class Contributions:
    """Requested numbers over steps for which per_run.csv stores each run's contribution.

    Such a number is a metric at a step, or a mean over steps of a statistic over runs.
    """

    everywhere: tuple[Measure, ...]
    """measures of every filter"""
    of_steps: Mapping[str, tuple[Measure, ...]]
    """measures at many steps, only of the filters that need them, by label"""

    @property
    def series(self) -> list[str]:
        """Names of the series that the contributions are computed from.

        ``everywhere`` are measures of every filter, ``of_steps`` measures of single filters, by label.
        """
        measures = list(self.everywhere)
        for filter_measures in self.of_steps.values():
            measures += filter_measures
        names = [series_of(measure) for measure in measures]
        return list(dict.fromkeys(name for name in names if name is not None))

    def measures_of_filter(self, label: str, steps: Sequence[int]) -> list[Measure]:
        """Return the measures of one filter for which the runs' contributions are stored, each once.

        These are the measures of ``everywhere``, and those of ``of_steps`` under this label. A measure
        over a range of steps becomes one for each step. ``steps`` are the numbers of the steps of a run.
        """
        measures = list(self.everywhere)
        for measure in self.of_steps.get(label, ()):
            measures += measure.at_each(steps)
        return list(dict.fromkeys(measures))


def requested_contributions(experiment: Experiment) -> Contributions:
    """Collect the measures in tables, figures and published files that need each run's contribution."""
    # Step 1: measures of every filter. A comparison of two filters needs the expression of each
    # (`plain`). A measure whose `series_of` is None is no number over steps to which runs contribute.
    measures = [request.measure for request in requests_of(experiment.parts)]
    measures += experiment.published.expressions
    everywhere = set()
    for measure in measures:
        # `is_many`: at a range of steps, for which see step 2.
        if not measure.is_many and series_of(measure.plain) is not None:
            everywhere.add(measure.plain)
    # Step 2: measures at a range of steps, only of the filters that a claim compares.
    of_steps: dict[str, dict[Measure, None]] = defaultdict(dict)
    for claim in experiment.published.claims:
        for expression in claim.expressions:
            if not expression.is_many:
                continue
            # An expression such as a ratio names a filter itself, else `other` is empty.
            for label in (*claim.labels, expression.other):
                if label:
                    of_steps[label][expression.plain] = None
    return Contributions(
        everywhere=tuple(sorted(everywhere, key=str)),
        of_steps={label: tuple(measures) for label, measures in of_steps.items()},
    )
