"""Files of a sweep: one tidy table, a figure per filter, the best values in words."""

from collections.abc import Iterator
from dataclasses import replace
from math import nan
from typing import NamedTuple

import numpy as np

from trackbench.config.added_tables_and_figures import free_name
from trackbench.config.experiment import Experiment
from trackbench.config.grid import independent_filter_paths
from trackbench.config.published_numbers_and_claims import Published
from trackbench.csv_writer import write_csv
from trackbench.evaluation.metric_expression import measured
from trackbench.report.figures.sweep import figures_of_sweep
from trackbench.report.findings import grid_phrases
from trackbench.report.findings.metric_phrases import metric_words, with_unit
from trackbench.report.findings.ranking import best_settings
from trackbench.report.rounded_numbers import rounded
from trackbench.report.tables.best_settings import BestSettings
from trackbench.report.tables_and_figures import Results
from trackbench.results.points_json import GridPoint

_TABLE = "best-settings"


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


def write_sweep(results: Results) -> None:
    """Write ``sweep.csv``: one statistic of each metric, rms of errors, ANEES, mean of the rest."""
    summary = results.columns("summary")
    is_shown = np.array([_is_headline(name) for name in summary["metric"]], dtype=bool)
    rows = summary.chosen(is_shown)
    # Iterated over, `Columns` yields the names of its columns.
    write_csv(results.target / "sweep.csv", list(rows), rows.tuples(rows))


class Best(NamedTuple):
    """A filter's best values in a scenario, and how far off others of its values are."""

    filter: str
    point: GridPoint
    """the swept paths of the filter and of the scenario, and their values"""
    metric: str
    """the number that ranks the filters, as ``rms(rmse_position)``"""
    value: float
    stderr: float
    ties: list[GridPoint]
    """values without a significant difference from the best, also those that are not tested"""
    next: GridPoint
    """of the significantly worse values those that are nearest to the best; empty if there are none"""
    difference: float
    """metric at ``next`` minus that at the best, on common runs"""
    difference_stderr: float
    text: str
    """in words"""

    def __str__(self) -> str:
        return self.text


def best_points(results: Results) -> Iterator[Best]:
    """Yield the best values of each filter that the grid varies, in each scenario of the grid."""
    for ranking in best_settings(results):
        best = ranking.best
        if best is None:
            continue
        metric = ranking.metric
        statistic = best.sample.statistic
        words = metric_words(metric)
        if statistic == "mean":
            words = f"mean {words}"
        # The significantly worse candidate whose number is nearest to the best; None if none is worse.
        # All others, in ``not_worse``, have no significant difference from the best or are untested.
        nearest = ranking.nearest
        where = ", ".join(filter(None, [best.name, grid_phrases.heading(ranking.scene)]))
        number = with_unit(rounded(*best.overall, 4), metric)
        yield Best(
            filter=best.label,
            point=best.varied | ranking.scene,
            metric=f"{statistic}({metric})",
            value=best.overall.value,
            stderr=best.overall.stderr,
            ties=[rival.filter.varied for rival in ranking.not_worse],
            next={} if nearest is None else nearest.filter.varied,
            difference=nan if nearest is None else nearest.difference.value,
            difference_stderr=nan if nearest is None else nearest.difference.stderr,
            text=f"{where}: {words} {number}",
        )


def _is_headline(metric: str) -> bool:
    """Test whether a row of summary.csv is in sweep.csv, by the name of its metric.

    Each metric has one row there: rms of an RMSE, the ANEES in place of the NEES, mean of any other.
    """
    m = measured(metric)
    definition = m.definition
    if definition.over_steps == "rms":  # an RMSE, or an RMS difference from the reference
        return m.statistic == "rms"
    # A metric per component, as the ANEES, has a single row, whose name has no statistic.
    return definition.per_component or (m.statistic == "mean" and definition.name != "nees")
