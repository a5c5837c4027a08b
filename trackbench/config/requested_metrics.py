"""Metrics that an experiment requests: check that they exist and are stored, and what they need."""

import re
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, is_dataclass
from itertools import chain
from typing import TYPE_CHECKING

from trackbench.config.build import hints_of
from trackbench.config.experiment import Exhibit, Experiment, Point, Settings
from trackbench.config.metric_names import Names, names_of, stored_metrics
from trackbench.config.mistakes import nearest, unknown
from trackbench.config.tuning import as_expression, bad_terms
from trackbench.evaluation.block import Kind
from trackbench.evaluation.consistency_and_calibration import bars
from trackbench.evaluation.metric_expression import Measure, measured, role_of
from trackbench.evaluation.summary import series_of
from trackbench.extension_points import field_values
from trackbench.filters.base import AnyFilter
from trackbench.registry import Group
from trackbench.statistics.over_runs import STATISTICS
from trackbench.yaml_source import Keys, Source

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

_OF_TRUTH = ("squared", "error", "rmsd", "nees", "outside_region", "pit", "coverage", "crps", "nci")
"""Series of errors."""
_OF_FAULTS = ("damage", "recovery_s", "not_recovered", "rejected_good", "accepted_bad")
_ADDED_BY = {
    **dict.fromkeys(("settling_s", "not_settled"), "`settled_error` of a target `legs`"),
    **dict.fromkeys(_OF_FAULTS, "`faults` of the scenario"),
    **dict.fromkeys(("arrived_late", "late_dropped"), "`delay` of a sensor"),
}
"""Keys that add metrics, by metric."""


@dataclass(frozen=True)
class MetricRequest:
    """Request of a component: metric, place in the config, and its role."""

    keys: Keys
    measure: Measure
    role: str
    named: bool = True
    """whether the config names it; a metric that a kind always shows may be missing, but not left out"""


def check_metrics(
    source: Source,
    settings: Settings,
    points: list[Point],
    parts: dict[Group, dict[str, Exhibit]],
    left_out: dict[str, AnyFilter],
) -> None:
    """Check that every metric named by tables, figures and settings exists and is stored.

    ``points`` are all, or none if any has mistakes: the metrics are unknown then. Metrics of filters
    that are not run may be named. Diagnostics of filters with mistakes or errors are unknown.
    """
    requests = [*_of_settings(settings), *requests_of(parts)]
    if not points:
        return
    names = names_of(settings, points, left_out, with_diagnostics=False)
    if any(not request.named or _unknown(request, names, settings) for request in requests):
        names = names_of(settings, points, left_out, with_diagnostics=True)
    for request in requests:
        what = _unknown(request, names, settings) or _left_out(request, names, settings)
        if what is not None:
            source.add_problem(request.keys, what)


def check_trained_metrics(source: Source, settings: Settings, training: Point | None) -> None:
    """Check that the metric of tuning is one of the training scenario."""
    if training is None or settings.tuning.scenario is None:
        return
    names = names_of(settings, [training], {}, with_diagnostics=True)
    for request in _of_tuning(settings):
        what = _unknown(request, names, settings)
        if what is not None:
            source.add_problem(("tuning", "scenario"), f"tuning.metric: {what}")


def _of_settings(settings: Settings) -> Iterator[MetricRequest]:
    for key, role, words in (
        ("medians", "series", settings.medians),
        ("metrics", "base", settings.metrics),
        ("per_step", "base", settings.per_step),
    ):
        for i, word in enumerate(words or ()):
            yield MetricRequest((key, i), measured(word), role)
    for word in settings.until:
        yield MetricRequest(("until", word), measured(word), "row")
    yield from _of_tuning(settings)


def _of_tuning(settings: Settings) -> Iterator[MetricRequest]:
    if not settings.tune:
        return
    metric = settings.tuning.metric
    known = {word for word, _ in bad_terms(metric)}
    for word in [metric] if isinstance(metric, str) else metric or ():
        where = ("tuning", "metric", *([] if isinstance(metric, str) else [word]))
        if word not in known:  # which is said elsewhere
            yield MetricRequest(where, measured(as_expression(word)), "summary")


def requests_of(parts: dict[Group, dict[str, Exhibit]]) -> Iterator[MetricRequest]:
    """Yield the metrics of tables and figures: by keys of a type such as `OfRun`, and by ``needs``."""
    for group, built in parts.items():
        for name, part in built.items():
            for word, role in part.requires.items():
                yield MetricRequest((group, name), measured(word), role, named=False)
            yield from _of_part(part, (group, name))


def _of_part(part: "DataclassInstance", keys: Keys) -> Iterator[MetricRequest]:
    hints = hints_of(type(part))
    for key, value in field_values(part).items():
        yield from _in_value(value, hints[key], (*keys, key))


def _in_value(value: object, hint: object, keys: Keys) -> Iterator[MetricRequest]:
    if isinstance(value, Measure):
        yield MetricRequest(keys, value, role_of(hint))
        if role_of(hint) == "rank" and not value.steps:
            for bar in bars(value.family[1]):
                yield MetricRequest(keys, value._replace(metric=bar), "per_run", named=False)
    elif is_dataclass(value) and not isinstance(value, type):
        yield from _of_part(value, keys)
    elif isinstance(value, dict):
        for head, inner in value.items():
            yield from _in_value(inner, hint, (*keys, head))


def _nearest_metric(word: str, known: Collection[str], bases: Sequence[str]) -> str:
    """Return the known metric that was probably meant, with a statistic where the place needs one."""
    lower = word.lower()
    base = nearest(word, bases) if word.isidentifier() else ""
    if base.startswith(lower) or lower in base.split("_"):
        for near in (base, f"rms({base})", f"mean({base})"):
            if near in known:
                return near
    return nearest(word, sorted(known))


def _unknown(request: MetricRequest, names: Names, settings: Settings) -> str | None:
    """Explain why a metric is unknown, if the config names it."""
    role, word = _where(request, settings)
    if role == "efficiency" and settings.reference is None:
        return f"{word!r} compares with the reference filter; name one under `reference`"
    # Metrics that cannot exist here, with the reason.
    known = names.of(role)
    m = request.measure
    metric, quantity = m.family
    is_of_prediction = quantity.startswith(("predicted_", "held_"))
    is_of_truth = metric.series in ("damage", *_OF_TRUTH) and not is_of_prediction
    if m.relation in ("gain", "ratio") and metric.is_score:
        return f"'{m}': a log score is a logarithm, and ratios of it mean nothing; take minus(...)"
    if word not in known and not names.has_truth and is_of_truth:
        less = re.compile(r"(bias|std)_.*|lost|autocorrelation_(?!1$).*")
        bases = {measured(name).base for name in known}
        usable = unknown("", sorted(name for name in bases if not less.fullmatch(name)))
        return f"{word!r} needs ground truth, and the recording has none; {usable}"
    if m.metric == "likelihood_ratio" and settings.reference is None:
        return "likelihood_ratio is relative to an exact filter; name one under `reference`"
    if m.metric == "likelihood_ratio" and names.has_delays:
        return (
            "likelihood_ratio needs equal measurements for both filters, and here some arrive late"
        )
    if word in known or not request.named or names.could_be_diagnostic(request.measure.metric):
        return None
    # Names that are unknown.
    short = sorted({measured(name).base for name in known})
    near = _nearest_metric(word, known, short)
    hint = f"did you mean {near}?" if near else unknown("", short)
    if metric.name in _ADDED_BY and not any(measured(n).family[0] is metric for n in known):
        hint = f"the key {_ADDED_BY[metric.name]} adds it"
    if is_of_truth and quantity in names.components:
        hint = f"`score: {{errors: {{{quantity}: [{quantity}]}}}}` of the scenario adds it"
    return f"{word!r} is no metric here; {hint}"


def _left_out(request: MetricRequest, names: Names, settings: Settings) -> str | None:
    """Explain that a metric is one that its file does not store."""
    role, word = _where(request, settings)
    if role == "efficiency":
        return _missing_parts(request.measure, settings)
    stored = stored_metrics(settings, "per_step.csv" if role == "per_step" else "summary.csv")
    if role in ("base", "series", "row") or stored is None or request.measure.base in stored:
        return None
    # For the bars of a rank histogram, the problem is that of its transform.
    if request.measure.family[0].name == "rank" and not request.named:
        return None
    if word in names.filter_numbers or not (request.named or word in names.of(role)):
        return None
    key = "per_step" if role == "per_step" and settings.per_step is not None else "metrics"
    return f"{word!r} is not stored; add it to `{key}`"


def _missing_parts(m: Measure, settings: Settings) -> str | None:
    """Explain which parts of an expression are not stored."""
    stored = stored_metrics(settings, "summary.csv")
    missing = [] if stored is None else [p.base for p in m.made_of() if p.base not in stored]
    if not missing:
        return None
    return f"'{m}' needs {' and '.join(missing)}, not stored; add to `metrics` what is missing"


def _where(request: MetricRequest, settings: Settings) -> tuple[str, str]:
    """Return the role, such as the file, and the name there of a requested metric."""
    m = request.measure
    if request.role == "base":
        return "base", m.base
    if request.role == "rank":
        return "per_run", m._replace(steps=None).name
    if request.role == "comparison" and not settings.grid:
        return "per_run", m.name
    if request.role not in ("expression", "comparison"):
        return request.role, str(m)
    if m.plain.is_efficiency:
        return "efficiency", str(m.plain)
    if m.steps is not None:
        return "per_step", str(m.plain._replace(steps=None))
    if m.statistic in STATISTICS:
        return "per_run", m.name
    return "per_run" if m.relation == "win_rate" else "summary", str(m.plain)


_OF_SCORE = ("log_score", "log_likelihood")
_OF_PREDICTIONS = re.compile(
    r"(rmse|bias|std|squared|error)_predicted_.+|anis|innovations|autocorrelation_.+"
)


def requested_predictions(experiment: Experiment) -> tuple[Kind, ...]:
    """Return the requested predictions; all of them for scenarios without a truth."""
    if not all(p.scenario.has_truth for p in experiment.points):
        return ("score", "prediction")
    return predictions_for(m.metric for m in _measures(experiment))


def predictions_for(metrics: Iterable[str]) -> tuple[Kind, ...]:
    """Return the predictions that metrics of these names need, without statistic and window."""
    names = set(metrics)
    heads = {name.partition("_")[0] for name in names}
    requested: dict[Kind, bool] = {
        "score": not names.isdisjoint((*_OF_SCORE, "likelihood_ratio")),
        "prediction": any(map(_OF_PREDICTIONS.fullmatch, names)),
        "calibration": not heads.isdisjoint(("pit", "coverage", "nci", "rank")),
        "ranks": "rank" in heads,
        "crps": "crps" in heads,
        "likelihood_ratio": "likelihood_ratio" in names,
    }
    return tuple(kind for kind, is_requested in requested.items() if is_requested)


def _measures(experiment: Experiment) -> Iterator[Measure]:
    requests = chain(_of_settings(experiment.settings), requests_of(experiment.parts))
    yield from (request.measure for request in requests)
    yield from experiment.published.expressions


def takes_times(experiment: Experiment) -> bool:
    """Test whether a table, a figure, a published number or a claim names CPU times."""
    return any(m.is_cpu_time for m in _measures(experiment))


@dataclass(frozen=True)
class Contributions:
    """Requested measures of which per_run.csv stores each run's contribution.

    Those of every filter; and those at many steps, only of the filters that need them, by label.
    """

    everywhere: tuple[Measure, ...]
    of_steps: Mapping[str, tuple[Measure, ...]]

    @property
    def series(self) -> list[str]:
        """Names of the series that the shares are made of."""
        names = map(series_of, (*self.everywhere, *chain(*self.of_steps.values())))
        return list(dict.fromkeys(name for name in names if name is not None))

    def of(self, label: str, steps: Sequence[int]) -> list[Measure]:
        """Return a filter's contributions, each at one step, for a scenario with these steps."""
        at_steps = chain(*(many.at_each(steps) for many in self.of_steps.get(label, ())))
        return list(dict.fromkeys([*self.everywhere, *at_steps]))


def requested_contributions(experiment: Experiment) -> Contributions:
    """Collect the contributions that tables, figures and published files request."""
    measures = [request.measure for request in requests_of(experiment.parts)]
    measures += experiment.published.expressions
    everywhere = {m.plain for m in measures if not m.is_many and series_of(m.plain) is not None}
    of_steps: dict[str, dict[Measure, None]] = defaultdict(dict)
    for claim in experiment.published.claims:
        for expression in claim.expressions:
            for label in filter(None, [*claim.labels, expression.other]):
                if expression.is_many:
                    of_steps[label][expression.plain] = None
    return Contributions(
        tuple(sorted(everywhere, key=str)), {label: tuple(m) for label, m in of_steps.items()}
    )
