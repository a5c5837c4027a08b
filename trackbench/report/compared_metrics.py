"""Metrics, and their statistic over the runs, by which filters are compared and ranked."""

from collections.abc import Mapping, Sequence
from typing import Any

from trackbench.evaluation.metric_expression import measured
from trackbench.metrics import joined

BEST_SETTINGS = "best-settings"
"""Kind of the table of the best values, which a sweep adds to those of the config."""


def primary_metrics(metrics: list[str]) -> list[str]:
    """Select metrics over the whole run that filters are compared by: RMSE, CRPS and log scores.

    More is better of a log score, and less of the others.
    """
    primary = []
    for name in metrics:
        m = measured(name)
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


def compared_statistics(config: Mapping[str, Any]) -> dict[str, str]:
    """Return the statistic, mean or rms, by which filters are compared, for each metric of a table.

    It is that of the first column with the metric in the tables of kind `metrics` of the ``config``.
    """
    statistics: dict[str, str] = {}
    for table in (config.get("tables") or {}).values():
        if table.get("kind") != "metrics":
            continue
        for text in table["columns"].values():
            m = measured(text)
            is_plain = not (m.window or m.steps or m.relation)
            if is_plain and m.statistic in ("mean", "rms"):
                statistics.setdefault(m.metric, m.statistic)
    return statistics


def compared_statistic(config: Mapping[str, Any], metric: str) -> str:
    """Return the statistic of a metric by which filters are compared, mean or rms.

    A config without tables has a default table of rms errors. The table that a sweep adds does not
    count, so that `run` and `sweep` of one config have one statistic. A metric that is in no table is
    compared by its mean if the config has tables.
    """
    tables = (config.get("tables") or {}).values()
    has_tables = any(table.get("kind") != BEST_SETTINGS for table in tables)
    default = "rms" if not has_tables and measured(metric).is_error else "mean"
    return compared_statistics(config).get(metric, default)


def with_statistic(statistic: str, metric: str) -> str:
    """Name a number over the runs: ``rmse_position`` of a mean, else ``rms(rmse_position)``."""
    if statistic == "mean":
        return metric
    return f"{statistic}({metric})"
