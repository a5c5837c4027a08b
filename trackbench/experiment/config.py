"""An experiment file: read, put together from its parts, overridden, validated.

All mistakes are collected before anything runs. A grid (``grid: {scenario.R: [0.1, 1]}``) makes one
point per combination; without one there is a single point. Paths joined by `` & `` take each value
together, as ``filters.A.q & filters.B.q: [0, 1]``.
"""

import itertools
import os
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, fields, is_dataclass, replace
from math import prod
from pathlib import Path
from typing import Annotated, Any

from pydantic import StringConstraints

from trackbench.experiment.axes import add_axis
from trackbench.experiment.compose import assignment, inline_parts, override, split_path
from trackbench.experiment.plugins import Plugin, load_plugins
from trackbench.experiment.problems import Mark, Problem, UserError
from trackbench.experiment.published import Published, read_published
from trackbench.experiment.source import Keys, Source, dotted, read
from trackbench.experiment.validate import at, build, file_keys, unknown
from trackbench.filters.base import AnyFilter
from trackbench.keys import Count, DataError, Natural
from trackbench.models.base import Model
from trackbench.registry import Group, kinds
from trackbench.scenarios.base import Scenario

Name = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$", max_length=80)]
Label = Annotated[str, StringConstraints(pattern=r"^[^\x00-\x1f\x7f]+$", max_length=80)]

_TOGETHER = " & "


_MOST_POINTS = 10_000


@dataclass(frozen=True, kw_only=True)
class Settings:
    """The top level of an experiment file."""

    name: Name
    """name of the experiment, and of its folder under results/"""
    title: str = ""
    """one line for people"""
    seed: Natural = 0
    """seed of every random number"""
    runs: Count = 100
    """Monte Carlo runs"""
    block: Count | None = None
    """runs computed together; default: from each filter's N, about 32 000 particles at a time"""
    scenario: dict[str, Any]
    """what is simulated: kind and keys, a path, or {use: path, key: value}"""
    filters: dict[Label, dict[str, Any]]
    """filters by label, each like the scenario"""
    reference: Label | None = None
    """label of the filter whose estimates the others' distances are measured to"""
    bound: Label | None = None
    """name under which the scenario's lower bounds stand in tables and figures; default: nowhere"""
    medians: list[str] = field(default_factory=list)
    """series whose median per step is wanted, such as nees"""
    grid: dict[str, list[Any]] = field(default_factory=dict)
    """paths and the values they take: every combination is run; `a & b` take a value together"""
    tables: dict[Name, dict[str, Any]] = field(default_factory=dict)
    """tables to write, by name"""
    figures: dict[Name, dict[str, Any]] = field(default_factory=dict)
    """figures to draw, by name"""
    published: list[str] = field(default_factory=list)
    """CSV files of published numbers and claims that the results are held against"""
    plugins: list[str] = field(default_factory=list)
    """Python files with filters or scenarios of one's own; loaded with --allow-plugins only"""


@dataclass(frozen=True)
class Point:
    """One combination of the grid's values, with its scenario and filters by label."""

    values: dict[str, Any]
    scenario: Scenario
    filters: dict[str, AnyFilter]


@dataclass(frozen=True)
class Experiment:
    """A validated experiment; ``source`` is its config with positions."""

    settings: Settings
    points: list[Point]
    tables: dict[str, Any]
    figures: dict[str, Any]
    source: Source
    published: Published
    plugins: tuple[Plugin, ...] = ()

    @property
    def shown_runs(self) -> int:
        """How many runs' whole tracks the figures need."""
        return max((getattr(f, "shown_runs", 0) for f in self.figures.values()), default=0)

    @property
    def shown_covariances(self) -> bool:
        """Whether a figure needs those tracks' covariances too."""
        return any(getattr(f, "shown_covariances", False) for f in self.figures.values())

    def title_of(self, key: tuple[int, str]) -> str:
        """A filter at a grid point, for people."""
        values = self.points[key[0]].values
        at_point = ", ".join(f"{path} = {value}" for path, value in values.items())
        return f"{key[1]} at {at_point}" if at_point else key[1]

    def resolved(self, folder: Path) -> dict[str, Any]:
        """The config as plain data with every default; a grid keeps its list of values.

        Paths are relative to ``folder``, where the config is to be written.
        """
        first = self.points[0]
        out = asdict(self.settings)

        def relative(path: str) -> str:
            return os.path.relpath(path, folder)

        out["plugins"] = [relative(plugin.path) for plugin in self.plugins]
        # A results folder holds copies of the files under these names, so that it stands alone.
        out["published"] = [f"published/{name}" for name in self.published.files]
        out["scenario"] = as_config(first.scenario, relative)
        parts = {"filters": first.filters, "tables": self.tables, "figures": self.figures}
        for group, built in parts.items():
            out[group] = {name: as_config(part, relative) for name, part in built.items()}
        return out


def load(
    path: Path,
    overrides: list[str] | None = None,
    only: list[str] | None = None,
    runs: int | None = None,
    seed: int | None = None,
    grid: list[str] | None = None,
    allow_plugins: bool = False,
) -> Experiment:
    """Read and validate an experiment; raises UserError with every mistake found.

    ``grid`` are assignments of several values (``filters.HDEPF.F=0.5,0.9``) that add to the file's.
    """
    source = read(path)
    if not isinstance(source.data, dict):
        raise UserError(
            Problem(source.mark(()), "", "an experiment is a mapping of keys to values")
        )
    unread = inline_parts(source, path.parent)
    for text in overrides or []:
        keys, value, mark = assignment(source, text)
        override(source, keys, value, mark)
    for key, number in (("runs", runs), ("seed", seed)):
        if number is not None:
            override(source, (key,), number, Mark(f"--{key}"))
    for text in grid or []:
        add_axis(source, text)
    plugins = load_plugins(source, path.parent, allow_plugins)
    try:
        experiment = _validated(source, only, path.parent, plugins)
    except UserError as error:
        raise _with_unread(unread, error) if unread else error from None
    if unread:
        raise _with_unread(unread, UserError())
    return experiment


def _with_unread(unread: dict[str, list[Problem]], error: UserError) -> UserError:
    """The mistakes found, but of a part that could not be read only why."""
    parts = tuple(f"{part}." for part in unread)
    found = [p for p in error.problems if isinstance(p, Problem)]
    other = [p for p in found if not f"{p.path}.".startswith(parts)]
    return UserError(*sorted({*itertools.chain(*unread.values()), *other}))


def _validated(
    source: Source, only: list[str] | None, folder: Path, plugins: tuple[Plugin, ...] = ()
) -> Experiment:
    problems: list[Problem] = []
    settings = build(Settings, source, (), problems)
    if settings is None:
        # Go on to the parts, so that one round of corrections is enough.
        _sections(source, problems)
        raise UserError(*sorted(set(problems)))
    labels = _labels(source, settings, only, problems)
    points = []
    for values, marks in _grid(source, settings, problems):
        for joint, value in values.items():
            for path in joint.split(_TOGETHER):
                override(source, split_path(source, path), value, marks[joint])
        points.append(_point(source, labels, values, problems))
    settings = _with_recorded_runs(source, settings, points, problems)
    tables = _parts("tables", source, problems)
    figures = _parts("figures", source, problems)
    _check_named_filters(source, settings, tables | figures, problems)
    _check_figures(source, settings, figures, points, problems)
    published = _published(source, settings, folder, problems)
    if problems:
        raise UserError(*sorted(set(problems)))
    found = [p for p in points if p is not None]
    return Experiment(settings, found, tables, figures, source, published, plugins)


def _point(
    source: Source, labels: list[str], values: dict[str, Any], problems: list[Problem]
) -> Point | None:
    scenario = build_kind("scenarios", source, ("scenario",), problems)
    filters = {b: build_kind("filters", source, ("filters", b), problems) for b in labels}
    if scenario is None:
        return None
    if source.data.get("bound") is not None and not hasattr(scenario, "bounds"):
        what = f"scenario {scenario.kind} has no lower bounds"
        problems.append(Problem(source.mark(("bound",)), "bound", what))
    for label, tracker in filters.items():
        if tracker is not None:
            _check_fit(source, ("filters", label), tracker, scenario, problems)
    return Point(dict(values), scenario, filters)


def build_kind(group: Group, source: Source, keys: Keys, problems: list[Problem]) -> Any:
    """The registered dataclass that the mapping at ``keys`` asks for by its ``kind``."""
    data = at(source, keys)
    if not isinstance(data, dict) or "kind" not in data:
        what = "needs a kind" if isinstance(data, dict) else "is not a mapping with a kind"
        problems.append(Problem(source.mark(keys), dotted(keys), what))
        return None
    known = kinds(group)
    kind = data["kind"]
    if not isinstance(kind, str) or kind not in known:
        what = f"{kind!r} is not a kind of {group[:-1]}; {unknown(str(kind), list(known))}"
        problems.append(Problem(source.mark((*keys, "kind")), dotted((*keys, "kind")), what))
        return None
    cls = known[kind]
    own = _with_absolute_files(cls, source, keys, _with_preset(cls, source, keys, problems))
    nested = {
        key: build_kind(inner, source, (*keys, key), problems)
        for key, inner in getattr(cls, "parts", {}).items()
        if own.pop(key, None) is not None
    }
    part = Source(own, {}, {})
    for mine, marks in ((part.marks, source.marks), (part.key_marks, source.key_marks)):
        mine.update({k[len(keys) :]: m for k, m in marks.items() if k[: len(keys)] == keys})
    found: list[Problem] = []
    built = build(cls, part, (), found)
    problems += [
        Problem(p.mark, ".".join(filter(None, [dotted(keys), p.path])), p.what) for p in found
    ]
    return _assembled(cls, built, nested, source, keys, problems)


def _assembled(
    cls: type[Any],
    built: Any,
    nested: dict[str, Any],
    source: Source,
    keys: Keys,
    problems: list[Problem],
) -> Any:
    """The dataclass with the parts it is made of, such as the scenario that a recorded one is like."""
    missing = [key for key in getattr(cls, "parts", {}) if key not in nested]
    for key in missing:
        where = dotted((*keys, key))
        problems.append(Problem(source.mark(keys), where, "this key is required"))
    if built is None or missing or None in nested.values():
        return None
    try:
        return replace(built, **nested) if nested else built
    except DataError as error:
        problems += [
            Problem(Mark(where.file, where.line, where.column), dotted(keys), where.what)
            for where in error.places
        ]
    except ValueError as error:
        problems.append(Problem(source.mark(keys), dotted(keys), str(error)))
    return None


def _with_absolute_files(
    cls: type[Any], source: Source, keys: Keys, data: dict[str, Any]
) -> dict[str, Any]:
    """Paths count from the folder of the YAML file they stand in."""
    out = dict(data)
    for key in file_keys(cls):
        if isinstance(data.get(key), str):
            mark = source.mark((*keys, key))
            folder = Path(mark.file).parent if mark.line else Path()
            out[key] = str((folder / data[key]).absolute())
    return out


def _with_preset(
    cls: type[Any], source: Source, keys: Keys, problems: list[Problem]
) -> dict[str, Any]:
    data = {k: v for k, v in at(source, keys).items() if k != "kind"}
    name = data.get("preset")
    presets = getattr(cls, "presets", {})
    if name is None or not presets:
        return data
    del data["preset"]
    if not isinstance(name, str) or name not in presets:
        what = f"{name!r} is not a preset of {cls.kind}; {unknown(str(name), list(presets))}"
        where = (*keys, "preset")
        problems.append(Problem(source.mark(where), dotted(where), what))
        return data
    return _laid_over(presets[name], data)


def _laid_over(base: dict[str, Any], top: dict[str, Any]) -> dict[str, Any]:
    """``base`` with the keys of ``top``; a mapping in both is laid over in the same way."""
    both = {
        key: _laid_over(base[key], value)
        if isinstance(value, dict) and isinstance(base.get(key), dict)
        else value
        for key, value in top.items()
    }
    return {**base, **both}


def has(model: Model, need: str) -> bool:
    """Whether a model can do what a filter needs, such as ``motion.jacobian``."""
    part, _, name = need.partition(".")
    return hasattr(getattr(model, part), name)


def _check_fit(
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
    for key, what in (conflicts(scenario) if conflicts and not unmet else {}).items():
        where = (*keys, *key.split(".")) if key else keys
        problems.append(Problem(source.mark(where), dotted(where), what))


def _labels(
    source: Source, settings: Settings, only: list[str] | None, problems: list[Problem]
) -> list[str]:
    known = list(settings.filters)
    if not known:
        problems.append(Problem(source.mark(("filters",)), "filters", "name at least one filter"))
    for label in only or []:
        if label not in known:
            problems.append(Problem(Mark(f"--only {label}"), "", unknown(label, known)))
    if settings.bound in known:
        what = f"{settings.bound!r} is already the label of a filter"
        problems.append(Problem(source.mark(("bound",)), "bound", what))
    if settings.reference is not None and settings.reference not in known:
        what = f"{settings.reference!r} is not a filter here; {unknown(settings.reference, known)}"
        problems.append(Problem(source.mark(("reference",)), "reference", what))
    return [label for label in known if not only or label in only or label == settings.reference]


def _grid(
    source: Source, settings: Settings, problems: list[Problem]
) -> list[tuple[dict[str, Any], dict[str, Mark]]]:
    paths = list(settings.grid)
    for path, values in settings.grid.items():
        if not values:
            where = ("grid", path)
            problems.append(Problem(source.mark(where), dotted(where), "has no values"))
        elif any(
            split_path(source, single)[0] not in ("scenario", "filters")
            for single in path.split(_TOGETHER)
        ):
            where = ("grid", path)
            what = "a grid varies scenario.KEY or filters.LABEL.KEY"
            problems.append(Problem(source.key_mark(where), dotted(where), what))
            return []
    number = prod(len(settings.grid[p]) for p in paths)
    if number > _MOST_POINTS:
        what = f"{number} points; a grid has at most {_MOST_POINTS}"
        problems.append(Problem(source.mark(("grid",)), "grid", what))
        return []
    out = []
    for numbers in itertools.product(*(range(len(settings.grid[p])) for p in paths)):
        chosen = dict(zip(paths, numbers, strict=True))
        taken = {p: settings.grid[p][i] for p, i in chosen.items()}
        marks = {p: source.mark(("grid", p, i)) for p, i in chosen.items()}
        out.append((taken, marks))
    return out


def _sections(source: Source, problems: list[Problem]) -> None:
    if isinstance(source.data.get("scenario"), dict):
        build_kind("scenarios", source, ("scenario",), problems)
    for group in ("filters", "tables", "figures"):
        if isinstance(source.data.get(group), dict):
            for label in source.data[group]:
                build_kind(group, source, (group, label), problems)


def _parts(group: Group, source: Source, problems: list[Problem]) -> dict[str, Any]:
    parts = source.data.get(group) or {}
    return {name: build_kind(group, source, (group, name), problems) for name in parts}


def _check_named_filters(
    source: Source, settings: Settings, parts: dict[str, Any], problems: list[Problem]
) -> None:
    """Tables and figures may name filters only that the experiment has."""
    for name, part in parts.items():
        group = "tables" if name in settings.tables else "figures"
        for i, label in enumerate(getattr(part, "filters", None) or ()):
            if label not in (*settings.filters, settings.bound):
                where = (group, name, "filters", i)
                what = f"{label!r} is not a filter here; {unknown(label, list(settings.filters))}"
                problems.append(Problem(source.mark(where), dotted(where), what))
        for key in ("floor", "baseline"):
            label = getattr(part, key, None)
            if label is not None and label not in (*settings.filters, settings.bound):
                place = (group, name, key)
                what = f"{label!r} is not a filter here; {unknown(label, list(settings.filters))}"
                problems.append(Problem(source.mark(place), dotted(place), what))


def _published(
    source: Source, settings: Settings, folder: Path, problems: list[Problem]
) -> Published:
    mark = source.mark(("published",))
    try:
        return read_published(
            folder, settings.published, settings.name, list(settings.filters), mark
        )
    except UserError as error:
        problems += [p for p in error.problems if isinstance(p, Problem)]
        return Published()


def _check_figures(
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


def _with_recorded_runs(
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


def as_config(part: Any, shown: Callable[[str], str] = str) -> dict[str, Any]:
    """A registered dataclass as the mapping that makes it; ``shown`` is how paths are written."""
    files = file_keys(type(part))
    out = {"kind": part.kind}
    for key in fields(part):
        value = getattr(part, key.name)
        if key.name in files and value is not None:
            value = shown(value)
        out[key.name] = _plain(value, shown)
    return out


def _plain(value: Any, shown: Callable[[str], str]) -> Any:
    if is_dataclass(value) and not isinstance(value, type):
        return as_config(value, shown) if hasattr(value, "kind") else _plain(asdict(value), shown)
    if isinstance(value, dict):
        return {k: _plain(v, shown) for k, v in value.items()}
    return [_plain(v, shown) for v in value] if isinstance(value, list | tuple) else value
