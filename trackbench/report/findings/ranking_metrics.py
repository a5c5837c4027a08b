"""Metrics that filters can be ranked by, in their order, and the one that ranks them."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from trackbench.evaluation.metric_expression import measured
from trackbench.report.compared_mean_or_rms import compared_statistics
from trackbench.report.compared_metrics import named_errors_first, primary_metrics
from trackbench.report.tables_and_figures import Results


def ranking_metrics(results: Results) -> list[str]:
    """Return the metrics that filters can be ranked by, as `sort_ranking_metrics` sorts them.

    A metric that no filter measures is left out, as an error without a truth at a scored step.
    """
    names: dict[str, None] = {}
    for point in results.points():
        runs = results.runs(point)
        for (label, metric), values in runs.items():
            # A filter may have no value because it lost its runs. The metric is measured all the same.
            lost = runs.get((label, "lost"), np.zeros(len(values)))
            if metric not in names and (lost.any() or not np.isnan(values).all()):
                names[metric] = None
    return sort_ranking_metrics(results.config, list(names))


def sort_ranking_metrics(config: Mapping[str, Any], names: list[str]) -> list[str]:
    """Return those metrics that filters can be ranked by: errors before log scores.

    Errors that the ``config`` names under `score` come first. ``names`` are metrics of per_run.csv.
    """
    metrics = primary_metrics(names)
    errors = [name for name in metrics if measured(name).is_error]
    errors = named_errors_first(config, errors)
    scores = [name for name in ("held_log_score", "log_score") if name in metrics]
    return [*errors, *scores]


def leading_metric(results: Results) -> str:
    """Return the metric that filters are ranked by; empty if there is none."""
    return first_ranking_metric(results.config, ranking_metrics(results))


def first_ranking_metric(config: Mapping[str, Any], metrics: Sequence[str]) -> str:
    """Return the first of the ranking ``metrics`` that a column of a table has, else the first of them.

    Empty if there are none.
    """
    tabulated = [name for name in compared_statistics(config) if name in metrics]
    return next(iter([*tabulated, *metrics]), "")
