"""Table kind `efficiency`: error of each filter relative to the exact posterior mean, and its cost."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from trackbench.evaluation.metric_expression import Expression, measure
from trackbench.field_types import Digits
from trackbench.registry import register
from trackbench.report.cost_curves import compared_labels
from trackbench.report.expressions import Evaluator
from trackbench.report.filter_setting_labels import forms_of_filter
from trackbench.report.findings import phrases
from trackbench.report.kinds import TableKind
from trackbench.report.points_by_scenario import scenes
from trackbench.report.table import Cell, Table
from trackbench.report.tables_and_figures import Results
from trackbench.statistics import significance_rules as rules
from trackbench.statistics.efficiency_with_control_variate import (
    cross_share,
    efficiency,
    plain_efficiency,
    runs_saved,
)

_NOT_EXACT = "the cross term is not zero, the reference is no exact mean: take the one without"


@register("tables", "efficiency")
@dataclass(frozen=True, kw_only=True)
class EfficiencyTable(TableKind):
    """The reference's RMSE over each filter's, with the cross term as a control variate and without.

    `Runs saved`: runs that would be needed without it for each with it. `Cross term`: its share of the
    mean square error, which is zero but for noise if the reference is the exact posterior mean.
    """

    metric: Expression = measure("efficiency")
    """which: `efficiency_position`, `efficiency[late]`"""
    filters: tuple[str, ...] | None = None
    """labels of the rows; default: all but the reference"""
    digits: Digits = 4
    """significant digits of the values"""

    def conflicts(self, points: Sequence[Any]) -> dict[str, str]:
        """Reject a metric that is no efficiency."""
        if self.metric.is_efficiency:
            return {}
        return {"metric": f"'{self.metric}' is no efficiency"}

    def table(self, results: Results) -> Table:
        """Fill a row for each form of a filter in each scenario of the grid.

        A form is a filter with one set of the values that the grid gives its keys. The reference is that
        of the config; a note says if it is no exact posterior mean.
        """
        value_heads = ["Efficiency", "Without control variate", "Runs saved", "Cross term / MSE"]
        every_scene = scenes(results)
        labels = compared_labels(results, self.filters)
        key_heads = [*map(results.axis, every_scene[0]), "Filter"]
        table = Table(self.title, key_heads, value_heads, self.digits)
        for scene in every_scene:
            for label in labels:
                for form in forms_of_filter(results, scene, label):
                    cells = self._cells(Evaluator(results, form.point), label)
                    keys = [*map(phrases.number, scene.values()), form.name]
                    table.add(keys, cells)
                    # A cross term beyond chance shows that the reference is no exact posterior mean.
                    cross_term = cells[-1]
                    if rules.is_no_chance(cross_term.estimate, cross_term.runs):
                        table.notes.append(f"{' '.join(keys)}: {_NOT_EXACT}.")
        return table

    def _cells(self, expressions: Evaluator, label: str) -> list[Cell]:
        """Return the cells of a filter: both efficiencies, the runs saved, and the cross term.

        In each run, error^2 = floor^2 + distance^2 + cross term. Here error is the filter's RMSE, floor
        is that of the reference, and distance is the RMS difference of both. If the reference is the
        exact posterior mean, no filter has a smaller error than floor on average, and the mean of the
        cross term is zero. The first efficiency takes floor^2 + distance^2 for error^2, with the cross
        term as a control variate. The second takes error^2 itself.
        """
        m = self.metric.of(label)
        # Each run's RMSE of the reference, RMS difference from the reference, and RMSE.
        rmse, _ = m.made_of()
        floor, distance = expressions.reference_and_rmsd(m)
        error = expressions.runs.get((label, str(rmse)))
        if floor is None or distance is None or error is None:
            return [Cell.missing()] * 4
        # Only runs in which all three numbers exist.
        runs = np.stack([floor, distance, error])
        floor, distance, error = runs[:, ~np.isnan(runs).any(axis=0)]
        if not len(floor):
            return [Cell.missing()] * 4
        controlled = efficiency(floor, distance)
        plain = plain_efficiency(floor, error)
        cross = cross_share(floor, error, distance)
        lost = runs.shape[1] - len(floor)
        cells = []
        for number in (controlled, plain, runs_saved(plain, controlled), cross):
            cells.append(Cell(estimate=number.estimate, runs=len(floor), lost=lost))
        return cells
