"""Files of a sweep: one tidy table, a figure per filter, the best values in words."""

import re
from collections.abc import Iterator
from dataclasses import replace
from itertools import chain
from math import nan
from typing import NamedTuple

import numpy as np

from trackbench.atomic_files import free_name, write_csv
from trackbench.config.experiment import DrawnExhibit, Experiment, Settings
from trackbench.config.grid import filters_of, independent_filter_paths, single_paths
from trackbench.config.published import Published
from trackbench.evaluation.metric_expression import measured
from trackbench.report.figures.sweep import SweepFigure
from trackbench.report.findings import phrases
from trackbench.report.findings.phrases import listed, metric_words, with_unit
from trackbench.report.findings.ranking import best_settings
from trackbench.report.results import Results
from trackbench.report.table import rounded
from trackbench.report.tables.best_settings import BestSettings
from trackbench.results.point_facts import GridPoint

_AXES = 2
_TABLE = "best-settings"


def as_sweep(experiment: Experiment) -> Experiment:
    """Replace the experiment's figures by a sweep's, as they would have a panel per point.

    What is published is of the experiment as it is, so no point is held against it.
    """
    others = [name for name, t in experiment.tables.items() if not isinstance(t, BestSettings)]
    settings = experiment.settings
    varies_filters = independent_filter_paths(settings.grid, settings.filters, settings.reference)
    best = {free_name(_TABLE, others): BestSettings()} if varies_filters else {}
    return replace(
        experiment,
        settings=replace(settings, published=[]),
        published=Published(),
        tables=best | experiment.tables,
        figures=_figures(settings),
    )


def _figures(settings: Settings) -> dict[str, DrawnExhibit]:
    """Make a figure for each group of paths that are varied together, if they are one or two."""
    grid = list(settings.grid)
    apart = independent_filter_paths(grid, settings.filters, settings.reference)
    together = [path for path in grid if path not in set[str]().union(*apart)]
    figures: dict[str, DrawnExhibit] = {}
    for paths in apart or [[]]:
        shown = [path for path in grid if path in paths or path in together]
        if len(shown) <= _AXES:
            name = "-".join(["sweep", *map(_file_name, shown)])[:70]
            # A title such as ``q of KF``.
            of_paths = (filters_of(path, settings.filters) for path in shown)
            whose = dict.fromkeys(chain.from_iterable(of_paths))
            title = " and ".join(map(phrases.axis, shown))
            title += f" of {listed(list(whose))}" if whose else ""
            figure = SweepFigure(paths=tuple(shown), title=title)
            figures[free_name(name, figures)] = figure
    return figures


def write_sweep(results: Results) -> None:
    """Write ``sweep.csv``: one statistic of each metric, rms of errors, ANEES, mean of the rest."""
    rows = results.columns("summary")
    rows = rows.chosen(np.array([_is_headline(name) for name in rows["metric"]], dtype=bool))
    write_csv(results.target / "sweep.csv", list(rows), rows.tuples(rows))


class Best(NamedTuple):
    """A filter's best values in a scenario, and how far off others of its values are."""

    filter: str
    point: GridPoint
    """the swept paths of the filter and of the scenario, and their values"""
    metric: str
    value: float
    stderr: float
    ties: list[GridPoint]
    """values without a significant difference from the best"""
    next: GridPoint
    """of the others those that are nearest; empty if there are none"""
    difference: float
    """of the metric's mean there to that at the best, on common runs"""
    difference_stderr: float
    text: str
    """in words"""

    def __str__(self) -> str:
        return self.text


def best_points(results: Results) -> Iterator[Best]:
    """Yield the best values of each filter that is varied, in each scenario."""
    for standing in best_settings(results):
        if (best := standing.best) is None:
            continue
        metric, nearest = standing.metric, standing.nearest
        where = ", ".join(filter(None, [best.name, phrases.heading(standing.scene)]))
        number = with_unit(rounded(*best.overall, 4), metric)
        yield Best(
            filter=best.label,
            point=best.varied | standing.scene,
            metric=f"mean({metric})",
            value=best.overall.value,
            stderr=best.overall.stderr,
            ties=[rival.filter.varied for rival in standing.not_worse],
            next={} if nearest is None else nearest.filter.varied,
            difference=nan if nearest is None else nearest.difference.value,
            difference_stderr=nan if nearest is None else nearest.difference.stderr,
            text=f"{where}: mean {metric_words(metric)} {number}",
        )


def _is_headline(metric: str) -> bool:
    m = measured(metric)
    if m.family[0].over_steps == "rms":
        return m.statistic == "rms"
    return m.family[0].per_component or (m.statistic == "mean" and m.family[0].name != "nees")


def _file_name(path: str) -> str:
    """Write a path as every system takes it: ``KF-assume-motion-q``."""
    return "-".join(re.findall("[A-Za-z0-9]+", single_paths(path)[0].partition(".")[2]))
