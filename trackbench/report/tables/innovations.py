"""Table kind `innovations`: what can be said of a filter without a truth."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from trackbench.evaluation.intervals import anees_band
from trackbench.keys import Digits
from trackbench.registry import register
from trackbench.report.expressions import Expressions
from trackbench.report.kinds import TableKind
from trackbench.report.results import Results
from trackbench.report.table import Cell, Table
from trackbench.report.terms import MISSING, Term

_COLUMNS = {
    "ANIS": "mean(anis)",
    "Autocorrelation": "mean(autocorrelation_1)",
    "Log score": "mean(log_score)",
    "Held-out log score": "mean(held_log_score)",
}
_ERRORS = {"Prediction": "predicted", "Held-out": "held"}


@register("tables", "innovations")
@dataclass(frozen=True, kw_only=True)
class Innovations(TableKind):
    """Consistency, whiteness, log score and one-step prediction errors; of recordings, all there is.

    ANIS is the normalised innovation squared over the number of measured components, 1 if consistent;
    of N components it is chi-square of N degrees of freedom over N. The autocorrelation of successive
    whitened innovations is 0 within 1.96 / sqrt(N) (Bar-Shalom, Li & Kirubarajan 2001, section 5.4.2).
    The log score is the mean log p(z_k | z_1..k-1): higher is better. What is held out (`hold_out`) is
    predicted and not filtered.
    """

    needs: ClassVar[dict[str, str]] = {
        "anis": "per_run",
        "innovations": "per_run",
        "autocorrelation_1": "per_run",
        "log_score": "per_run",
    }

    filters: tuple[str, ...] | None = None
    """labels of the rows; default: all"""
    digits: Digits = 4
    """significant digits of the values"""

    def table(self, results: Results) -> Table:
        """The table from a results folder; columns that no filter has are left out."""
        found = {
            tuple(point.items()): Expressions(results, point).stored for point in results.points()
        }
        there = {metric for cells in found.values() for _, metric in cells}
        columns = {h: m for h, m in _COLUMNS.items() if m in there} | _errors(results)
        table = Table(self.title, [*results.grid_heads, "Filter"], list(columns), self.digits)
        for point, cells in found.items():
            for label in results.chosen(self.filters):
                row = [Cell.of(cells.get((label, m), MISSING)) for m in columns.values()]
                table.add([*(str(v) for _, v in point), label], row)
        table.notes += _bands(found)
        return table


def _errors(results: Results) -> dict[str, str]:
    """Heading and metric of a column for each component of the measurement."""
    found = {}
    for head, kind in _ERRORS.items():
        for name in dict.fromkeys(results.columns("summary")["metric"]):
            component = name.removeprefix(f"rms(rmse_{kind}_").removesuffix(")")
            if name == f"rms(rmse_{kind}_{component})" and "[" not in component:
                found[f"{head} error, {component}"] = name
    return found


def _bands(found: dict[Any, dict[tuple[str, str], Term]]) -> list[str]:
    """What a consistent filter's numbers lie between, of the largest number of components."""
    numbers = [
        term.value * term.runs
        for terms in found.values()
        for (_, metric), term in terms.items()
        if metric == "mean(innovations)" and term.runs
    ]
    if not numbers:
        return []
    number = round(max(numbers))
    if not number:
        return ["Nothing was measured after the start: nothing can be said of a filter."]
    low, high = anees_band(1, number)
    return [
        f"95 % bands of a consistent filter over {number} measured components: ANIS {low:.3f} to "
        f"{high:.3f}, autocorrelation within {1.96 / np.sqrt(number):.3f}."
    ]
