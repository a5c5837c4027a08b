"""Validate a config, whose parts are included and whose keys are overridden, and build its experiment.

All mistakes are collected before anything runs.
"""

from pathlib import Path

from trackbench.config.added_tables_and_figures import add_default_exhibits
from trackbench.config.bound_and_exact_errors import check_bound, check_exact
from trackbench.config.build_components import build, build_exhibits, build_kind
from trackbench.config.check_after_mistakes import (
    build_independent_settings,
    check_components,
    with_unchecked_note,
)
from trackbench.config.chosen_filters import chosen_labels
from trackbench.config.default_metrics_of_tables_and_figures import fill_default_metrics
from trackbench.config.experiment import DrawnExhibit, Exhibit, Experiment, Point
from trackbench.config.experiment_keys import Settings
from trackbench.config.files_key import check_idle_files
from trackbench.config.filter_model import check_assumed, read_assumed
from trackbench.config.filter_requirements import check_fit, check_late
from trackbench.config.grid import apply_point, grid_points
from trackbench.config.idle_keys import check_idle, check_idle_late, check_idle_settings
from trackbench.config.metric_name_checks import check_metrics
from trackbench.config.number_of_runs import with_recorded_runs
from trackbench.config.read_published_files import read_published_of_config
from trackbench.config.requested_metrics import requests_of
from trackbench.config.standard_problem import check_problem
from trackbench.config.table_and_figure_checks import (
    check_drawable,
    check_figures,
    check_key_figure,
    check_named_filters,
)
from trackbench.config.training_data import training_point
from trackbench.config.tune_key_and_tuning_checks import check_trained_metrics, tuned_axes
from trackbench.config.tuning_defaults import with_tuning_defaults
from trackbench.errors import Problem, UserError
from trackbench.filters.base import AnyFilter
from trackbench.plugins.plugin_content import Plugin
from trackbench.plugins.plugin_errors import PluginError
from trackbench.plugins.scenario_trial import check_scenario
from trackbench.registry import Group
from trackbench.yaml_source import Source


def validate(source: Source, folder: Path, plugins: tuple[Plugin, ...] = ()) -> Experiment:
    """Build and check the components of a config; raises UserError with every mistake.

    After a mistake the check continues as far as possible, so that one round of corrections is enough.
    ``folder`` is the config's, from which paths of published files count.
    """
    # Step 1: the top level. Keys with mistakes are left out if the rest can be checked without them.
    complete_settings = build(Settings, source, ())
    settings = complete_settings or build_independent_settings(source)
    if settings is not None and not settings.filters:  # no label can be known
        source.add_problem(("filters",), "name at least one filter")
        settings = None
    if settings is None:
        check_components(source)
        raise with_unchecked_note(source)
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
    settings = with_tuning_defaults(source, settings, points, training)
    axes = tuned_axes(source, settings, points, training)
    # Step 4: tables and figures.
    if complete_settings:
        add_default_exhibits(source, settings, points)
    fill_default_metrics("tables", source, points)
    fill_default_metrics("figures", source, points)
    tables: dict[str, Exhibit] = build_exhibits("tables", source)
    figures: dict[str, DrawnExhibit] = build_exhibits("figures", source)
    exhibits: dict[Group, dict[str, Exhibit]] = {"tables": tables, "figures": {**figures}}
    for group, exhibits_of_group in exhibits.items():
        check_named_filters(source, settings, group, exhibits_of_group)
        check_drawable(source, group, exhibits_of_group, complete_grid)
    check_key_figure(source, settings)
    if complete_settings:  # else the number of runs may be unknown
        check_figures(source, settings, figures, points)
    # Step 5: names of metrics and published files.
    has_other_mistakes = bool(source.problems)
    published = read_published_of_config(source, settings, folder, complete_grid)
    check_metrics(source, settings, complete_grid, exhibits, left_out, published, folder)
    check_trained_metrics(source, settings, training)
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
        raise with_unchecked_note(source)
    source.check()
    return experiment


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


class UnknownNamesError(UserError):
    """Mistakes in names of metrics or rows of published files only; the experiment is complete."""

    def __init__(self, experiment: Experiment, *problems: Problem) -> None:
        super().__init__(*problems)
        self.experiment = experiment
