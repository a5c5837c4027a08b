"""Metrics that filters can be ranked by, the one that ranks them, and those shown by default."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from trackbench.evaluation.metric_expression import Measure, measured
from trackbench.report.findings.metric_phrases import head_of
from trackbench.report.mean_or_rms_of_metric import compared_statistic, compared_statistics
from trackbench.report.primary_metrics import named_errors_first, primary_metrics
from trackbench.report.tables_and_figures import Results

_MOST_ERRORS = 2
"""Number of errors that are shown by default."""


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


def shown_metrics(results: Results) -> dict[str, Measure]:
    """Return the default metrics by axis label: the first errors or log scores, and ANEES or ANIS.

    Only metrics of summary.csv are returned.
    """
    stored = set(results.columns("summary")["metric"])
    by_label: dict[str, Measure] = {}
    # Errors and log scores have the statistic over the runs by which the filters are ranked.
    for name in ranking_metrics(results)[:_MOST_ERRORS]:
        statistic = compared_statistic(results.config, name)
        metric = measured(f"{statistic}({name})")
        if str(metric) in stored:
            by_label[head_of(statistic, metric)] = metric
    if "anees" in stored:
        by_label["ANEES"] = measured("anees")
    elif "mean(anis)" in stored:
        anis = measured("mean(anis)")
        by_label[head_of("mean", anis)] = anis
    return by_label
