"""Load an experiment: read its file, include its parts, override keys, validate.

All mistakes are collected before anything runs. A grid (``grid: {scenario.R: [0.1, 1]}``) makes one
point per combination; without one there is a single point. Paths joined by `` & `` take each value
together, as ``filters.A.q & filters.B.q: [0, 1]``.
"""

import copy
import itertools
from collections.abc import Mapping, Sequence
from dataclasses import fields
from difflib import get_close_matches
from itertools import chain
from pathlib import Path
from typing import Any

from trackbench.config.build import build, build_kind
from trackbench.config.checks import (
    QUICK,
    check_assumed,
    check_bound,
    check_drawable,
    check_exact,
    check_figures,
    check_fit,
    check_idle,
    check_idle_settings,
    check_key_figure,
    check_named_filters,
    check_problem,
    chosen_labels,
    with_recorded_runs,
)
from trackbench.config.experiment import DrawnExhibit, Exhibit, Experiment, Point, Settings
from trackbench.config.filter_model import check_idle_late, check_late, read_assumed
from trackbench.config.grid import add_axis, apply_point, grid_points
from trackbench.config.includes import assignment, inline_parts, override
from trackbench.config.plugin_checks import add_filters, load_plugins, show_filters
from trackbench.config.published import Published, read_published
from trackbench.config.python_tables import put_tables
from trackbench.config.requested_metrics import check_metrics, check_trained_metrics
from trackbench.config.tuned_entries import (
    Chosen,
    add_smoothed,
    add_tuned,
    training_point,
    tuned_axes,
    with_defaults,
)
from trackbench.errors import Mark, Problem, RunError, UserError
from trackbench.evaluation.metric_expression import Measure
from trackbench.filters.base import AnyFilter
from trackbench.models.base import position_velocity_names
from trackbench.plugins.checks import check_scenario
from trackbench.plugins.errors import PluginError, foreign_line, guarded
from trackbench.plugins.load import Plugin
from trackbench.registry import Group, kinds
from trackbench.scenarios.base import error_names
from trackbench.yaml_source import Assembled, Source, from_mapping, read, unprintable_reason

_ALIKE = 0.7  # of two keys: `title` and `titel` are 0.8, `bound` and `bogus` 0.6
_INDEPENDENT = {
    *("name", "title", "seed", "runs", "verdict_seeds", "block"),
    *("medians", "metrics", "per_step", "published"),
}

QUICK_RUNS = 20
_OF_PROBLEM = {"scenario", "filters", "grid"}
"""Overridden keys after which an experiment is no longer the standard problem of its name."""


class UnknownNamesError(UserError):
    """Mistakes in names of metrics or rows of published files only; the experiment is complete."""

    def __init__(self, experiment: Experiment, *problems: Problem) -> None:
        super().__init__(*problems)
        self.experiment = experiment


def load(
    config: Path | Mapping[str, object] | Assembled,
    overrides: Sequence[str] = (),
    only: Sequence[str] = (),
    runs: int | None = None,
    seed: int | None = None,
    grid: Sequence[str] = (),
    product: bool = False,
    allow_plugins: bool = False,
    tuned_values: Mapping[str, Chosen] | None = None,
    filter_files: Sequence[Path] = (),
    quick: bool = False,
    tables: Mapping[str, object] | None = None,
    chosen: Sequence[Path] = (),
) -> Experiment:
    """Read and validate an experiment; raises UserError with every mistake found.

    Paths count from the file, those in a mapping from the working folder. ``grid`` are assignments of
    several values (``filters.HDEPF.F=0.5,0.9``) that add to the file's; ``product``: every combination
    of them is a point if the file has no grid; ``tuned_values``: results of tuning, by label and key;
    ``filter_files``: files with more filters; ``chosen``: files of the config whose code may run, as
    that of those may; ``quick``: few runs; ``tables``: data from Python, by key of the target.
    """
    if isinstance(config, Assembled):
        source = copy.deepcopy(config.source)
        home = Path()
        chosen = (*chosen, *config.allowed)
    elif isinstance(config, Mapping):
        source, home = from_mapping(config), Path()
    else:
        source, home = read(config), config.parent
    if not isinstance(source.data, dict):
        raise UserError(source.problem((), "an experiment is a mapping of keys to values"))
    source.programs = None if allow_plugins else {str(file.absolute()) for file in chosen}
    # Step 1: put the config together: files that it includes, then options of the command line.
    unread = inline_parts(source, home)
    added = add_filters(source, filter_files)
    for text in overrides:
        keys, value, mark = assignment(source, text)
        override(source, keys, value, mark)
        if keys[0] in _OF_PROBLEM and not {*keys[1:2]} & added.keys():
            source.data.pop("problem", None)
    _set_runs(source, runs, seed, quick)
    if grid and not source.data.get("grid") and "product" not in source.data:
        override(source, ("product",), product, Mark("--product"))
    for axis in grid:
        add_axis(source, axis)
        source.data.pop("problem", None)
    _set_only(source, only)
    show_filters(source, added)
    add_tuned(source, tuned_values or {})
    add_smoothed(source)
    # Step 2: run the plugins' code, so that their kinds are known, and validate.
    plugins = load_plugins(source, home, allow_plugins, (*filter_files, *chosen))
    try:
        put_tables(source, tables or {})
        experiment = _validate_with_plugin_errors(source, home, plugins)
    except UserError as error:
        raise _with_unread(unread, error) if unread else error from None
    if unread:
        raise _with_unread(unread, UserError())
    return experiment


def _with_unread(unread: dict[str, list[Problem]], error: UserError) -> UserError:
    """Drop the mistakes inside a part that could not be read; keep the reason why it could not."""
    parts = tuple(f"{part}." for part in unread)
    problems = [p for p in error.problems if isinstance(p, Problem)]
    elsewhere = [p for p in problems if not f"{p.path}.".startswith(parts)]
    return UserError(*sorted({*itertools.chain(*unread.values()), *elsewhere}))


def _set_runs(source: Source, runs: int | None, seed: int | None, quick: bool) -> None:
    if quick:
        override(source, ("runs",), QUICK_RUNS, Mark(QUICK))
    for key, number in {"runs": runs, "seed": seed}.items():
        if number is not None:
            override(source, (key,), number, Mark(f"--{key}"))


def _set_only(source: Source, labels: Sequence[str]) -> None:
    for label in labels:
        if what := unprintable_reason(label):
            raise UserError(Problem(Mark(f"--only {label}"), "", what))
    if labels:
        override(source, ("only",), list(labels), Mark(f"--only {labels[0]}"))
    for i, label in enumerate(labels):
        override(source, ("only", i), label, Mark(f"--only {label}"))


def _validate_with_plugin_errors(
    source: Source, folder: Path, plugins: tuple[Plugin, ...]
) -> Experiment:
    """Validate; an unexpected error of a plugin becomes a mistake with its line."""
    try:
        with guarded():
            return _validated(source, folder, plugins)
    except UserError:
        raise
    except Exception as error:
        what = foreign_line(error) or (str(error) if isinstance(error, RunError) else None)
        if what is None:
            raise
        raise UserError(Problem(Mark(source.mark(()).file), "", what)) from None


def _settings(source: Source, whole: Settings | None) -> Settings:
    """Drop the mistakes of the settings; raises UserError if none are left."""
    settings = whole or _without_mistakes(source)
    if settings is not None and not settings.filters:  # of which no label can be known
        source.add_problem(("filters",), "name at least one filter")
        settings = None
    if settings is None:
        _sections(source)
        raise UserError(*sorted(set(source.problems)))
    return settings


def _validated(source: Source, folder: Path, plugins: tuple[Plugin, ...] = ()) -> Experiment:
    # Go on after a mistake as far as possible, so that one round of corrections is enough.
    # Step 1: the top level.
    whole = build(Settings, source, ())
    settings = _settings(source, whole)
    labels = chosen_labels(source, settings)
    # Step 2: scenario and filters at each point of the grid.
    built = []
    for values, marks in grid_points(source, settings):
        apply_point(source, values, marks)
        built.append(_point(source, labels, values))
    points = [point for point in built if point is not None]
    whole_grid = points if len(points) == len(built) else []
    check_idle(source, whole_grid)
    check_idle_late(source, whole_grid)
    for point in points if not source.problems else ():
        check_exact(source, settings, point)
    check_idle_settings(source, settings, points)
    check_problem(source, settings)
    left_out = _filters(source, [label for label in settings.filters if label not in labels])
    if whole:
        settings = with_recorded_runs(source, settings, points)
    # Step 3: what is tuned.
    training = training_point(source, points[0]) if settings.tune and points else None
    settings = with_defaults(source, settings, points, training)
    axes = tuned_axes(source, settings, points, training)
    # Step 4: tables and figures.
    if whole:
        _add_default_exhibits(source, settings, points)
    tables: dict[str, Exhibit] = _exhibits("tables", source, points)
    figures: dict[str, DrawnExhibit] = _exhibits("figures", source, points)
    exhibits: dict[Group, dict[str, Exhibit]] = {"tables": tables, "figures": {**figures}}
    for group, parts in exhibits.items():
        check_named_filters(source, settings, group, parts)
        check_drawable(source, group, parts, whole_grid)
    check_key_figure(source, settings)
    if whole:  # else the runs may not be known
        check_figures(source, settings, figures, points)
    # Step 5: names of metrics and published files.
    only_names = not source.problems
    check_metrics(source, settings, whole_grid, exhibits, left_out)
    check_trained_metrics(source, settings, training)
    published = _published(source, settings, folder, whole_grid)
    parsed = (tables, figures, source, published, plugins, axes, training)
    experiment = Experiment(settings, points, left_out, *parsed)
    if only_names and source.problems:
        raise UnknownNamesError(experiment, *sorted(set(source.problems)))
    source.check()
    return experiment


def _without_mistakes(source: Source) -> Settings | None:
    """Drop the mistakes of the settings, if no other part of the file depends on them."""
    mistaken = {p.path.partition(".")[0] for p in source.problems}
    known = [key.name for key in fields(Settings)]
    # An unknown key is left out, unless it may be a misspelt one that other parts depend on.
    near = (get_close_matches(key, known, 1, _ALIKE) for key in mistaken)
    if not _INDEPENDENT.issuperset(chain.from_iterable(near)):
        return None
    data = {"name": "mistaken"} | {k: v for k, v in source.data.items() if k not in mistaken}
    return build(Settings, Source(source.data), (), data)


def _point(source: Source, labels: list[str], values: dict[str, object]) -> Point | None:
    scenario = build_kind("scenarios", source, ("scenario",))
    filters = _filters(source, labels)
    assumed = {b: a for b in labels if (a := read_assumed(source, b)) is not None}
    if scenario is None:
        return None
    try:
        check_scenario(scenario, bounded=source.data.get("bound") is not None)
    except PluginError as error:
        source.add_problem(("scenario",), str(error))
        return None
    point = Point(dict(values), scenario, filters, assumed)
    check_bound(source, scenario)
    for label, tracker in filters.items():
        assumed_scenario = check_assumed(source, point, label)
        if tracker is not None and assumed_scenario is not None:
            check_fit(source, ("filters", label), tracker, assumed_scenario)
            check_late(source, ("filters", label), tracker, assumed_scenario)
    return point


def _filters(source: Source, labels: list[str]) -> dict[str, AnyFilter]:
    return {b: build_kind("filters", source, ("filters", b)) for b in labels}


def _sections(source: Source) -> None:
    if isinstance(source.data.get("scenario"), dict):
        build_kind("scenarios", source, ("scenario",))
    for group in ("filters", "tables", "figures"):
        if isinstance(source.data.get(group), dict):
            for label in source.data[group]:
                build_kind(group, source, (group, label))


def _exhibits(group: Group, source: Source, points: list[Point]) -> dict[str, Any]:
    """Build the tables or figures, without those that have mistakes.

    One whose kind shows an error by default, and names none, shows the scenario's first error.
    """
    names = source.data.get(group) or {}
    errors = error_names(points[0].scenario) if points and points[0].scenario.has_truth else []
    for name, entry in names.items() if errors else ():
        kind = entry.get("kind") if isinstance(entry, dict) and "metric" not in entry else None
        default = getattr(kinds(group).get(str(kind)), "metric", None)
        base = default.metric if isinstance(default, Measure) else ""
        if base.startswith("rmse") and base not in errors:
            metric = str(default).replace(base, errors[0])
            override(source, (group, name, "metric"), metric, source.mark((group, name)))
    built = {name: build_kind(group, source, (group, name)) for name in names}
    return {name: part for name, part in built.items() if part is not None}


def _published(source: Source, settings: Settings, folder: Path, points: list[Point]) -> Published:
    mark, labels = source.mark(("published",)), [*settings.filters]
    labels += [settings.bound] if settings.bound else []
    paths = [("grid",), *(("grid", path) for path in settings.grid)]
    # A grid from the command line leaves out points that rows may name.
    is_of_file = {source.mark(keys).file for keys in paths} == {source.mark(()).file}
    values = [point.values for point in points] if is_of_file else None
    also = [str(table.get("of")) for table in settings.tables.values()]
    try:
        return read_published(folder, settings.published, settings.name, labels, mark, values, also)
    except UserError as error:
        source.problems += [p for p in error.problems if isinstance(p, Problem)]
        return Published()


def _add_default_exhibits(source: Source, settings: Settings, points: list[Point]) -> None:
    """Add a track of the first run, or tables and figures of innovations, to configs that name none.

    The latter is for recordings without ground truth.
    """
    chosen = settings.metrics is not None or settings.per_step is not None
    if chosen or not points:
        return
    planar = points[0].scenario.components[:4] == position_velocity_names(2)
    # With ground truth: the track of the first run.
    if any(p.scenario.has_truth for p in points):
        if planar and not settings.grid and not settings.tables and not settings.figures:
            track = {"kind": "track"}
            override(source, ("figures",), {"track": track}, Mark("default in the plane"))
        return
    # Without: what needs only innovations.
    mark = Mark("default without ground truth")
    if "tables" not in source.data:
        override(source, ("tables",), {"innovations": {"kind": "innovations"}}, mark)
    if "figures" not in source.data:
        figures: dict[str, object] = {
            "nis": {"kind": "nis"},
            "whiteness": {"kind": "autocorrelation"},
        }
        if planar:
            figures["track"] = {"kind": "track"}
        else:
            figures["estimates"] = {"kind": "estimates"}
        override(source, ("figures",), figures, mark)
