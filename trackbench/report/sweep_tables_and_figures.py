"""Tables and figures that a sweep gives an experiment: a figure per varied filter, the best settings."""

import re
from dataclasses import replace

from trackbench.config.added_tables_and_figures import free_name
from trackbench.config.experiment import DrawnExhibit, Experiment
from trackbench.config.experiment_keys import Settings
from trackbench.config.grid import filters_of, independent_filter_paths, single_paths
from trackbench.config.published_numbers_and_claims import Published
from trackbench.report.figures.sweep import MOST_PATHS, SweepFigure
from trackbench.report.findings import grid_headings
from trackbench.report.findings.phrases import listed
from trackbench.report.tables.best_settings import BestSettings

_TABLE = "best-settings"
_MOST_LETTERS = 70
"""Letters of a figure's name, at most, which is that of its file."""


def as_sweep(experiment: Experiment) -> Experiment:
    """Return the experiment with the figures of a sweep in place of its own, and without published rows.

    Its own figures would have a panel per point. Published rows are about the experiment without a
    sweep. If the sweep varies filters, a table of their best values is added.
    """
    settings = experiment.settings
    tables = experiment.tables
    if independent_filter_paths(settings.grid, settings.filters, settings.reference):
        others = [name for name, table in tables.items() if not isinstance(table, BestSettings)]
        # The added table comes first. A table of the config that has its kind and name replaces it.
        tables = {free_name(_TABLE, others): BestSettings()} | tables
    return replace(
        experiment,
        settings=replace(settings, published=[]),
        published=Published(),
        tables=tables,
        figures=figures_of_sweep(settings),
    )


def figures_of_sweep(settings: Settings) -> dict[str, DrawnExhibit]:
    """Make the figures of a sweep by name: one for each filter that the grid varies, else one in all.

    A figure shows two paths at most. If there are more, it shows the first two of the filter, and other
    paths only if the filter has fewer.
    """
    grid = list(settings.grid)
    # A group has the paths of one filter, or of filters that a common path varies. All other paths, such
    # as those of the scenario, are in the figure of every group.
    groups = independent_filter_paths(grid, settings.filters, settings.reference)
    independent = set[str]().union(*groups)
    figures: dict[str, DrawnExhibit] = {}
    # Without a group, one figure has all paths.
    for group in groups or [[]]:
        paths = [path for path in grid if path in group or path not in independent]
        if len(paths) > MOST_PATHS:
            filter_paths = [path for path in paths if path in group]
            other_paths = [path for path in paths if path not in group]
            paths = [*filter_paths, *other_paths][:MOST_PATHS]
        # A title such as ``q of KF``.
        title = " and ".join(map(grid_headings.axis, paths))
        labels: dict[str, None] = {}
        for path in paths:
            labels |= dict.fromkeys(filters_of(path, settings.filters))
        if labels:
            title += f" of {listed(list(labels))}"
        name = "-".join(["sweep", *map(_file_name, paths)])[:_MOST_LETTERS]
        figures[free_name(name, figures)] = SweepFigure(paths=tuple(paths), title=title)
    return figures


def _file_name(path: str) -> str:
    """Write a path as every system takes it: ``KF-assume-motion-q``."""
    without_group = single_paths(path)[0].partition(".")[2]
    return "-".join(re.findall("[A-Za-z0-9]+", without_group))
