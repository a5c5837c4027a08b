"""Names of metrics: what a config may keep, and what it may ask for."""

import re

from trackbench.experiment.definition import Settings

_STATISTIC = re.compile(r"[a-z-]+\((.+)\)")


def base_name(metric: str) -> str:
    """``rmse_position`` of ``mean(rmse_position[turns])``; ``nees`` of ``anees``, a mean of it."""
    inside = _STATISTIC.fullmatch(metric)
    name = (inside.group(1) if inside else metric).partition("[")[0]
    return name.removeprefix("a") if name.startswith("anees") else name


def kept_metrics(settings: Settings, file: str) -> frozenset[str] | None:
    """Base names of the metrics that a CSV file keeps; None keeps all of them."""
    names = settings.metrics
    if file == "per_step.csv" and settings.per_step is not None:
        names = settings.per_step
    return None if names is None else frozenset({"lost", *map(base_name, names)})
