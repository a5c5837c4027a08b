"""Filters beside their originals in a config: tuned ones with their training scenario, smoothed ones."""

import copy
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from trackbench.atomic_files import free_name
from trackbench.config.build import build_kind
from trackbench.config.checks import add_label_problem, check_assumed, check_fit
from trackbench.config.dump import as_config
from trackbench.config.experiment import Experiment, Point, Settings
from trackbench.config.filter_model import check_late, read_assumed
from trackbench.config.includes import deep_merge, override, split_path
from trackbench.config.tuning import Axis, bad_terms, default_metric, read_axis, tuned_label
from trackbench.errors import Mark, Problem
from trackbench.evaluation.block import simulate
from trackbench.filters.base import AnyFilter
from trackbench.models.sensors.base import Assume
from trackbench.plugins.checks import check_scenario
from trackbench.plugins.errors import PluginError
from trackbench.yaml_source import Source, put

Chosen = Mapping[str, object]
"""Values of a filter's keys by their path within its entry: ``{assume.motion.q: 0.3}``."""


def add_tuned(source: Source, tuned_values: Mapping[str, Chosen]) -> None:
    """Add a tuned copy beside each tuned filter, with the values that tuning found or its own.

    An existing entry, as in the config of a results folder, stays unless tuning found values. A table
    and a figure per filter show what tuning did.
    """
    tune = source.data.get("tune")
    tuned = [label for label in tune if _is_entry(source, label)] if isinstance(tune, dict) else []
    if not tuned:
        return
    # Step 1: an entry per tuned filter, with the values found.
    for label in tuned:
        _check_tuned_label(source, label)
        if label in tuned_values or not _is_entry(source, tuned_label(label)):
            filters, mark = source.data["filters"], source.mark(("filters", label))
            entry = copy.deepcopy(filters[label])
            put(filters, tuned_label(label), entry, mark, source.key_mark(("filters", label)))
        _set(source, tuned_label(label), label, tuned_values.get(label, {}))
    # Step 2: each after its original; tables and figures of those that are run.
    _order(source, {label: tuned_label(label) for label in tuned})
    run = _with_tuned_of_only(source, tuned)
    _add_part(source, "tables", "tuning", {"kind": "tuning"})
    for label in run:
        _add_part(source, "figures", _file_name(label), {"kind": "tuning", "filter": label})


def add_smoothed(source: Source) -> None:
    """Add a copy with ``smooth: true`` after each filter of the key ``smoothed``.

    An existing entry of this filter with a smoother, as in the config of a results folder, stays.
    """
    labels = source.data.get("smoothed")
    copies: dict[str, str] = {}
    for i, label in enumerate(labels if isinstance(labels, list) else ()):
        if not isinstance(label, str) or not _is_entry(source, label):
            continue
        smoothed = copies[label] = f"{label}, smoothed"
        if not _is_entry(source, smoothed):
            filters, mark = source.data["filters"], source.mark(("smoothed", i))
            put(filters, smoothed, copy.deepcopy(filters[label]), mark, mark)
            override(source, ("filters", smoothed, "smooth"), True, mark)
            continue
        same = [{**source.at(("filters", of)), "smooth": None} for of in (label, smoothed)]
        if same[0] != same[1] or not source.at(("filters", smoothed)).get("smooth"):
            what = f"there is another filter {smoothed!r}: give it another label"
            source.add_problem(("smoothed", i), what)
    if copies:
        _order(source, copies)


def _check_tuned_label(source: Source, label: str) -> None:
    """Reject an entry under the tuned filter's label that is another filter."""
    keys = source.at(("tune", label))
    if not isinstance(keys, dict) or not _is_entry(source, tuned_label(label)):
        return
    pair = [label, tuned_label(label)]
    entries = [with_values(source, of, dict.fromkeys(keys)).at(("filters", of)) for of in pair]
    if entries[0] != entries[1]:
        what = f"tuning gives this label to the tuned {label}: give this filter another label"
        source.add_key_problem(("filters", tuned_label(label)), what)


def with_values(source: Source, label: str, values: Chosen) -> Source:
    """Return a config with other values of this filter; the rest is shared."""
    keys = ("filters", label)
    changed = source.replaced(keys, copy.deepcopy(source.at(keys)))
    _set(changed, label, label, values)
    return changed


def _set(source: Source, label: str, tuned_as: str, values: Chosen) -> None:
    for path, value in values.items():
        mark = source.mark(("tune", tuned_as, path))
        _take_from_scenario(source, label, path)
        override(source, split_path(source, f"filters.{label}.{path}"), value, mark)


def _take_from_scenario(source: Source, label: str, path: str) -> None:
    """Copy the model of ``assume.motion.q`` from the scenario's `assume` if the filter has none."""
    root, _, inner = path.partition(".")
    part, _, key = inner.partition(".")
    of_scenario = ("scenario", "assume", part)
    of_filter = ("filters", label, "assume", part)
    if root != "assume" or not key or not source.has(of_scenario) or source.has(of_filter):
        return
    model = source.at(of_scenario)
    if isinstance(model, dict):
        override(source, of_filter, copy.deepcopy(model), source.mark(of_scenario))


def _is_entry(source: Source, label: str) -> bool:
    keys = ("filters", label)
    return source.has(keys) and isinstance(source.at(keys), dict)


def _order(source: Source, copies: Mapping[str, str]) -> None:
    """Put each copy of a filter after its original, by their labels."""
    filters = source.data["filters"]
    entries = {label: filters.pop(copy) for label, copy in copies.items()}
    for label in [*filters]:
        filters[label] = filters.pop(label)
        if label in entries:
            filters[copies[label]] = entries[label]


def _with_tuned_of_only(source: Source, labels: list[str]) -> list[str]:
    """Let ``only: [KF]`` run the tuned one, too; returns the labels that are tuned."""
    only = source.data.get("only")
    if not isinstance(only, list) or not only:
        return labels
    for label in labels:
        if label in only and tuned_label(label) not in only:
            mark = source.mark(("only", only.index(label)))
            only.append(None)
            put(only, len(only) - 1, tuned_label(label), mark)
    return [label for label in labels if tuned_label(label) in only]


def _add_part(source: Source, group: str, name: str, part: dict[str, object]) -> None:
    """Add a table or figure of tuning unless the config has it."""
    mark = source.key_mark(("tune",))
    mark = mark if mark.line else Mark("tune")
    if group not in source.data:
        override(source, (group,), {}, mark)
    parts = source.data[group]
    if not isinstance(parts, dict):
        return
    if not any(isinstance(p, dict) and part.items() <= p.items() for p in parts.values()):
        override(source, (group, free_name(name, parts)), part, mark)


def _file_name(label: str) -> str:
    words = "".join(c if c.isascii() and c.isalnum() else " " for c in label).split()
    return "-".join(["tuning", *words])[:80]


@dataclass(frozen=True)
class Trial:
    """A filter and what it assumes."""

    filter: AnyFilter
    assume: Assume | None


def make_trial(source: Source, point: Point, label: str, values: Chosen) -> Trial | list[Problem]:
    """Build the filter with these values; the reasons if there is none."""
    # Build the filter and its model, and check both as the config's own.
    changed = with_values(source, label, values)
    tracker = build_kind("filters", changed, ("filters", label))
    assume = read_assumed(changed, label)
    if tracker is not None and not changed.problems:
        assumed = {label: assume} if assume is not None else {}
        trial_point = Point(point.values, point.scenario, {label: tracker}, assumed)
        scenario = check_assumed(changed, trial_point, label)
        if scenario is not None:
            check_fit(changed, ("filters", label), tracker, scenario)
            check_late(changed, ("filters", label), tracker, scenario)
    return changed.problems or Trial(tracker, assume)


_MOST_KEYS = 5


def with_defaults(
    source: Source, settings: Settings, points: list[Point], training: Point | None
) -> Settings:
    """Fill in tuning's default metric and number of runs, if anything is tuned by them."""
    if training is None:
        return settings
    tuning, scenario = settings.tuning, training.scenario
    if tuning.metric is None:
        # Without a truth in either scenario, the metric is one that needs none.
        least = min(points[0], training, key=lambda point: point.scenario.has_truth)
        tuning = replace(tuning, metric=default_metric(least.scenario))
    if scenario.training is not None and "runs" not in (source.data.get("tuning") or {}):
        tuning = replace(tuning, runs=scenario.recorded_runs or tuning.runs)
    return replace(settings, tuning=tuning)


def tuned_axes(
    source: Source, settings: Settings, points: list[Point], training: Point | None
) -> dict[str, tuple[Axis, ...]]:
    """Read the axes of the keys of each filter that is tuned and run."""
    if not settings.tune:
        return {}
    before, axes_by_label = len(source.problems), dict[str, tuple[Axis, ...]]()
    _check(source, settings, points, training)
    for label, keys in settings.tune.items():
        if label == KEYS[1] and label not in settings.filters:
            what = "is no filter; the scenario of training stands under `tuning: {scenario: ...}`"
            source.add_key_problem(("tune", label), what)
        elif label not in settings.filters:
            add_label_problem(source, settings, ("tune", label), label)
        elif not 1 <= len(keys) <= _MOST_KEYS:
            what = f"{len(keys)} keys; a filter is tuned in 1 to {_MOST_KEYS}"
            source.add_key_problem(("tune", label), what)
        elif label == settings.reference:
            what = "the reference filter measures the others; tune another filter"
            source.add_key_problem(("tune", label), what)
        else:
            # Read the axis of each key, then test the types of its values on the filter.
            axes = []
            for key, written in keys.items():
                try:
                    axes.append(read_axis(key, written))
                except ValueError as error:
                    source.add_problem(("tune", label, key), str(error))
            if len(axes) == len(keys) and training is not None and len(source.problems) == before:
                tested = _with_types(source, training, label, axes)
                if not settings.only or tuned_label(label) in settings.only:
                    axes_by_label[label] = tested
    return axes_by_label


def _check(source: Source, settings: Settings, points: list[Point], training: Point | None) -> None:
    tuning = settings.tuning
    # The grid, the objective, and the number of recorded runs.
    if settings.grid:
        what = "each point of a grid has values of its own: tune one experiment per point"
        source.add_key_problem(("tune",), what)
    for word, what in bad_terms(tuning.metric):
        keys = ("tuning", "metric", *([] if isinstance(tuning.metric, str) else [word]))
        source.add_problem(keys, what)
    most = 0 if training is None else training.scenario.recorded_runs or 0
    in_time = training is not None and training.scenario.training is not None
    shared = training is not None and not in_time and same_recordings(points[0], training)
    beside = settings.runs if shared else 0
    if most and beside + tuning.runs > most:
        what = (
            f"{tuning.runs} training runs beside {settings.runs} of the results are more than the "
            f"{most} recorded ones: ask for fewer `runs`, or fewer here, or share out their time "
            "(the scenario's `score: {train: 0.5}`)"
            if beside
            else f"{tuning.runs} is more than the {most} recorded runs"
        )
        source.add_problem(("tuning", "runs"), what)


def _with_types(source: Source, point: Point, label: str, axes: list[Axis]) -> tuple[Axis, ...]:
    """Make axes whole where no other numbers are valid; check both ends and all choices."""
    # Step 1: an axis between whole numbers is whole if the filter rejects a value between them.
    middle: dict[str, object] = {axis.key: axis.at(0.5) for axis in axes}
    typed = []
    for axis in axes:
        if not axis.choices and axis.low.is_integer() and axis.high.is_integer():
            between = {**middle, axis.key: 0.5 * (axis.low + axis.high) + 0.25}
            if not isinstance(make_trial(source, point, label, between), Trial):
                axis = replace(axis, whole=True)
                middle[axis.key] = axis.at(0.5)
        typed.append(axis)
    # Step 2: try both ends and all choices, with the other keys at their middle.
    for axis in typed:
        for value in axis.choices or (axis.at(0.0), axis.at(1.0)):
            trial = make_trial(source, point, label, {**middle, axis.key: value})
            for problem in [] if isinstance(trial, Trial) else trial:
                path = problem.path.removeprefix(f"filters.{label}").removeprefix(".")
                what = f"{path}: {problem.what}" if path else problem.what
                source.add_problem(("tune", label, axis.key), f"at {value}: {what}")
    return tuple(typed)


KEYS = ("tuning", "scenario")
NOISE, PATH, RUNS, TIME = "noise", "noise and path", "recordings", "time"
"""What of the judged data training has not seen, as the manifest says it."""


def training_point(source: Source, point: Point) -> Point | None:
    """Build the point with the scenario that training simulates; None if its keys are mistaken."""
    changes = source.at(KEYS) if source.has(KEYS) else None
    if changes is None:
        return point
    if not isinstance(changes, dict):  # reported with the other settings
        return None
    whole = deep_merge(source.data["scenario"], changes, by_kind=True)
    changed = source.replaced(KEYS, copy.deepcopy(whole))
    scenario = build_kind("scenarios", changed, KEYS)
    if scenario is not None:
        try:
            check_scenario(scenario, bounded=False)
        except PluginError as error:
            changed.add_problem(KEYS, str(error))
    source.problems += changed.problems
    return None if changed.problems else replace(point, scenario=scenario)


def same_recordings(a: Point, b: Point) -> bool:
    """Test whether two points take their runs from the same recorded data."""
    first, second = (as_config(point.scenario).get("target") for point in (a, b))
    return a.scenario.recorded_runs is not None and first == second


def held_out(experiment: Experiment) -> str:
    """Name the judged data outside training; the paths of two runs are compared."""
    judged, training = experiment.points[0], experiment.training
    assert training is not None
    if same_recordings(judged, training):
        return RUNS if training.scenario.training is None else TIME
    if judged.scenario.recorded_runs or training.scenario.recorded_runs:
        return PATH
    # Simulated data: compare the path of the first judged run with that of the first training run.
    seed = experiment.settings.seed
    paths = [
        simulate(point.scenario, seed, run, 1).truth for point, run in ((judged, 0), (training, -1))
    ]
    n, steps = np.min([path.shape[:2] for path in paths], axis=0)
    one, other = (path[:n, :steps] for path in paths)
    return NOISE if np.array_equal(one, other, equal_nan=True) else PATH


def training_cautions(experiment: Experiment) -> list[str]:
    """Warn of filters that are tuned on the very path that judges them."""
    if not experiment.tuned or held_out(experiment) != NOISE:
        return []
    return [
        "filters are tuned on the path that judges them, and only the noise is held out; to train on "
        "other paths: `tuning: {scenario: {target: {kind: random-legs, ...}}}` (docs/tuning.md)"
    ]
