"""Metrics that the CSV files store: those of the keys `metrics` and `per_step`, and some always."""

from trackbench.config.experiment_keys import Settings
from trackbench.evaluation.metric_expression import measured
from trackbench.metrics import metric_of


def stored_metrics(settings: Settings, file: str) -> frozenset[str] | None:
    """Name the metrics that a CSV file stores, without statistics; None stands for all metrics."""
    if file == "per_step.csv" and settings.per_step is not None:
        return frozenset(measured(name).base for name in settings.per_step)
    if settings.metrics is None:
        return None
    bases = [measured(name).base for name in settings.metrics]
    return frozenset(["lost", "gated", *bases])  # the first two are always stored


def is_stored(stored: frozenset[str] | None, base: str) -> bool:
    """Test whether a file with these `stored_metrics` has the metric of this base name.

    If it stores all metrics (None), metrics that are stored on request only are still left out.
    """
    if stored is not None:
        return base in stored
    metric, _ = metric_of(base)
    return not metric.on_request
