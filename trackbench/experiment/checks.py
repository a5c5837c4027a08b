"""What must hold between the parts of an experiment; every mistake is added to ``problems``."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any

from trackbench.experiment.definition import Point, Settings, labels_to_run
from trackbench.experiment.problems import Problem
from trackbench.experiment.source import Keys, Source, dotted
from trackbench.experiment.validate import unknown
from trackbench.models.base import Model
from trackbench.registry import Group


def chosen_labels(source: Source, settings: Settings, problems: list[Problem]) -> list[str]:
    """Labels of the filters to run, once every label that the top level names is one of a filter."""
    known = list(settings.filters)
    if not known:
        problems.append(Problem(source.mark(("filters",)), "filters", "name at least one filter"))
    for i, label in enumerate(settings.only):
        if label not in known:
            problems.append(no_filter(source, settings, ("only", i), label))
    if settings.bound in known:
        what = f"{settings.bound!r} is already the label of a filter"
        problems.append(Problem(source.mark(("bound",)), "bound", what))
    if settings.reference is not None and settings.reference not in known:
        problems.append(no_filter(source, settings, ("reference",), settings.reference))
    return labels_to_run(known, settings.only, settings.reference)


def has(model: Model, need: str) -> bool:
    """Whether a model can do what a filter needs, such as ``motion.jacobian``."""
    part, _, name = need.partition(".")
    return hasattr(getattr(model, part), name)


def check_fit(
    source: Source, keys: Keys, tracker: Any, scenario: Any, problems: list[Problem]
) -> None:
    """What the filter needs of the model, and what it says itself about this scenario."""
    unmet = False
    for need in getattr(tracker, "needs", ()):
        if not has(scenario.model, need):
            what = f"{tracker.kind} needs {need}, which scenario {scenario.kind} does not have"
            problems.append(Problem(source.mark((*keys, "kind")), dotted(keys), what))
            unmet = True
    conflicts = getattr(tracker, "conflicts", None)
    # A filter may ask of the scenario what it needs, so it is only asked if that is there.
    if conflicts and not unmet:
        problems += _conflicts(source, keys, conflicts(scenario))


def _conflicts(source: Source, keys: Keys, found: dict[str, str]) -> Iterator[Problem]:
    """What a part says of its keys; an empty key is the part itself."""
    for key, what in found.items():
        where = (*keys, *key.split(".")) if key else keys
        yield Problem(source.mark(where), dotted(where), what)


def check_named_filters(
    source: Source,
    settings: Settings,
    group: Group,
    parts: dict[str, Any],
    problems: list[Problem],
) -> None:
    """Tables and figures may name filters only that the experiment has.

    They do under ``filters``, and under what they declare as ``label_keys``.
    """
    for name, part in parts.items():
        for key in ("filters", *getattr(part, "label_keys", ())):
            for where, label in _labels(getattr(part, key, None), (group, name, key)):
                if label not in (*settings.filters, settings.bound):
                    problems.append(no_filter(source, settings, where, label))


def _labels(value: Any, where: Keys) -> Iterator[tuple[Keys, str]]:
    """Every label in what a key holds, and where it stands."""
    if isinstance(value, str):
        yield where, value
        return
    inner: Iterable[tuple[str | int, Any]]
    if isinstance(value, dict):
        inner = value.items()
    elif isinstance(value, tuple):
        inner = enumerate(value)
    else:
        inner = ((key, getattr(value, key)) for key in getattr(value, "label_keys", ()))
    for key, part in inner:
        yield from _labels(part, (*where, key))


def no_filter(source: Source, settings: Settings, where: Keys, label: str) -> Problem:
    """What to say of a label that no filter has."""
    what = f"{label!r} is not a filter here; {unknown(label, list(settings.filters))}"
    return Problem(source.mark(where), dotted(where), what)


def check_drawable(
    source: Source,
    group: Group,
    parts: dict[str, Any],
    points: list[Point | None],
    problems: list[Problem],
) -> None:
    """What tables and figures say themselves about these points."""
    there = [point for point in points if point is not None]
    for name, part in parts.items() if there and len(there) == len(points) else ():
        conflicts = getattr(part, "conflicts", None)
        problems += _conflicts(source, (group, name), conflicts(there) if conflicts else {})


def check_figures(
    source: Source,
    settings: Settings,
    figures: dict[str, Any],
    points: list[Point | None],
    problems: list[Problem],
) -> None:
    """A figure may show only runs and components that there are."""
    sizes = [len(p.scenario.model.motion.components) for p in points if p is not None]
    limits = {"run": settings.runs, "component": min(sizes, default=1)}
    for name, figure in figures.items():
        for key, most in limits.items():
            number = getattr(figure, key, None)
            if isinstance(number, int) and number > most:
                where = ("figures", name, key)
                what = f"{number} is more than the {most} there {'are' if most > 1 else 'is'}"
                problems.append(Problem(source.mark(where), dotted(where), what))


def with_recorded_runs(
    source: Source, settings: Settings, points: list[Point | None], problems: list[Problem]
) -> Settings:
    """All recorded runs unless fewer are asked for; a simulated scenario has as many as one likes."""
    counts = [getattr(p.scenario, "recorded_runs", None) for p in points if p is not None]
    most = min((count for count in counts if count is not None), default=None)
    if most is None or ("runs" in source.data and settings.runs <= most):
        return settings
    if "runs" in source.data:
        what = f"{settings.runs} is more than the {most} recorded runs"
        problems.append(Problem(source.mark(("runs",)), "runs", what))
    return replace(settings, runs=most)
