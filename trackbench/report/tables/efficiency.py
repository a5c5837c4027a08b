"""Table kind `efficiency`: how near filters come to the exact posterior mean, and what that saves."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from trackbench.evaluation.efficiency import (
    Jackknifed,
    cross_share,
    efficiency,
    plain_efficiency,
    runs_saved,
)
from trackbench.evaluation.measure import Expression, measure
from trackbench.keys import Digits
from trackbench.registry import register
from trackbench.report import wording
from trackbench.report.costs import shown
from trackbench.report.expressions import Expressions
from trackbench.report.grids import named_form, points_of, scenes
from trackbench.report.kinds import TableKind
from trackbench.report.results import Results
from trackbench.report.table import Cell, Table

_NOT_ZERO = 4.0
"""Standard errors from which a cross term is not chance among some dozens."""
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
        """It is about nothing else."""
        return {} if self.metric.is_efficiency else {"metric": f"'{self.metric}' is no efficiency"}

    def table(self, results: Results) -> Table:
        """The table from a results folder."""
        heads = ["Efficiency", "Without control variate", "Runs saved", "Cross term / MSE"]
        every, labels = scenes(results), shown(results, self.filters)
        table = Table(self.title, [*map(wording.axis, every[0]), "Filter"], heads, self.digits)
        for scene in every:
            for label in labels:
                for name, point in _forms(results, scene, label):
                    cells = self._cells(Expressions(results, point), label)
                    keys = [*map(wording.number, scene.values()), name]
                    table.add(keys, cells)
                    if abs(cells[-1].estimate.value) > _NOT_ZERO * cells[-1].estimate.stderr:
                        table.notes.append(f"{' '.join(keys)}: {_NOT_EXACT}.")
        return table

    def _cells(self, expressions: Expressions, label: str) -> list[Cell]:
        m = self.metric.of(label)
        floor, distance = expressions.beside_reference(m)
        error = expressions.runs.get((label, str(m.made_of()[0])))
        if floor is None or distance is None or error is None:
            return [Cell.missing()] * 4
        runs = np.stack([floor, distance, error])
        floor, distance, error = runs[:, ~np.isnan(runs).any(axis=0)]
        lost = runs.shape[1] - len(floor)
        with_, without = efficiency(floor, distance), plain_efficiency(floor, error)
        cross = cross_share(floor, error, distance)
        found = (with_, without, runs_saved(without, with_), cross)
        return [_cell(part, len(floor), lost) for part in found]


def _forms(
    results: Results, scene: dict[str, Any], label: str
) -> Iterator[tuple[str, dict[str, Any]]]:
    """The filter with each set of keys that it has there, named by what varies, and the first point."""
    found: list[dict[str, Any]] = []
    points = []
    for point in points_of(results, scene):
        keys = results.given(point).filters.get(label)
        if keys is not None and keys not in found:
            found.append(keys)
            points.append(point)
    yield from zip((named_form(label, keys, found) for keys in found), points, strict=True)


def _cell(found: Jackknifed, runs: int, lost: int) -> Cell:
    return Cell(found.estimate, runs, lost) if runs else Cell.missing()
