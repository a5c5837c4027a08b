"""Table kind `innovations`: do innovations fit their covariances? Of recordings it is all there is."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import ClassVar

from trackbench.evaluation.metric_expression import measured
from trackbench.field_types import Digits
from trackbench.filters.base import Filter
from trackbench.models.sensors.stacked import sensor_name
from trackbench.registry import of_kind, register
from trackbench.report.expressions import Evaluator
from trackbench.report.findings import phrases
from trackbench.report.findings.consistency_words import collapse_words
from trackbench.report.kinds import TableKind
from trackbench.report.table import Cell, Table
from trackbench.report.tables.consistency_band_notes import notes_on_innovation_bands
from trackbench.report.tables_and_figures import Results
from trackbench.statistics.estimates import MISSING

_COLUMNS = {
    "ANIS": "mean(anis)",
    "Autocorrelation": "mean(autocorrelation_1)",
    "Log score": "mean(log_score)",
    "Held-out log score": "mean(held_log_score)",
}
_ERRORS = {"Prediction": "predicted", "Held-out": "held"}
"""Word in the names of prediction errors, such as ``rmse_predicted_px``, by their heading."""


@register("tables", "innovations")
@dataclass(frozen=True, kw_only=True)
class Innovations(TableKind):
    """Consistency, whiteness, log score and one-step prediction errors; of recordings, all there is.

    ANIS is the normalized innovation squared over the number of measured components, 1 if consistent;
    of N components it is chi-square of N degrees of freedom over N. The autocorrelation of successive
    whitened innovations is 0 within 1.96 / sqrt(N) (Bar-Shalom, Li & Kirubarajan 2001, section 5.4.2).
    Where runs measure different numbers, N is that of which means over runs vary as much. What a gate
    accepts has a smaller ANIS, and a filter with a gate has the band of that.
    The log score is the mean log p(z_k | z_1..k-1): higher is better. What is held out (`hold_out`) is
    predicted and not filtered. A prediction error is the measurement minus the mean of h over the
    predicted Gaussian, or minus h of the predicted mean for a filter that never updates (`prior-mean`).
    """

    requires: ClassVar[dict[str, str]] = {
        "anis": "per_run",
        "innovations": "per_run",
        "autocorrelation_1": "per_run",
        "log_score": "per_run",
    }

    filters: tuple[str, ...] | None = None
    """labels of the rows; default: all"""
    digits: Digits = 4
    """significant digits of the values"""

    def table(self, results: Results) -> Table:
        """Fill a row for each filter at each point of the grid.

        Columns that no filter has are left out.
        """
        evaluators = {tuple(point.items()): Evaluator(results, point) for point in results.points()}
        metrics = _stored_metrics(evaluators.values())
        columns = {head: metric for head, metric in _COLUMNS.items() if metric in metrics}
        error_columns = _error_columns(results)
        columns |= error_columns
        columns |= refused_column(evaluators.values())
        table = Table(self.title, [*results.grid_heads, "Filter"], list(columns), self.digits)
        labels = results.chosen(self.filters)
        for point, evaluator in evaluators.items():
            for label in labels:
                cells = [innovation_cell(evaluator, label, metric) for metric in columns.values()]
                table.add([*(str(value) for _, value in point), label], cells)
        table.notes += notes_on_innovation_bands(results, labels)
        if error_columns:
            table.notes += _prior_mean_note(results, labels)
        return table


def _prior_mean_note(results: Results, labels: list[str]) -> list[str]:
    """Write how prediction errors of filters that never update are computed; empty without such filters.

    The filter `prior-mean` is one: it takes no measurement into account. Its predictions are those of
    the path that the motion takes from the mean of the prior. ANIS and autocorrelation allow for the
    covariance around this path.
    """
    names = []
    for label in labels:
        for point in results.points():
            kind = results.facts(point).filters.get(label, {}).get("kind", "")
            cls = of_kind("filters", kind)
            if cls is not None and issubclass(cls, Filter) and not cls.uses_measurements:
                names.append(phrases.named(label))
                break
    if not names:
        return []
    never = "never updates: its" if len(names) == 1 else "never update: their"
    text = f"{phrases.listed(names)} {never} prediction errors are those of the path, z - h(mean)"
    return [f"{text}; ANIS and autocorrelation are of the Gaussian around it."]


def refused_column(evaluators: Iterable[Evaluator]) -> dict[str, str]:
    """Return heading and metric of the column of measurements that a gate refused.

    The mapping is empty if no filter has a gate at any point.
    """
    if "mean(gated)" not in _stored_metrics(evaluators):
        return {}
    return {"Refused a run": "mean(gated)"}


def _stored_metrics(evaluators: Iterable[Evaluator]) -> set[str]:
    """Collect the metrics that any filter has at any point of the grid."""
    metrics = set()
    for evaluator in evaluators:
        metrics |= {metric for _, metric in evaluator.stored}
    return metrics


def innovation_cell(evaluator: Evaluator, label: str, metric: str) -> Cell:
    """Return the cell of a filter's metric, a mean over the runs."""
    words = collapse_words(evaluator, measured(metric).of(label))
    return Cell.of(evaluator.stored.get((label, metric), MISSING), words)


def _error_columns(results: Results) -> dict[str, str]:
    """Return heading and metric of the columns of prediction errors, one for each component measured.

    Errors of predicting held-out measurements have columns of their own.
    """
    columns = {}
    # Names that a recording gives its sensors, in their order.
    target = results.facts(results.points()[0]).scenario.get("target") or {}
    names = target.get("sensors") or ()
    for head, kind in _ERRORS.items():
        # Such as rms(rmse_predicted_px); errors in a window, rms(rmse_predicted_px[late]), are left out.
        for name in dict.fromkeys(results.columns("summary")["metric"]):
            component = name.removeprefix(f"rms(rmse_{kind}_").removesuffix(")")
            if name == f"rms(rmse_{kind}_{component})" and "[" not in component:
                columns[f"{head} error, {_component_title(component, names)}"] = name
    return columns


def _component_title(component: str, names: Sequence[str]) -> str:
    """Write a measured component with the recorded name of its sensor: ``sensor 3 (4).range``.

    ``component`` is such as ``3.range``, and ``names`` are the recorded names of all sensors. Without
    names, and for a component of a single sensor, it is returned as it is.
    """
    number, _, quantity = component.rpartition(".")
    if not names or not number.isdigit():
        return component
    return f"{sensor_name(int(number) - 1, names)}.{quantity}"
