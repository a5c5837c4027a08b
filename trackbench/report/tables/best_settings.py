"""Table kind `best-settings`: of the values that a grid gives each filter, the best ones."""

from dataclasses import dataclass

from trackbench.field_types import Digits
from trackbench.registry import register
from trackbench.report.findings import phrases
from trackbench.report.findings.phrases import head_of
from trackbench.report.findings.ranking import best_settings
from trackbench.report.kinds import TableKind
from trackbench.report.results import Results
from trackbench.report.table import Cell, Table

_MOST = 6


@register("tables", "best-settings")
@dataclass(frozen=True, kw_only=True)
class BestSettings(TableKind):
    """A row per filter that the grid varies: its best values, and those not significantly different.

    By the first error's mean per run, or the log score: paired differences on common runs, by the rule
    for filters. Values with which more runs are lost are not among the best. `Next` is how far off
    the nearest of the others is.
    """

    digits: Digits = 4
    """significant digits of the values"""

    def table(self, results: Results) -> Table:
        """Fill a row for each filter whose keys the grid varies."""
        rankings = best_settings(results)
        where = [results.axis(path) for path in (rankings[0].scene if rankings else ())]
        heads = [*where, "Filter", "Best at", "No significant difference"]
        value = head_of("mean", rankings[0].metric) if rankings else "Mean"
        title = self.title or "Each filter's best values"
        table = Table(title, heads, [value, "Next"], self.digits)
        for standing in rankings:
            best, nearest = standing.best, standing.nearest
            if best is None:
                continue
            ties = [rival.filter.setting for rival in standing.not_worse]
            more = len(ties) - _MOST
            shown = ", ".join(ties[:_MOST]) + (f", {more} more" if more > 0 else "")
            keys = [*map(phrases.number, standing.scene.values()), best.label, best.setting]
            cell = Cell(best.overall, len(best.lost) - best.losses, best.losses)
            further = Cell.missing()
            if nearest is not None:
                further = Cell(nearest.difference.estimate, nearest.difference.runs, 0)
            table.add([*keys, shown or "none"], [cell, further])
        if not table.keys:
            table.notes.append("No filter has two values to compare.")
        return table
