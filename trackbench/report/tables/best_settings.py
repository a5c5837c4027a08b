"""Table kind `best-settings`: of the values that a grid gives each filter, the best ones."""

from dataclasses import dataclass

from trackbench.field_types import Digits
from trackbench.registry import register
from trackbench.report.findings import phrases
from trackbench.report.findings.metric_phrases import head_of
from trackbench.report.findings.ranking_of_settings import best_settings
from trackbench.report.kinds import TableKind
from trackbench.report.mean_or_rms_of_metric import compared_statistic
from trackbench.report.table import Cell, Table
from trackbench.report.tables_and_figures import Results

_MOST_TIES = 6
"""Settings without a significant difference that a row names."""


@register("tables", "best-settings")
@dataclass(frozen=True, kw_only=True)
class BestSettings(TableKind):
    """A row per filter that the grid varies: its best values, and those not significantly different.

    By the number that ranks the filters, such as an rms error: paired differences on common runs, by the
    rule for filters. Values with which more runs are lost are not among the best. `Next` is how far off
    the nearest of the others is.
    """

    digits: Digits = 4
    """significant digits of the values"""

    def table(self, results: Results) -> Table:
        """Fill a row for each filter whose keys the grid varies, in each scenario of the grid."""
        rankings = best_settings(results)
        scene_heads: list[str] = []
        value_head = "Mean"
        if rankings:
            scene_heads = [results.axis(path) for path in rankings[0].scene]
            metric = rankings[0].metric
            value_head = head_of(compared_statistic(results.config, metric.metric), metric)
        heads = [*scene_heads, "Filter", "Best at", "No significant difference"]
        title = self.title or "Each filter's best values"
        table = Table(title, heads, [value_head, "Next"], self.digits)
        for ranking in rankings:
            best = ranking.best
            if best is None:
                continue
            ties = [rival.filter.setting for rival in ranking.not_worse]
            ties_text = ", ".join(ties[:_MOST_TIES]) or "none"
            if len(ties) > _MOST_TIES:
                ties_text += f", {len(ties) - _MOST_TIES} more"
            scene_values = map(phrases.number, ranking.scene.values())
            value = Cell(best.overall, runs=len(best.lost) - best.losses, lost=best.losses)
            # Column `Next`: the difference from the best of the nearest values that are worse.
            nearest = ranking.nearest
            next_cell = Cell.missing()
            if nearest is not None:
                difference = nearest.difference
                next_cell = Cell(difference.estimate, runs=difference.runs, lost=0)
            keys = [*scene_values, best.label, best.setting, ties_text]
            table.add(keys, [value, next_cell])
        if not table.keys:
            table.notes.append("No filter has two values to compare.")
        return table
