"""Mean or rms over the runs: the statistic of a metric by which filters are compared and ranked."""

from collections.abc import Mapping
from typing import Any

from trackbench.config.added_tables_and_figures import exhibits_without_tuning
from trackbench.evaluation.metric_expression import measured

_BEST_SETTINGS = "best-settings"
"""Kind of the table of the best values, which a sweep adds to those of the config."""


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

    For a metric that is in no table it is the `default_statistic`.
    """
    return compared_statistics(config).get(metric, default_statistic(config, metric))


def with_statistic(statistic: str, metric: str) -> str:
    """Name a number over the runs: ``rmse_position`` of a mean, else ``rms(rmse_position)``."""
    if statistic == "mean":
        return metric
    return f"{statistic}({metric})"


def default_statistic(config: Mapping[str, Any], metric: str) -> str:
    """Return the statistic by which filters are compared on a metric in no table: mean or rms.

    A config without tables has the default table of rms errors: errors are compared by their rms. If the
    config has tables, the statistic is the mean. The tables that a sweep and tuning add do not count, so
    that a config has one statistic with and without them.
    """
    tables = config.get("tables") or {}
    names = exhibits_without_tuning(tables)
    has_tables = any(tables[name].get("kind") != _BEST_SETTINGS for name in names)
    return "rms" if not has_tables and measured(metric).is_error else "mean"
