"""Load an experiment: read its file, include its parts, override keys, validate.

All mistakes are collected before anything runs. A grid (``grid: {scenario.R: [0.1, 1]}``) makes one
point per combination; without one there is a single point. Paths joined by `` & `` take each value
together, as ``filters.A.q & filters.B.q: [0, 1]``.
"""

import copy
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from trackbench.config.added_filters import add_filters, show_filters
from trackbench.config.added_tables_and_figures import add_default_exhibits
from trackbench.config.bound_and_exact_errors import check_bound, check_exact
from trackbench.config.build_components import build, build_kind
from trackbench.config.chosen_filters import chosen_labels, set_only
from trackbench.config.experiment import DrawnExhibit, Exhibit, Experiment, Point
from trackbench.config.experiment_keys import Settings
from trackbench.config.files_key import check_idle_files
from trackbench.config.filter_model import check_assumed, check_idle_late, check_late, read_assumed
from trackbench.config.filter_requirements import check_fit
from trackbench.config.grid import add_axis, apply_point, grid_points
from trackbench.config.idle_keys import check_idle, check_idle_settings
from trackbench.config.includes import check_overridden_parts, inline_parts
from trackbench.config.metric_mistakes import check_metrics, check_trained_metrics
from trackbench.config.number_of_runs import set_runs, with_recorded_runs
from trackbench.config.overrides import override, override_all
from trackbench.config.plugins_of_config import load_plugins
from trackbench.config.published_csv import Published, read_published
from trackbench.config.python_config import from_mapping
from trackbench.config.python_tables import put_tables
from trackbench.config.requested_metrics import fill_default_metrics, requests_of
from trackbench.config.smoothed_filters import add_smoothed
from trackbench.config.standard_problem import PROBLEM_KEYS, check_problem
from trackbench.config.table_and_figure_checks import (
    check_drawable,
    check_figures,
    check_key_figure,
    check_named_filters,
)
from trackbench.config.training_data import training_point
from trackbench.config.tuned_filters import Chosen, add_tuned
from trackbench.config.tuning_checks import tuned_axes, with_defaults
from trackbench.errors import Mark, Problem, RunError, UserError
from trackbench.filters.base import AnyFilter
from trackbench.plugins.guarded_code import guarded
from trackbench.plugins.plugin_content import Plugin
from trackbench.plugins.plugin_errors import PluginError, foreign_line
from trackbench.plugins.scenario_trial import check_scenario
from trackbench.registry import Group
from trackbench.yaml_source import Assembled, Source, read

_LEAST_SIMILARITY = 0.7  # of two keys: `title` and `titel` have 0.8, `bound` and `bogus` 0.6
_INDEPENDENT_KEYS = {
    "name",
    "title",
    "seed",
    "runs",
    "verdict_seeds",
    "block",
    "medians",
    "matters",
    "metrics",
    "per_step",
    "published",
}
"""Settings that no other part of the file depends on: the rest is checked despite mistakes in them."""


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
    """Read and validate an experiment.

    Parameters
    ----------
    config
        path of the YAML file, a mapping, or a config put together by trackbench; paths in a file count
        from the file, those in a mapping from the working folder
    overrides
        assignments ``PATH=VALUE`` that replace values of the config
    only
        labels of the filters to run; default: all, or the config's ``only``
    runs, seed
        number of runs and seed; default: those of the config
    grid
        assignments of several values (``filters.HDEPF.F=0.5,0.9``) that add to the config's grid
    product
        if the config has no grid: every combination of the values of ``grid`` is a point
    allow_plugins
        run the code of all plugins and programs that the config names
    tuned_values
        results of tuning, by label and key
    filter_files
        Python files and programs with more filters; their code may run
    quick
        take few runs
    tables
        data from Python, by key of the target
    chosen
        files of the config whose code may run without ``allow_plugins``

    Returns
    -------
    Experiment
        the validated experiment

    Raises
    ------
    UserError
        with every mistake found
    """
    # Step 1: read the config.
    if isinstance(config, Assembled):
        source = copy.deepcopy(config.source)
        home = Path()
        chosen = (*chosen, *config.allowed)
    elif isinstance(config, Mapping):
        source = from_mapping(config)
        home = Path()
    else:
        source = read(config)
        home = config.parent
    if not isinstance(source.data, dict):
        raise UserError(source.problem((), "an experiment is a mapping of keys to values"))
    if "groups" in source.data and "scenario" not in source.data:
        message = "is a suite of problems, and no experiment; run it by `trackbench suite`"
        raise UserError(Problem(source.mark(("groups",)), "groups", message))
    source.programs = None if allow_plugins else {str(file.absolute()) for file in chosen}
    # Step 2: put it together: files that it includes, then options of the command line. A component
    # whose file cannot be read is an empty mapping from here on, so that the mistakes in the rest are
    # found, too.
    unread = inline_parts(source, home)  # reasons by the component's path
    runs_of_config = source.data.get("runs")
    added_labels = add_filters(source, filter_files)
    overridden = override_all(source, overrides)
    check_overridden_parts(source, overridden)
    for keys in overridden:
        is_of_added_filter = len(keys) > 1 and keys[1] in added_labels
        # With other keys the experiment is no longer the standard problem of its name.
        if keys[0] in PROBLEM_KEYS and not is_of_added_filter:
            source.data.pop("problem", None)
    set_runs(source, runs, seed, quick)
    if grid and not source.data.get("grid") and "product" not in source.data:
        override(source, ("product",), product, Mark("--product"))
    for axis in grid:
        add_axis(source, axis)
        source.data.pop("problem", None)  # a grid is no standard problem either
    set_only(source, only)
    show_filters(source, added_labels)
    add_tuned(source, tuned_values or {})
    add_smoothed(source)
    # Step 3: run the plugins' code, so that their kinds are known, and validate.
    plugins = load_plugins(source, home, allow_plugins, (*filter_files, *chosen))
    try:
        put_tables(source, tables or {})
        experiment = _validate_with_plugin_errors(source, home, plugins)
    except UserError as error:
        if not unread:
            raise error from None
        raise _with_unread_components(error, unread) from None
    if unread:  # the rest has no mistakes
        raise _with_unread_components(UserError(), unread)
    # Step 4: note the number of runs of the config, or its default, if the options take fewer.
    is_recorded = any(p.scenario.recorded_runs is not None for p in experiment.points)
    if runs_of_config is None and not is_recorded:
        runs_of_config = Settings.runs
    if isinstance(runs_of_config, int) and runs_of_config > experiment.settings.runs:
        return replace(experiment, runs_of_config=runs_of_config)
    return experiment


def _with_unread_components(error: UserError, unread: dict[str, list[Problem]]) -> UserError:
    """Drop the mistakes inside a component that could not be read; add the reasons why it could not.

    ``unread`` has the reasons by the component's path. Mistakes that are mere texts are dropped, too, as
    they do not name the component that they are in.
    """
    unread_paths = tuple(f"{path}." for path in unread)
    problems: set[Problem] = set()
    for reasons in unread.values():
        problems.update(reasons)
    for problem in error.problems:
        if isinstance(problem, Problem) and not f"{problem.path}.".startswith(unread_paths):
            problems.add(problem)
    return UserError(*sorted(problems))


def _validate_with_plugin_errors(
    source: Source, folder: Path, plugins: tuple[Plugin, ...]
) -> Experiment:
    """Validate the config; an unexpected error of a plugin becomes a mistake with the plugin's line.

    ``folder`` is the config's, from which paths of published files count.
    """
    try:
        with guarded():  # plugin code cannot end the program
            return _validate(source, folder, plugins)
    except UserError:
        raise
    except Exception as error:
        message = foreign_line(error)  # None if no plugin code was running
        if not message:
            # Without a line of a plugin only a RunError, which has its own message, is a mistake.
            if not isinstance(error, RunError):
                raise
            message = str(error)
        raise UserError(Problem(Mark(source.mark(()).file), "", message)) from None


def _validate(source: Source, folder: Path, plugins: tuple[Plugin, ...] = ()) -> Experiment:
    """Build and check the components of a config; raises UserError with every mistake.

    After a mistake the check continues as far as possible, so that one round of corrections is enough.
    ``folder`` is the config's, from which paths of published files count.
    """
    # Step 1: the top level. Keys with mistakes are left out if the rest can be checked without them.
    complete_settings = build(Settings, source, ())
    settings = complete_settings or _build_independent_settings(source)
    if settings is not None and not settings.filters:  # no label can be known
        source.add_problem(("filters",), "name at least one filter")
        settings = None
    if settings is None:
        _check_components(source)
        raise _with_unchecked_note(source)
    labels = chosen_labels(source, settings)
    # Step 2: scenario and filters at each point of the grid.
    points = []
    is_grid_complete = True
    for values, marks in grid_points(source, settings):
        apply_point(source, values, marks)
        point = _build_point(source, labels, values)
        if point is None:
            is_grid_complete = False
        else:
            points.append(point)
    complete_grid = points if is_grid_complete else []
    # Keys that have no effect are mistakes. This is known only if no point is missing.
    check_idle(source, complete_grid)
    check_idle_late(source, complete_grid)
    if not source.problems:
        for point in points:
            check_exact(source, settings, point)
    check_idle_settings(source, settings, points)
    check_idle_files(source, settings)
    check_problem(source, settings)
    left_out = _build_filters(source, [b for b in settings.filters if b not in labels])
    if complete_settings:
        settings = with_recorded_runs(source, settings, points)
    # Step 3: the tuned filters and their training scenario.
    training = None
    if settings.tune and points:
        training = training_point(source, points[0])
    settings = with_defaults(source, settings, points, training)
    axes = tuned_axes(source, settings, points, training)
    # Step 4: tables and figures.
    if complete_settings:
        add_default_exhibits(source, settings, points)
    tables: dict[str, Exhibit] = _build_exhibits("tables", source, points)
    figures: dict[str, DrawnExhibit] = _build_exhibits("figures", source, points)
    exhibits: dict[Group, dict[str, Exhibit]] = {"tables": tables, "figures": {**figures}}
    for group, exhibits_of_group in exhibits.items():
        check_named_filters(source, settings, group, exhibits_of_group)
        check_drawable(source, group, exhibits_of_group, complete_grid)
    check_key_figure(source, settings)
    if complete_settings:  # else the number of runs may be unknown
        check_figures(source, settings, figures, points)
    # Step 5: names of metrics and published files.
    has_other_mistakes = bool(source.problems)
    check_metrics(source, settings, complete_grid, exhibits, left_out)
    check_trained_metrics(source, settings, training)
    published = _read_published(source, settings, folder, complete_grid)
    experiment = Experiment(
        settings=settings,
        points=points,
        left_out=left_out,
        tables=tables,
        figures=figures,
        source=source,
        published=published,
        plugins=plugins,
        tuned=axes,
        training=training,
    )
    # With unknown names alone the experiment is complete: the list of its metrics (`trackbench list
    # metrics CONFIG`) takes it from the error.
    if source.problems and not has_other_mistakes:
        raise UnknownNamesError(experiment, *sorted(set(source.problems)))
    # The names of metrics that tables and figures have cannot be checked without a scenario.
    if source.problems and not complete_grid and any(requests_of(exhibits)):
        raise _with_unchecked_note(source)
    source.check()
    return experiment


def _with_unchecked_note(source: Source) -> UserError:
    """Return the error of all mistakes; if they are several, the last line says that more may follow."""
    problems = sorted(set(source.problems))
    if len(problems) > 1:
        message = (
            f"more may follow: what depends on these keys, such as metrics, is checked when these "
            f"{len(problems)} mistakes are mended"
        )
        problems.append(Problem(Mark(source.mark(()).file), "", message))
    return UserError(*problems)


def _build_independent_settings(source: Source) -> Settings | None:
    """Build the settings without mistaken keys; None if other parts of the config depend on these.

    With these settings the rest of the config can be checked, too.
    """
    mistaken_keys = {problem.path.partition(".")[0] for problem in source.problems}
    known_keys = [key.name for key in fields(Settings)]
    # An unknown key is left out, unless it may be a misspelt one that other parts depend on.
    for mistaken_key in mistaken_keys:
        for near_key in get_close_matches(mistaken_key, known_keys, 1, _LEAST_SIMILARITY):
            if near_key not in _INDEPENDENT_KEYS:
                return None
    # Any name will do if the config's is mistaken: an experiment with mistakes is not run.
    data: dict[str, object] = {"name": "mistaken"}
    for key, value in source.data.items():
        if key not in mistaken_keys:
            data[key] = value
    # With a source of its own, since the mistakes of the other keys are in ``source`` already.
    return build(Settings, Source(source.data), (), data)


def _build_point(source: Source, labels: list[str], values: dict[str, object]) -> Point | None:
    """Build the scenario and the filters ``labels`` at a point of the grid.

    Return None if the scenario has mistakes. ``values`` are those of the point. The config in ``source``
    already has them, and gets the mistakes.
    """
    scenario = build_kind("scenarios", source, ("scenario",))
    filters = _build_filters(source, labels)
    assumed = {}
    for label in labels:
        assume = read_assumed(source, label)
        if assume is not None:
            assumed[label] = assume
    if scenario is None:
        return None
    try:
        # The lower bounds of errors are computed for the check, too, if the config requests them.
        check_scenario(scenario, bounded=source.data.get("bound") is not None)
    except PluginError as error:
        source.add_problem(("scenario",), str(error))
        return None
    point = Point(values=dict(values), scenario=scenario, filters=filters, assumed=assumed)
    check_bound(source, scenario)
    for label, tracker in filters.items():
        assumed_scenario = check_assumed(source, point, label)
        if tracker is not None and assumed_scenario is not None:
            check_fit(source, ("filters", label), tracker, assumed_scenario)
            check_late(source, ("filters", label), tracker, assumed_scenario)
    return point


def _build_filters(source: Source, labels: list[str]) -> dict[str, AnyFilter]:
    return {label: build_kind("filters", source, ("filters", label)) for label in labels}


def _check_components(source: Source) -> None:
    """Add the mistakes within the scenario, filters, tables and figures to the source.

    Each is checked for itself: the components that it builds are not used.
    """
    if isinstance(source.data.get("scenario"), dict):
        build_kind("scenarios", source, ("scenario",))
    for group in ("filters", "tables", "figures"):
        if isinstance(source.data.get(group), dict):
            for label in source.data[group]:
                build_kind(group, source, (group, label))


def _build_exhibits(group: Group, source: Source, points: list[Point]) -> dict[str, Any]:
    """Build the tables or the figures, as ``group`` says, by name; those with mistakes are left out.

    The source gets the mistakes, and default metrics for entries without `metric`. ``points`` are those
    of the grid.
    """
    fill_default_metrics(group, source, points)
    exhibits = {}
    for name in source.data.get(group) or {}:
        exhibit = build_kind(group, source, (group, name))
        if exhibit is not None:
            exhibits[name] = exhibit
    return exhibits


def _read_published(
    source: Source, settings: Settings, folder: Path, points: list[Point]
) -> Published:
    """Read the published files of the config; their mistakes are added to the source.

    Paths count from ``folder``. ``points`` are those of the grid.
    """
    labels = list(settings.filters)
    if settings.bound:
        labels.append(settings.bound)
    # A grid from the command line leaves out points that rows may name: points are then not checked.
    grid_places = [("grid",), *(("grid", path) for path in settings.grid)]
    grid_files = {source.mark(keys).file for keys in grid_places}
    point_values = None
    if grid_files == {source.mark(()).file}:
        point_values = [point.values for point in points]
    try:
        return read_published(
            folder,
            settings.published,
            settings.name,
            labels,
            mark=source.mark(("published",)),
            points=point_values,
            # A table with the key `of` may show the rows of another experiment.
            related_experiments=[str(table.get("of")) for table in settings.tables.values()],
        )
    except UserError as error:
        source.problems += [p for p in error.problems if isinstance(p, Problem)]
        return Published()
