"""Differences of every two filters on common runs, with the word of the rule for filters; paired.csv."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from trackbench.core.arrays import Array
from trackbench.evaluation.metric_expression import measured
from trackbench.report.mean_or_rms_of_metric import compared_statistic, with_statistic
from trackbench.report.primary_metrics import primary_metrics
from trackbench.statistics.compare_all_pairs import compare_all
from trackbench.statistics.comparison import Comparison, Sample


class Pair(NamedTuple):
    """Two filters with the comparison of a metric."""

    filter_a: str
    filter_b: str
    metric: str
    """`rmse` of the mean over the runs, `rms(rmse)` of another statistic"""
    comparison: Comparison
    """of ``filter_a`` with ``filter_b``"""

    @property
    def word(self) -> str:
        """Better, worse, no significant difference, equal or untested: the word on ``filter_a``."""
        return self.comparison.word(measured(self.metric).definition.more_is_better)

    @property
    def cells(self) -> list[Any]:
        """Columns of paired.csv after those of the grid."""
        difference = self.comparison.difference
        return [
            *[self.filter_a, self.filter_b, self.metric],
            *[difference.value, difference.stderr, self.comparison.z, difference.runs],
        ]


COLUMNS = ("filter_a", "filter_b", "metric", "difference", "stderr", "z", "runs")
"""Columns of paired.csv after those of the grid."""


def every_pair(
    config: Mapping[str, Any],
    labels: Sequence[str],
    runs: Mapping[tuple[str, str], Array],
    steps: Mapping[tuple[str, str], Array],
) -> list[Pair]:
    """Compare every two filters at one point of the grid, by each metric that filters are compared by.

    Parameters
    ----------
    config
        config of the experiment, which decides the statistic of each metric
    labels
        labels of the filters, in order
    runs
        values of the runs (M,) by (filter, metric)
    steps
        what each step (T,) adds to a number of the one run of a recording; empty for several runs. A
        sample with steps is compared step by step.
    """
    metrics = list(dict.fromkeys(metric for _, metric in runs))
    pairs: list[Pair] = []
    for metric in primary_metrics(metrics):
        statistic = compared_statistic(config, metric)
        samples = {}
        for label in labels:
            key = (label, metric)
            if key in runs:
                samples[label] = Sample.from_values(runs[key], statistic, steps=steps.get(key))
        pairs += pairs_of(metric, samples)
    return pairs


def pairs_of(metric: str, samples: Mapping[str, Sample]) -> list[Pair]:
    """Compare every two filters that have common runs.

    ``samples`` has each filter's values of the ``metric`` over the runs, by label.
    """
    # All samples have the same statistic.
    statistic = next((sample.statistic for sample in samples.values()), "mean")
    name = with_statistic(statistic, metric)
    pairs = []
    for (a, b), comparison in compare_all(samples).items():
        pairs.append(Pair(filter_a=a, filter_b=b, metric=name, comparison=comparison))
    return pairs
