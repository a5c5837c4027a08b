"""Rankings of the values that a grid gives each filter, and the best values as records."""

from collections.abc import Iterator
from math import nan
from typing import NamedTuple

from trackbench.report.findings import grid_headings
from trackbench.report.findings.candidates import candidates_of
from trackbench.report.findings.metric_phrases import metric_words, with_unit
from trackbench.report.findings.ranking import Ranking, ranking_of
from trackbench.report.findings.ranking_metrics import leading_metric
from trackbench.report.mean_or_rms_of_metric import compared_statistic
from trackbench.report.points_by_scenario import points_of, scenes
from trackbench.report.rounded_numbers import rounded
from trackbench.report.tables_and_figures import Results
from trackbench.results.points_json import GridPoint


def best_settings(results: Results) -> list[Ranking]:
    """Rank the values that the grid gives each filter: a ranking for each filter in each scenario.

    Metric and statistic are those by which `rankings` ranks the filters. Filters with a single set of
    values are left out.
    """
    metric = leading_metric(results)
    if not metric:
        return []
    statistic = compared_statistic(results.config, metric)
    ranked_filters = []
    for scene in scenes(results):
        points = points_of(results, scene)
        candidates = list(candidates_of(results, points, metric, statistic))
        for label in dict.fromkeys(c.label for c in candidates if c.varied):
            settings = [c for c in candidates if c.label == label]
            if len(settings) > 1:
                ranking = ranking_of(settings, metric, ranks_settings=True)
                ranked_filters.append(ranking._replace(scene=scene))
    return ranked_filters


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
        where = grid_headings.join_heading(best.name, grid_headings.heading(ranking.scene))
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
