"""Checks between the components of an experiment; every mistake is added to ``problems``."""

from collections.abc import Iterable, Iterator
from dataclasses import fields, is_dataclass, replace
from itertools import repeat
from typing import Any, cast

from trackbench.config import exhibit_checks, plugin_checks
from trackbench.config.build_dataclass import unknown
from trackbench.config.experiment import (
    DrawnExhibit,
    Exhibit,
    Labelled,
    Point,
    Settings,
    labels_to_run,
)
from trackbench.errors import Problem
from trackbench.evaluation.metric_expression import Measure
from trackbench.filters.base import AnyFilter
from trackbench.models.base import position_velocity_names
from trackbench.registry import Group
from trackbench.scenarios.base import Scenario
from trackbench.yaml_source import Keys, Source, dotted

_NEEDS = {
    "state.planar": "a target in the plane",
    "motion.jacobian": "a motion with a Jacobian",
    "motion.alike_axes": "a motion of constant velocity, alike along x and y (cv, cwna; of any other "
    "motion try rpf or gpf), and steps of equal length",
    "motion.F": "a linear motion and steps of equal length",
    "motion.F|linear": "a linear motion",
    "motion.Q": "a linear motion",
    "motion.T": "steps of equal length (of recorded data: `resample`)",
    "motion.T|intervals": "a motion with a sampling time",
    "sensor.H": "a linear sensor",
    "sensor.jacobian": "a sensor with a Jacobian",
    "sensor.per_axis": "a sensor of planar positions, as it works axis by axis (try imm, or cmkf)",
    "sensor.reading": "a sensor of range and azimuth",
    **dict.fromkeys(
        ["prior.first", "prior.gaussian", "prior.positions", "prior.azimuths"],
        "a start from two scans of a radar at the origin",
    ),
}
"""What a filter needs, in words (other needs are named as they are)."""


def chosen_labels(source: Source, settings: Settings) -> list[str]:
    """Return the labels of the filters to run; labels named at the top level must exist."""
    known = list(settings.filters)
    if not known:
        source.add_problem(("filters",), "name at least one filter")
    for i, label in enumerate(settings.only):
        if label not in known:
            blame_label(source, settings, ("only", i), label)
    if settings.bound in known:
        source.add_problem(("bound",), f"{settings.bound!r} is already the label of a filter")
    if settings.reference is not None and settings.reference not in known:
        blame_label(source, settings, ("reference",), settings.reference)
    return labels_to_run(known, settings.only, settings.reference)


def has(scenario: Scenario, need: str) -> bool:
    """Return whether a scenario has what a filter needs: ``prior.first``, ``motion.T|F``."""
    part, _, name = need.partition(".")
    if part == "state":
        return scenario.components == position_velocity_names(2)
    if part == "prior":
        kind = scenario.prior_type
        return hasattr(kind, name) or name in getattr(kind, "__dataclass_fields__", ())
    return any(hasattr(getattr(scenario.model, part), either) for either in name.split("|"))


def check_fit(source: Source, keys: Keys, tracker: AnyFilter, scenario: Scenario) -> None:
    """Check that the scenario meets a filter's requirements and conflicts."""
    unmet = False
    for need in tracker.all_requirements:
        if not has(scenario, need):
            what = f"{tracker.kind} needs {_NEEDS.get(need, need)}, which there is not here"
            source.problems.append(Problem(source.mark((*keys, "kind")), dotted(keys), what))
            unmet = True
    # A filter may ask of the scenario what it needs, so it is only asked if that is there.
    if not unmet:
        _blame_each(source, keys, plugin_checks.conflicts(tracker, scenario))


def check_idle(source: Source, points: list[Point]) -> None:
    """Reject a set key that changes nothing at any point, unless default or preset set it."""
    for label in points[0].filters if points else ():
        trackers = [point.filters[label] for point in points]
        every = [
            plugin_checks.asked(tracker.idle_keys, dict, point.seen_by(label))
            for tracker, point in zip(trackers, points, strict=True)
        ]
        for key, why in every[0].items():
            path = key.split(".")
            if not all(key in idle for idle in every) or not _is_given(source, label, path):
                continue
            if not all(map(_is_usual, trackers, repeat(path))):
                keys = ("filters", label, *path)
                source.add_problem(keys, f"has no effect {why}; leave it out")


def _is_given(source: Source, label: str, path: list[str]) -> bool:
    found = source.data["filters"][label]
    for name in path:
        found = found.get(name) if isinstance(found, dict) else None
    return found is not None


def _is_usual(tracker: AnyFilter, path: list[str]) -> bool:
    """Return whether a key has its default, or what a preset gives it."""
    part: Any = tracker
    usual = list(tracker.presets.values())
    for name in path[:-1]:
        part = getattr(part, name, None)
        usual = [preset.get(name, {}) for preset in usual]
    if not is_dataclass(part):  # `assume` is no key of the class
        return False
    defaults = [key.default for key in fields(part) if key.name == path[-1]]
    return getattr(part, path[-1]) in (*defaults, *(preset.get(path[-1]) for preset in usual))


def check_bound(source: Source, scenario: Scenario) -> None:
    """Check that a requested lower bound exists."""
    if source.data.get("bound") is None:
        return
    why = scenario.why_no_bound
    if why is not None:
        what = f"scenario {scenario.kind} has no lower bounds" + (f": {why}" if why else "")
        source.add_problem(("bound",), what)


def _blame_each(source: Source, keys: Keys, found: dict[str, str]) -> None:
    """Add the problems that a component reports by key; an empty key means the component."""
    for key, what in found.items():
        source.add_problem((*keys, *key.split(".")) if key else keys, what)


def check_key_figure(source: Source, settings: Settings) -> None:
    """Check that the report's key figure is one of the experiment's."""
    name = settings.key_figure
    if name is not None and name not in settings.figures:
        source.add_problem(("key_figure",), unknown(name, list(settings.figures)))


def check_named_filters(
    source: Source, settings: Settings, group: Group, parts: dict[str, Exhibit]
) -> None:
    """Check that tables and figures name existing filters only.

    They do under ``filters``, under what they declare as ``label_keys``, and in measures that compare.
    """
    for name, part in parts.items():
        named = [
            found
            for key in ("filters", *part.label_keys)
            for found in _labels(getattr(part, key), (group, name, key))
        ]
        for key in fields(cast(Any, part)):
            named += _compared(getattr(part, key.name), (group, name, key.name))
        for where, label in named:
            if label not in (*settings.filters, settings.bound):
                blame_label(source, settings, where, label)


def _compared(value: Any, where: Keys) -> Iterator[tuple[Keys, str]]:
    """Yield the filter beside which each measure in what a key holds stands, and the measure's place."""
    if isinstance(value, Measure):
        if value.other:
            yield where, value.other
    elif isinstance(value, dict | tuple):
        for key, part in value.items() if isinstance(value, dict) else enumerate(value):
            yield from _compared(part, (*where, key))


def _labels(value: Any, where: Keys) -> Iterator[tuple[Keys, str]]:
    """Yield every label in what a key holds, and where it stands."""
    if isinstance(value, str):
        yield where, value
        return
    inner: Iterable[tuple[str | int, Any]]
    if isinstance(value, dict):
        inner = value.items()
    elif isinstance(value, tuple):
        inner = enumerate(value)
    else:
        keys = value.label_keys if isinstance(value, Labelled) else ()
        inner = ((key, getattr(value, key)) for key in keys)
    for key, part in inner:
        yield from _labels(part, (*where, key))


def blame_label(source: Source, settings: Settings, where: Keys, label: str) -> None:
    """Note a label that no filter has."""
    other = unknown(label, list(settings.filters))
    source.add_problem(where, f"{label!r} is not a filter here; {other}")


def check_drawable(
    source: Source, group: Group, parts: dict[str, Exhibit], points: list[Point]
) -> None:
    """Add the conflicts of tables and figures with these points."""
    for name, part in parts.items() if points else ():
        _blame_each(source, (group, name), exhibit_checks.conflicts(part, points))


def check_figures(
    source: Source, settings: Settings, figures: dict[str, DrawnExhibit], points: list[Point]
) -> None:
    """Check that figures show existing runs and components only."""
    sizes = [len(p.scenario.components) for p in points]
    limits = {"run": settings.runs, "component": min(sizes, default=1)}
    for name, figure in figures.items():
        for key in figure.numbers:
            number, most = getattr(figure, key), limits[key]
            if number > most:
                what = f"{number} is more than the {most} there {'are' if most > 1 else 'is'}"
                source.add_problem(("figures", name, key), what)


def with_recorded_runs(source: Source, settings: Settings, points: list[Point]) -> Settings:
    """Return the number of runs: all recorded ones unless the config asks for fewer."""
    counts = [p.scenario.recorded_runs for p in points]
    most = min((count for count in counts if count is not None), default=None)
    if most is None:
        return settings
    if "runs" in source.data and settings.runs <= most:
        most = settings.runs
    elif "runs" in source.data:
        source.add_problem(("runs",), f"{settings.runs} is more than the {most} recorded runs")
    # There will never be more: a wider block would filter runs that are not there.
    block = settings.block or (None if settings.until else "fit")
    return replace(settings, runs=most, block=block)
