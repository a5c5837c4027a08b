"""per_step.csv held against per_run.csv and summary.csv.

An average over runs and then over steps is one over steps and then over runs, so that every value of
per_step.csv has a part in a number that is known. Standard errors have it where the mean over time of
an RMSE is kept; medians and standard deviations have not.
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from trackbench.core.arrays import Array
from trackbench.evaluation.derived import sizes
from trackbench.evaluation.summary import SummaryRow
from trackbench.experiment.reading.definition import Point
from trackbench.report.results import Results
from trackbench.scenarios.base import Scenario, in_window
from trackbench.verification.findings import Finding, changed
from trackbench.verification.summaries import HALF, near, stored_rows

if TYPE_CHECKING:
    import pandas as pd


def follow_from_steps(
    results: Results, points: list[tuple[dict[str, Any], Point]]
) -> Iterator[Finding]:
    """Averages over the steps that do not agree with what is stored of the runs, at these points."""
    checked = [
        ((*point.values(), label, metric, window), agrees)
        for point, here in points
        for label, metric, window, agrees in _averages(results, point, here)
    ]
    wrong = [key for key, agrees in checked if not agrees]
    if wrong:
        what = (
            "averages over steps are not those of per_run.csv or summary.csv; the first is that of"
        )
        first = ", ".join(map(str, filter(None, wrong[0])))
        yield changed(f"per_step.csv: {len(wrong)} of {len(checked)} {what} {first}")


def _averages(
    results: Results, point: dict[str, Any], here: Point
) -> Iterator[tuple[str, str, str, bool]]:
    """Filter, metric and window of each average at a point, and whether it agrees."""
    runs, summary = results.runs(point), stored_rows(results, point)
    frame = results.at(results.per_step, point)
    for (label, metric), rows in frame.groupby(["filter", "metric"], sort=False):
        if label not in here.filters:
            continue
        counts = here.filters[label].counts
        at = np.searchsorted(here.scenario.steps, rows["step"])
        for window, mask in here.scenario.windows.items():
            inside = rows[mask[at]]
            mean = summary.get((label, f"time-mean({in_window(metric, window)})"))
            if mean is not None:
                shared = (label, mean.metric) in runs
                yield label, metric, window, _is_time_mean(inside, mean, shared)
            values = runs.get((label, in_window(_of_runs(metric), window)))
            if values is not None:
                found = values[~np.isnan(values)]
                if len(inside) and (inside["runs"] == len(found)).all():
                    scale = 1.0 / _size(metric, here.scenario)
                    agrees = _agree(metric, inside["value"].to_numpy(), found * scale, counts)
                    yield label, metric, window, agrees


def _is_time_mean(rows: "pd.DataFrame", stored: SummaryRow, shared: bool) -> bool:
    """Whether a row is the mean over the steps; of standard errors, too, where no run has a share."""
    value, stderr = rows["value"].to_numpy(), rows["stderr"].to_numpy()
    return (
        len(rows) > 0
        and stored.runs == rows["runs"].max()
        and near(stored.value, value.mean(), HALF["per_step.csv"] * value.mean())
        and (shared or near(stored.stderr, stderr.mean(), HALF["per_step.csv"] * stderr.mean()))
    )


def _of_runs(metric: str) -> str:
    """The metric of per_run.csv that has the same average; none of this name if there is none."""
    return metric.removeprefix("a") if metric.startswith("anees") else metric


def _size(metric: str, scenario: Scenario) -> int:
    """By what a normalised error is divided per step."""
    return sizes(scenario)[metric.partition("_")[2]] if metric.startswith("anees") else 1


@np.errstate(all="ignore")
def _agree(metric: str, steps: Array, runs: Array, counts: frozenset[str]) -> bool:
    """Whether values per step (T,) and per run (M,) have one average: root mean square, sum or mean."""
    if metric.startswith(("rmse", "distance")):
        a, b = (float(np.sqrt(np.square(x).mean())) for x in (steps, runs))
    else:
        a = float(steps.sum() if metric in counts else steps.mean())
        b = float(runs.mean())
    room = HALF["per_step.csv"] * np.abs(steps).mean() * (len(steps) if metric in counts else 1)
    return near(a, b, room + HALF["per_run.csv"] * np.abs(runs).mean(), "per_step.csv")
