"""Metrics by which filters are compared and ranked: RMSE, CRPS and log scores; named errors first."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

from trackbench.evaluation.metric_expression import measured
from trackbench.metrics import joined


def primary_metrics(metrics: list[str]) -> list[str]:
    """Select metrics over the whole run that filters are compared by: RMSE, CRPS and log scores.

    ``metrics`` are names such as ``rmse_position``. Names with a statistic, a step, a window or a second
    filter are left out. More is better of a log score, and less of the others.
    """
    primary = []
    for name in metrics:
        m = measured(name)
        # `is_row` is True for the name of a metric without statistic, step and second filter.
        if not m.is_row or m.window:
            continue
        if m.definition.name in ("rmse", "crps") or m.definition.is_score:
            primary.append(name)
    return primary


def named_errors_first(config: Mapping[str, Any], errors: Sequence[str]) -> list[str]:
    """Sort metrics such as ``rmse_position``: those that the ``config`` names under `score` come first.

    The first one ranks the filters. A user who writes ``score: {errors: {position: [px, py]}}`` is
    interested in that error.
    """
    scenario = config.get("scenario") or {}
    score = scenario.get("score") or {}
    names = [joined("rmse", name) for name in score.get("errors") or {}]
    first = [name for name in names if name in errors]
    return [*first, *(name for name in errors if name not in first)]


def errors_and_scores(
    summary: Iterable[Mapping[str, Any]], labels: Collection[str]
) -> dict[str, list[str]]:
    """Return the names of the errors and scores over whole runs of each filter, by label.

    ``summary`` are the rows of summary.csv. Rows of other filters than ``labels`` do not count. An error
    that no run has, although none is lost, is not measured, and is left out.
    """
    # A dict in place of a set: the names keep their order.
    metrics_by_label: dict[str, dict[str, None]] = {}
    for row in summary:
        measure = measured(row["metric"])
        is_measured = row["runs"] > 0 or row["lost"] > 0
        if is_measured and not measure.window and row["filter"] in labels:
            metrics = metrics_by_label.setdefault(row["filter"], {})
            metrics |= dict.fromkeys(primary_metrics([measure.metric]))
    return {label: list(metrics) for label, metrics in metrics_by_label.items()}
