"""Requested numbers over steps for which per_run.csv stores the share of each run."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from trackbench.config.experiment import Experiment
from trackbench.config.requested_metrics import requests_of
from trackbench.evaluation.metric_expression import Measure
from trackbench.evaluation.run_contributions import series_of


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
