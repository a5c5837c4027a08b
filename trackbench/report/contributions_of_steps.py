"""Contributions of the steps of one recorded run to the numbers by which filters are compared."""

import numpy as np

from trackbench.core.arrays import Array
from trackbench.evaluation.metric_expression import measured
from trackbench.report.primary_metrics import primary_metrics
from trackbench.results.points_json import GridPoint
from trackbench.results.read_folder import ResultsFolder


def contributions_of_steps(
    results: ResultsFolder, point: GridPoint
) -> dict[tuple[str, str], Array]:
    """Return what each step (T,) of a recording's one run adds to a number, by (filter, metric).

    The metrics are those by which filters are compared: RMSE, CRPS and log scores over the whole run.
    The mean over the steps is the number. The steps are those that count; one without a value is NaN.
    The mapping is empty unless the results are those of one recorded run.
    """
    judged = results.facts(point).judged
    if not judged:
        return {}
    first_step, last_step = judged
    runs = results.runs(point)
    per_step = results.columns("per_step", point)
    values_by_metric = {}
    for label, metric in runs:
        series = per_step.where(filter=label, metric=metric)
        if metric not in primary_metrics([metric]) or not len(series):
            continue
        steps = series["step"]
        series = series.chosen((steps >= first_step) & (steps <= last_step))
        values = np.full(last_step - first_step + 1, np.nan)
        values[series["step"].astype(int) - first_step] = series["value"]
        # R = sqrt(mean e^2) changes by (e^2 - R^2) / (2 R) per step, to first order. The step's value is
        # R with this change: (R + e^2 / R) / 2.
        if measured(metric).definition.name == "rmse":
            rmse = float(runs[label, metric][0])
            values = 0.5 * (rmse + np.square(values) / rmse) if rmse else 0.0 * values
        values_by_metric[label, metric] = values
    return values_by_metric
