"""Default tables and figures of an experiment that names none."""

import re
from collections.abc import Iterable
from typing import Any

from trackbench.evaluation.metric_expression import measure
from trackbench.registry import Group

_ERROR = re.compile(r"rms\((rmse(?:_(\w+))?)\)")
_MOST_ROWS = 50
"""Of more there is `sweep.csv`."""


def default_keys(group: Group, metrics: Iterable[str], points: int, filters: int) -> dict[str, Any]:
    """Return keys of the default table or figure; none if too large or unmeasured.

    ``metrics`` are those of summary.csv: the first two errors over the whole run are shown.
    """
    metrics = list(dict.fromkeys(metrics))
    errors = [found for found in map(_ERROR.fullmatch, metrics) if found]
    if group == "figures":
        if points > 1 or not errors:
            return {}
        words = f"RMSE of {errors[0][2]}" if errors[0][2] else "RMSE"
        metric = measure(errors[0][1])
        return {"kind": "rmse-vs-time", "x": "time", "metric": metric, "y_label": words}
    columns = {f"RMSE of {e[2]}" if e[2] else "RMSE": e[0] for e in errors[:2]}
    consistent = {"ANEES": "anees"} if errors else {"NIS": "mean(nis)"}
    columns |= {head: text for head, text in consistent.items() if text in metrics}
    if not columns or points * filters > _MOST_ROWS:
        return {}
    measured = {head: measure(text) for head, text in columns.items()}
    return {"kind": "metrics", "title": "Errors over the whole run", "columns": measured}
