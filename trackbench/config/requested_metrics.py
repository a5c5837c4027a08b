"""Metrics that the config of an experiment requests: in its settings, its tables and its figures."""

from collections.abc import Iterator
from dataclasses import dataclass, is_dataclass
from typing import TYPE_CHECKING, get_args

from trackbench.component_parts import field_values
from trackbench.config.experiment import Exhibit, Experiment
from trackbench.config.experiment_keys import Settings
from trackbench.config.tuning_objective import as_expression, bad_terms
from trackbench.evaluation.calibration_series import bars
from trackbench.evaluation.metric_expression import Measure, measured
from trackbench.field_types import annotations_of, hints_of
from trackbench.registry import Group
from trackbench.statistics.sample_statistics import STATISTICS
from trackbench.yaml_source import Keys

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

_ROLES = ("per_run", "per_step", "rank", "summary", "expression", "comparison")
"""Kinds of metrics and expressions that keys take."""


@dataclass(frozen=True)
class MetricRequest:
    """Request for a metric by a table, a figure or a setting."""

    keys: Keys
    """place in the config, where mistakes are reported"""
    measure: Measure
    role: str
    """how the metric is used, and so where it is looked up: ``base`` (without statistic, window and
    step), ``series``, ``row`` (of summary.csv), ``summary`` (such a row, a CPU time or a filter's key),
    ``per_run``, ``per_step``, ``rank`` (a PIT), or an ``expression`` or ``comparison`` of any form"""
    named: bool = True
    """whether the config names it; a metric that a kind always shows may be missing, but not left out"""


def requests_of_settings(settings: Settings) -> Iterator[MetricRequest]:
    """Yield the metrics of the config's top level, each with its role: how it is looked up."""
    # `medians` names series, of which the median over the runs is stored at each step.
    for i, word in enumerate(settings.medians):
        yield MetricRequest(("medians", i), measured(word), role="series")
    # `metrics` and `per_step` name metrics without statistic, window and step.
    for i, word in enumerate(settings.metrics or ()):
        yield MetricRequest(("metrics", i), measured(word), role="base")
    for i, word in enumerate(settings.per_step or ()):
        yield MetricRequest(("per_step", i), measured(word), role="base")
    # `until` names rows of summary.csv, such as rms(rmse).
    for word in settings.until:
        yield MetricRequest(("until", word), measured(word), role="row")
    yield from requests_of_tuning(settings)


def requests_of_tuning(settings: Settings) -> Iterator[MetricRequest]:
    """Yield the metrics of tuning's objective. Terms that `bad_terms` reports are left out."""
    metric = settings.tuning.metric
    if not settings.tune or metric is None:
        return
    places: dict[str, Keys] = {}
    if isinstance(metric, str):
        places[metric] = ("tuning", "metric")
    else:
        places = {word: ("tuning", "metric", word) for word in metric}
    mistaken = {word for word, _ in bad_terms(metric)}
    # A term such as log_score is looked up as a row of summary.csv, mean(log_score).
    for word, place in places.items():
        if word not in mistaken:
            yield MetricRequest(place, measured(as_expression(word)), role="summary")


def requests_of(exhibits: dict[Group, dict[str, Exhibit]]) -> Iterator[MetricRequest]:
    """Yield the metrics that tables and figures request.

    They are those in keys of a type such as `OfRun`, and those that a kind always shows (`requires`).
    """
    for group, exhibits_of_group in exhibits.items():
        for name, exhibit in exhibits_of_group.items():
            for word, role in exhibit.requires.items():
                yield MetricRequest((group, name), measured(word), role, named=False)
            yield from _requests_of_component(exhibit, (group, name))


def _requests_of_component(component: "DataclassInstance", keys: Keys) -> Iterator[MetricRequest]:
    """Yield the metrics in the keys of a table, a figure or a dataclass within it.

    ``keys`` lead to the component in the config.
    """
    hints = hints_of(type(component))
    for key, value in field_values(component).items():
        yield from _requests_in_value(value, hints[key], (*keys, key))


def _requests_in_value(value: object, hint: object, keys: Keys) -> Iterator[MetricRequest]:
    """Yield the metrics in the value of a key of a table or figure.

    ``hint`` is the type of the key, which has the role of the metrics: how they are looked up. ``keys``
    lead to the value.
    """
    if isinstance(value, Measure):
        role = role_of(hint)
        yield MetricRequest(keys, value, role)
        # A rank histogram over all steps also needs each of its bars, which are metrics of every run.
        # The config does not name them (`named`): an unknown one is no mistake beside that of the
        # histogram.
        if role == "rank" and not value.steps:
            for bar in bars(value.quantity):
                yield MetricRequest(keys, value._replace(metric=bar), role="per_run", named=False)
    elif is_dataclass(value) and not isinstance(value, type):
        yield from _requests_of_component(value, keys)
    elif isinstance(value, dict):
        for key, inner in value.items():
            yield from _requests_in_value(inner, hint, (*keys, key))
    elif isinstance(value, list | tuple):  # a Measure, itself a tuple, is handled above
        for i, inner in enumerate(value):
            yield from _requests_in_value(inner, hint, (*keys, i))


def requested_measures(experiment: Experiment) -> Iterator[Measure]:
    """Yield every measure that the experiment requests."""
    for request in requests_of_settings(experiment.settings):
        yield request.measure
    for request in requests_of(experiment.parts):
        yield request.measure
    yield from experiment.published.expressions


def role_of(hint: object) -> str:
    """Return the kind of metric or expression that a config key takes, by the key's type hint.

    The kind is the word in one of the types from `OfRun` to `Comparison`, such as ``per_run`` of
    `OfRun`. It is empty if the key takes no metric or expression.
    """
    for annotation in annotations_of(hint):
        if annotation in _ROLES:
            return str(annotation)
    # The type may be a part of the hint, as in `tuple[OfRun, ...]`.
    for argument in get_args(hint):
        role = role_of(argument)
        if role:
            return role
    return ""


def role_and_name(request: MetricRequest, settings: Settings) -> tuple[str, str]:
    """Return a requested metric's role in `Names.names_of_role`, such as its file, and its name there.

    The roles of a request are in `MetricRequest.role`. Those of an expression follow from its form: a
    number at a step is looked up in per_step.csv, a statistic over runs or a win rate in per_run.csv,
    and a comparison of two filters under the expression of one filter.
    """
    measure = request.measure
    if request.role == "base":  # a name without statistic, window and step
        return "base", measure.base
    if request.role == "rank":  # a PIT; at a step it exists if that over all steps does
        return "per_run", measure._replace(steps=None).name
    # Without a grid the values of the runs are compared, over a grid the numbers of its points.
    if request.role == "comparison" and not settings.grid:
        return "per_run", measure.name
    if request.role not in ("expression", "comparison"):
        return request.role, str(measure)
    # An expression: its role follows from its form.
    if measure.plain.is_efficiency:
        return "efficiency", str(measure.plain)
    if measure.steps is not None:
        return "per_step", str(measure.plain._replace(steps=None))
    if measure.statistic in STATISTICS:
        return "per_run", measure.name
    if measure.relation == "win_rate":
        return "per_run", str(measure.plain)
    return "summary", str(measure.plain)
