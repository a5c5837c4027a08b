"""Filters beside their originals in a config: tuned ones and smoothed ones."""

import copy
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace

from trackbench.atomic_files import free_name
from trackbench.component_parts import Part
from trackbench.config.build_components import build_kind
from trackbench.config.experiment import Point
from trackbench.config.experiment_keys import Settings
from trackbench.config.filter_labels import add_label_problem
from trackbench.config.filter_model import check_assumed, check_late, read_assumed
from trackbench.config.filter_requirements import check_fit
from trackbench.config.overrides import override, split_path
from trackbench.config.requested_truth import is_measured_in
from trackbench.config.training_data import same_recordings
from trackbench.config.tuning import Axis, read_axis, tuned_label
from trackbench.config.tuning_objective import bad_terms, default_metric
from trackbench.errors import Mark, Problem, UserError
from trackbench.filters.base import AnyFilter
from trackbench.models.assume import Assume
from trackbench.models.sensors.base import SensorBase
from trackbench.registry import of_kind
from trackbench.yaml_source import Keys, Source, put

Chosen = Mapping[str, object]
"""Values of a filter's keys by their path within its entry: ``{assume.motion.q: 0.3}``."""


def add_tuned(source: Source, tuned_values: Mapping[str, Chosen]) -> None:
    """Add a tuned copy beside each tuned filter, with the values that tuning found or its own.

    An existing entry, as in the config of a results folder, stays unless tuning found values. A table
    and a figure per filter show what tuning did.
    """
    tune = source.data.get("tune")
    if not isinstance(tune, dict):
        return
    labels = [label for label in tune if _is_entry(source, label)]
    if not labels:
        return
    # Step 1: an entry per tuned filter, with the values found.
    for label in labels:
        _check_tuned_label(source, label)
        if label in tuned_values or not _is_entry(source, tuned_label(label)):
            filters = source.data["filters"]
            entry = copy.deepcopy(filters[label])
            mark = source.mark(("filters", label))
            put(filters, tuned_label(label), entry, mark, source.key_mark(("filters", label)))
        _set_values(source, tuned_label(label), label, tuned_values.get(label, {}))
    # Step 2: each after its original; tables and figures of those that are run.
    _put_after_originals(source, {label: tuned_label(label) for label in labels})
    _run_tuned_with_only(source, labels)
    _add_exhibit(source, "tables", "tuning", {"kind": "tuning"})
    for label in labels:
        if _is_tuned_run(source, label):
            name = _figure_name(label)
            _add_exhibit(source, "figures", name, {"kind": "tuning", "filter": label})


def add_smoothed(source: Source) -> None:
    """Add a copy with ``smooth: true`` after each filter of the key ``smoothed``.

    An existing entry of this filter with a smoother, as in the config of a results folder, stays.
    """
    labels = source.data.get("smoothed")
    if not isinstance(labels, list):
        return
    copies: dict[str, str] = {}
    for i, label in enumerate(labels):
        if not isinstance(label, str) or not _is_entry(source, label):
            continue
        smoothed_label = f"{label}, smoothed"
        copies[label] = smoothed_label
        filters = source.data["filters"]
        if not _is_entry(source, smoothed_label):
            mark = source.mark(("smoothed", i))
            put(filters, smoothed_label, copy.deepcopy(filters[label]), mark, mark)
            override(source, ("filters", smoothed_label, "smooth"), True, mark)
            continue
        # The existing entry must be that of the filter, with a smoother.
        original = {**filters[label], "smooth": None}
        smoothed = {**filters[smoothed_label], "smooth": None}
        if original != smoothed or not filters[smoothed_label].get("smooth"):
            message = f"there is another filter {smoothed_label!r}: give it another label"
            source.add_problem(("smoothed", i), message)
    if copies:
        _put_after_originals(source, copies)


def _check_tuned_label(source: Source, label: str) -> None:
    """Reject an entry under the tuned filter's label that is another filter.

    The two entries may differ in the tuned keys only.
    """
    keys = source.value_at(("tune", label))
    if not isinstance(keys, dict) or not _is_entry(source, tuned_label(label)):
        return
    entries = []
    for filter_label in (label, tuned_label(label)):
        # The entry with null for every tuned key.
        without_values = with_values(source, filter_label, dict.fromkeys(keys))
        entry = without_values.value_at(("filters", filter_label))
        # A copy of the true sensor lacks these keys, and a config of results has their defaults.
        if isinstance(entry.get("assume"), dict):
            _drop_true_keys(entry["assume"].get("sensor"))
        entries.append(entry)
    original, tuned = entries
    if original != tuned:
        message = f"tuning gives this label to the tuned {label}: give this filter another label"
        source.add_key_problem(("filters", tuned_label(label)), message)


def with_values(source: Source, label: str, values: Chosen) -> Source:
    """Return a config in which the filter ``label`` has these values of its tuned keys.

    Parts other than the filter's entry are shared with ``source``.
    """
    keys = ("filters", label)
    changed = source.replaced(keys, copy.deepcopy(source.value_at(keys)))
    _set_values(changed, label, label, values)
    return changed


def _set_values(source: Source, label: str, original_label: str, values: Chosen) -> None:
    """Set the values of keys in the entry of the filter ``label``.

    The filter is the one that is tuned, or its tuned copy. Mistakes in the values are reported where the
    config has the keys: under ``tune``, by ``original_label``.
    """
    for path, value in values.items():
        mark = source.mark(("tune", original_label, path))
        _copy_model(source, label, path)
        _write_default_kind(source, label, path)
        try:
            keys = split_path(source, f"filters.{label}.{path}")
        except UserError:
            # A key of a list is that of one of its items, which the path names by number.
            place = ("tune", original_label, path)
            message = "part of the path is a list: name one of its items by number, from 0"
            if path.startswith("assume.sensor."):
                message += f", as assume.sensor.0.{path.rpartition('.')[2]}"
            raise UserError(source.problem(place, message)) from None
        override(source, keys, value, mark)


_TRUE_COMPONENTS: Mapping[str, Keys] = {
    "motion": ("scenario", "target", "motion"),
    "sensor": ("scenario", "sensor"),
    "start": ("scenario", "start"),
}
"""Keys of the true component that filters assume by default, by the component's key in `assume`."""


def places_of_model(label: str, component: str) -> list[Keys]:
    """Return the keys at which the model of a filter may stand, the first that is set counts.

    These are the filter's `assume`, that of the scenario, and the true component.
    """
    places: list[Keys] = [
        ("filters", label, "assume", component),
        ("scenario", "assume", component),
    ]
    if component in _TRUE_COMPONENTS:
        places.append(_TRUE_COMPONENTS[component])
    return places


def _copy_model(source: Source, label: str, path: str) -> None:
    """Copy the model of a key such as ``assume.motion.q`` to the filter if it has none of its own.

    The copied model is the one that the filter assumes anyway: that of the scenario's `assume`, or the
    true one. Of other keys nothing is copied. ``path`` is that of the key in the filter's entry.
    """
    root, _, inner_path = path.partition(".")
    component, _, key = inner_path.partition(".")
    if root != "assume" or not key:
        return
    filter_model, *places = places_of_model(label, component)
    for place in (filter_model, *places):
        if not source.is_set(place):
            continue
        model = copy.deepcopy(source.value_at(place))
        if place == filter_model or not isinstance(model, dict | list):
            return
        if place == _TRUE_COMPONENTS["sensor"]:
            _drop_true_keys(model)
        override(source, filter_model, model, source.mark(place))
        return


def _write_default_kind(source: Source, label: str, path: str) -> None:
    """Write the default component into a filter's entry before a key within the component is set.

    ``path`` is that of the tuned key in the entry. For ``filter.gate``, an entry without ``filter`` gets
    the kind of the class's default.
    """
    name, _, inner_path = path.partition(".")
    place = ("filters", label, name)
    kind = source.value_at(("filters", label)).get("kind")
    cls = of_kind("filters", kind) if isinstance(kind, str) else None
    if not inner_path or cls is None or source.has(place):
        return
    default = getattr(cls, name, None)
    if isinstance(default, Part):
        override(source, place, {"kind": default.kind}, source.mark(("filters", label)))


def _drop_true_keys(sensors: object) -> None:
    """Drop the keys of a true sensor, or of each in a list, that no filter models, as `outliers`."""
    for sensor in sensors if isinstance(sensors, list) else [sensors]:
        if isinstance(sensor, dict):
            for key in fields(SensorBase):
                sensor.pop(key.name, None)


def _is_entry(source: Source, label: str) -> bool:
    """Test whether the config has a filter of this label, written as a mapping."""
    keys = ("filters", label)
    return source.has(keys) and isinstance(source.value_at(keys), dict)


def _put_after_originals(source: Source, copies: Mapping[str, str]) -> None:
    """Move each copy of a filter behind its original; ``copies`` has the copies' labels by original."""
    filters = source.data["filters"]
    entries = {label: filters.pop(copy_label) for label, copy_label in copies.items()}
    # Each filter moves to the end of the mapping in turn, with its copy behind it.
    for label in list(filters):
        filters[label] = filters.pop(label)
        if label in entries:
            filters[copies[label]] = entries[label]


def _run_tuned_with_only(source: Source, labels: list[str]) -> None:
    """Add the tuned filters of ``labels`` to the key `only` where it lists their originals."""
    only = source.data.get("only")
    if not isinstance(only, list):
        return
    for label in labels:
        if label in only and tuned_label(label) not in only:
            mark = source.mark(("only", only.index(label)))
            only.append(None)
            put(only, len(only) - 1, tuned_label(label), mark)


def _is_tuned_run(source: Source, label: str) -> bool:
    """Test whether the tuned copy of the filter ``label`` is run: `only` lists it or is not given."""
    only = source.data.get("only")
    if not isinstance(only, list) or not only:
        return True
    return tuned_label(label) in only


def _add_exhibit(source: Source, group: str, name: str, exhibit: dict[str, object]) -> None:
    """Add a table or figure of tuning to ``group`` under a free ``name``, unless the config has it.

    ``exhibit`` is its entry: kind and keys. The config has it if an entry there has these keys with
    these values.
    """
    # Mistakes are reported at the key `tune`. A mark without a line is of no file, as that of an option.
    mark = source.key_mark(("tune",))
    if not mark.line:
        mark = Mark("tune")
    if group not in source.data:
        override(source, (group,), {}, mark)
    entries = source.data[group]
    if not isinstance(entries, dict):
        return
    for entry in entries.values():
        if isinstance(entry, dict) and exhibit.items() <= entry.items():
            return
    override(source, (group, free_name(name, entries)), exhibit, mark)


def _figure_name(label: str) -> str:
    """Name the figure of a tuned filter by the letters and digits of its label."""
    words = "".join(c if c.isascii() and c.isalnum() else " " for c in label).split()
    return "-".join(["tuning", *words])[:80]


@dataclass(frozen=True)
class Trial:
    """A filter with the values of a trial, and its filter model."""

    filter: AnyFilter
    assume: Assume | None


def make_trial(source: Source, point: Point, label: str, values: Chosen) -> Trial | list[Problem]:
    """Build the filter ``label`` and its filter model with these values of tuned keys.

    Both are checked as those of the config are. Return the mistakes if there are any. ``point`` has the
    scenario.
    """
    changed = with_values(source, label, values)
    tracker = build_kind("filters", changed, ("filters", label))
    assume = read_assumed(changed, label)
    if tracker is not None and not changed.problems:
        trial_point = Point(
            values=point.values,
            scenario=point.scenario,
            filters={label: tracker},
            assumed={} if assume is None else {label: assume},
        )
        scenario = check_assumed(changed, trial_point, label)
        if scenario is not None:
            check_fit(changed, ("filters", label), tracker, scenario)
            check_late(changed, ("filters", label), tracker, scenario)
    if changed.problems:
        return changed.problems
    return Trial(filter=tracker, assume=assume)


_MOST_KEYS = 5


def with_defaults(
    source: Source, settings: Settings, points: list[Point], training: Point | None
) -> Settings:
    """Return the settings with tuning's default metric and number of runs filled in.

    Without a ``training`` point nothing is tuned, and the settings stay as they are.
    """
    if training is None:
        return settings
    tuning = settings.tuning
    if tuning.metric is None:
        # The scenario of the results, and that of training, which may be the first part of recordings.
        # If one of the two has no truth to score, the metric is one that needs none.
        scored_scenarios = (
            points[0].scenario,
            training.scenario.training or training.scenario,
        )
        has_errors = all(is_measured_in(scenario) for scenario in scored_scenarios)
        metric = default_metric(points[0].scenario, has_errors)
        tuning = replace(tuning, metric=metric)
    # Where training takes a share of each recording's time, it has all recordings.
    trains_on_time_share = training.scenario.training is not None
    if trains_on_time_share and "runs" not in (source.data.get("tuning") or {}):
        tuning = replace(tuning, runs=training.scenario.recorded_runs or tuning.runs)
    return replace(settings, tuning=tuning)


def tuned_axes(
    source: Source, settings: Settings, points: list[Point], training: Point | None
) -> dict[str, tuple[Axis, ...]]:
    """Read, by label, the axes of the tuned keys of each filter that is run.

    ``training`` is the point with the training scenario, on which values of the axes are tried; None if
    it cannot be built. Mistakes are added to the source.
    """
    if not settings.tune:
        return {}
    problems_before = len(source.problems)
    _check_tuning(source, settings, points, training)
    axes_by_label: dict[str, tuple[Axis, ...]] = {}
    for label, keys in settings.tune.items():
        # An entry `scenario` under `tune` was meant for `tuning`, and gets a message of its own.
        if label not in settings.filters and label != "scenario":
            add_label_problem(source, settings, ("tune", label), label)
            continue
        message = _why_not_tunable(settings, label, len(keys))
        if message:
            source.add_key_problem(("tune", label), message)
            continue
        axes = _read_axes(source, label, keys)
        # The values of the axes are tried on the filter only if nothing else is mistaken.
        if training is None or len(source.problems) > problems_before:
            continue
        tried_axes = _try_axes(source, training, label, axes)
        if not settings.only or tuned_label(label) in settings.only:
            axes_by_label[label] = tried_axes
    return axes_by_label


def _why_not_tunable(settings: Settings, label: str, number_of_keys: int) -> str:
    """Explain why a filter cannot be tuned; an empty text if it can."""
    if label not in settings.filters:  # only `scenario` is passed on by `tuned_axes`
        return "is no filter; the scenario of training stands under `tuning: {scenario: ...}`"
    if not 1 <= number_of_keys <= _MOST_KEYS:
        return f"{number_of_keys} keys; a filter is tuned in 1 to {_MOST_KEYS}"
    if label == settings.reference:
        return "the reference filter measures the others; tune another filter"
    return ""


def _read_axes(source: Source, label: str, keys: Mapping[str, object]) -> list[Axis]:
    """Read the axis of each tuned key; mistakes are added to the source."""
    axes = []
    for key, written in keys.items():
        try:
            axes.append(read_axis(key, written))
        except ValueError as error:
            source.add_problem(("tune", label, key), str(error))
    return axes


def _check_tuning(
    source: Source, settings: Settings, points: list[Point], training: Point | None
) -> None:
    """Check the grid, the objective and the number of training runs."""
    tuning = settings.tuning
    # Step 1: the grid and the terms of the objective.
    if settings.grid:
        message = "each point of a grid has values of its own: tune one experiment per point"
        source.add_key_problem(("tune",), message)
    for word, message in bad_terms(tuning.metric):
        place = (
            ("tuning", "metric") if isinstance(tuning.metric, str) else ("tuning", "metric", word)
        )
        source.add_problem(place, message)
    # Step 2: the number of recorded runs.
    if training is None or not training.scenario.recorded_runs:
        return
    recorded_runs = training.scenario.recorded_runs
    trains_on_time_share = training.scenario.training is not None
    if not trains_on_time_share and same_recordings(points[0], training):
        # Results and training take different runs of the same recordings.
        if settings.runs + tuning.runs > recorded_runs:
            message = (
                f"{tuning.runs} training runs beside {settings.runs} of the results are more than "
                f"the {recorded_runs} recorded ones: ask for fewer `runs`, or fewer here, or share "
                "out their time (the scenario's `score: {train: 0.5}`)"
            )
            source.add_problem(("tuning", "runs"), message)
    elif tuning.runs > recorded_runs:
        message = f"{tuning.runs} is more than the {recorded_runs} recorded runs"
        source.add_problem(("tuning", "runs"), message)


def _try_axes(source: Source, point: Point, label: str, axes: list[Axis]) -> tuple[Axis, ...]:
    """Try values of the tuned keys' ``axes`` on the filter; return the axes.

    An axis whose key takes only whole numbers is returned as whole. A value at an end, or a choice, that
    the filter rejects is a mistake, which is added to the source.
    """
    # Step 1: an axis between whole numbers is whole if the filter rejects a value between them.
    # Each key at the middle of its axis: while one key is tried, the others stay there.
    middle: dict[str, object] = {axis.key: axis.at(0.5) for axis in axes}
    tried_axes = []
    for axis in axes:
        tried_axis = axis
        if not axis.choices and axis.low.is_integer() and axis.high.is_integer():
            # The middle plus 1/4 is no whole number, as the middle is a multiple of 1/2.
            between = {**middle, axis.key: 0.5 * (axis.low + axis.high) + 0.25}
            if not isinstance(make_trial(source, point, label, between), Trial):
                tried_axis = replace(axis, whole=True)
                middle[axis.key] = tried_axis.at(0.5)
        tried_axes.append(tried_axis)
    # Step 2: try both ends and all choices, with the other keys at their middle.
    for axis in tried_axes:
        for value in axis.choices or (axis.at(0.0), axis.at(1.0)):
            trial = make_trial(source, point, label, {**middle, axis.key: value})
            if isinstance(trial, Trial):
                continue
            for problem in trial:
                path = problem.path.removeprefix(f"filters.{label}").removeprefix(".")
                message = f"{path}: {problem.message}" if path else problem.message
                source.add_problem(("tune", label, axis.key), f"at {value}: {message}")
    return tuple(tried_axes)
