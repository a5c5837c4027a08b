"""Default table and figure of errors, and its statistic, for an experiment that names none."""

import re
from collections.abc import Iterable, Mapping
from typing import Any

from trackbench.evaluation.metric_expression import measure
from trackbench.metrics import unit_of
from trackbench.registry import Group
from trackbench.report.findings import metric_phrases
from trackbench.report.primary_metrics import named_errors_first

_ERROR = re.compile(r"rms\((?P<metric>rmse(?:_(?P<quantity>\w+))?)\)")
"""A row of summary.csv: ``rms(rmse_position)``."""
_MOST_ROWS = 50
"""Of more there is `sweep.csv`."""


def default_keys(
    group: Group, metrics: Iterable[str], points: int, filters: int, config: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the config keys of the default table or figure of errors; empty if there is none.

    ``group`` is "tables" or "figures". The table shows the first two errors over the whole run among
    ``metrics``, the column of that name in summary.csv. Errors that ``config`` names under `score` come
    first. ``points`` and ``filters`` are the numbers of grid points and filters: a table with too many
    rows is left out.

    The values of the keys are those of a config that is read already: `measure` parses the text of a
    metric or of a statistic of a metric, as reading a config does.
    """
    metrics = list(dict.fromkeys(metrics))
    # A match for each row such as rms(rmse_position), by its group "metric", rmse_position. Its group
    # "quantity" is position; it is None for rms(rmse).
    rows = {match["metric"]: match for match in map(_ERROR.fullmatch, metrics) if match}
    errors = [rows[name] for name in named_errors_first(config, [*rows])]
    if group == "figures":
        if points > 1 or not errors:
            return {}
        return {"kind": "rmse-vs-time", "x": "time", "metric": measure(errors[0]["metric"])}
    columns = {}
    for error in errors[:2]:
        words = "RMSE"
        if error["quantity"]:
            words += f" of {error['quantity']}"
        row = error[0]  # the whole text, rms(rmse_position)
        columns[metric_phrases.in_unit(words, unit_of(error["metric"]))] = row
    if errors and "anees" in metrics:
        columns["ANEES"] = "anees"
    if not errors and "mean(nis)" in metrics:
        columns["NIS"] = "mean(nis)"
    if not columns or points * filters > _MOST_ROWS:
        return {}
    measures = {head: measure(text) for head, text in columns.items()}
    return {"kind": "metrics", "title": "Errors over the whole run", "columns": measures}
