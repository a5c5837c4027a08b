"""Metrics by which filters are compared and ranked: RMSE, CRPS and log scores; named errors first."""

from collections.abc import Mapping, Sequence
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
