"""per_step.csv held against per_run.csv and summary.csv.

An average over runs and then over steps is one over steps and then over runs, so that every value of
per_step.csv has a part in a number that is known. Standard errors have it where the mean over time of
an RMSE is kept; medians and standard deviations have not.
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from trackbench.config.experiment import Point
from trackbench.core.arrays import Array
from trackbench.evaluation.consistency import sizes
from trackbench.evaluation.metric_expression import measured
from trackbench.evaluation.summary import SummaryRow
from trackbench.report.results import Results
from trackbench.scenarios.base import in_window
from trackbench.verify.findings import Finding, changed
from trackbench.verify.summaries import HALF, near, stored_rows

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
        first = ", ".join(map(str, filter(None, wrong[0])))
        what = f"are not those of per_run.csv or summary.csv; the first is that of {first}"
        yield changed(f"per_step.csv: {len(wrong)} of {len(checked)} averages over steps {what}")


def _averages(
    results: Results, point: dict[str, Any], here: Point
) -> Iterator[tuple[str, str, str, bool]]:
    """Filter, metric and window of each average at a point, and whether it agrees."""
    runs, summary = results.runs(point), stored_rows(results, point)
    frame = results.at(results.per_step, point)
    for (label, metric), rows in frame.groupby(["filter", "metric"], sort=False):
        if label not in here.filters:
            continue
        counts = here.filters[label].summed_diagnostics
        at = np.searchsorted(here.scenario.steps, rows["step"])
        for window, mask in here.scenario.windows.items():
            inside = rows[mask[at]]
            mean = summary.get((label, f"time-mean({in_window(metric, window)})"))
            if mean is not None:
                shared = (label, mean.metric) in runs
                yield label, metric, window, _is_time_mean(inside, mean, shared)
            of = measured(metric)
            values = runs.get((label, in_window(of.base, window))) if of.is_row else None
            if values is not None:
                found = values[~np.isnan(values)]
                if len(inside) and (inside["runs"] == len(found)).all():
                    family, quantity = of.family
                    n = sizes(here.scenario)[quantity] if family.per_component else 1
                    how = "sum" if metric in counts else family.over_steps
                    agrees = _agree(how, inside["value"].to_numpy(), found * (1.0 / n))
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


@np.errstate(all="ignore")
def _agree(how: str, steps: Array, runs: Array) -> bool:
    """Whether values per step (T,) and per run (M,) have one rms, sum, last value or mean."""
    if how == "rms":
        a, b = (float(np.sqrt(np.square(x).mean())) for x in (steps, runs))
    else:
        of_steps = {"sum": steps.sum(), "last": steps[-1]}
        a, b = float(of_steps.get(how, steps.mean())), float(runs.mean())
    room = HALF["per_step.csv"] * np.abs(steps).mean() * (len(steps) if how == "sum" else 1)
    return near(a, b, room + HALF["per_run.csv"] * np.abs(runs).mean(), "per_step.csv")
