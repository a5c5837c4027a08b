"""Metrics that the CSV files store: those of the keys `metrics` and `per_step`, and some always.

`requested_contributions` has the numbers over steps for which per_run.csv stores each run's share.
"""

from trackbench.config.available_metrics import Names
from trackbench.config.experiment_keys import Settings
from trackbench.config.requested_metrics import MetricRequest, role_and_name
from trackbench.evaluation.metric_expression import Measure, measured
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


def why_not_stored(request: MetricRequest, names: Names, settings: Settings) -> str | None:
    """Explain that a requested metric is not stored in its file; None if it is, or need not be."""
    role, word = role_and_name(request, settings)
    # An efficiency is in no file: it is computed from two metrics.
    if role == "efficiency":
        return _why_not_computable(request.measure, settings)
    stored = stored_metrics(settings, "per_step.csv" if role == "per_step" else "summary.csv")
    # Settings need no file: `metrics` and `per_step` (role base) decide on the files, `medians` names
    # series (role series), and `until` numbers that are computed as the runs go on (role row).
    if role in ("base", "series", "row") or stored is None or request.measure.base in stored:
        return None
    # A request that the config does not name follows from one that it names, or from the kind of table
    # or figure. For the bars of a rank histogram, the problem is that of its transform.
    if request.measure.definition.name == "rank" and not request.named:
        return None
    if word in names.filter_numbers:  # a key of a filter or a CPU time, which no metric file has
        return None
    # A metric that a kind always shows may be none of this experiment.
    if not request.named and word not in names.names_of_role(role):
        return None
    key = "per_step" if role == "per_step" and settings.per_step is not None else "metrics"
    return f"{word!r} is not stored; add it to `{key}`"


def _why_not_computable(measure: Measure, settings: Settings) -> str | None:
    """Explain which metrics an efficiency is computed from that are not stored; None if all are."""
    stored = stored_metrics(settings, "summary.csv")
    if stored is None:
        return None
    missing = [operand.base for operand in measure.made_of() if operand.base not in stored]
    if not missing:
        return None
    names = " and ".join(missing)
    return f"'{measure}' needs {names}, not stored; add to `metrics` what is missing"
