"""Table kind `consistency`: does a filter's covariance tell the truth about its errors?"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from trackbench.core.arrays import Array
from trackbench.errors import counted
from trackbench.evaluation.inference import anees_band
from trackbench.evaluation.statistics import Estimate
from trackbench.field_types import Digits
from trackbench.registry import register
from trackbench.report.kinds import TableKind
from trackbench.report.results import Results
from trackbench.report.table import Cell, Table


@register("tables", "consistency")
@dataclass(frozen=True, kw_only=True)
class Consistency(TableKind):
    """Normalised errors and innovations over the runs at each step, and their chi-square bands.

    ANEES is NEES / n_x and ANIS is NIS / n_z: 1 if consistent. Averaged over M runs at one step they are
    chi-square of M n degrees of freedom over M n; a consistent filter stays in the 95 % band in 95 % of
    the steps (Bar-Shalom, Li & Kirubarajan 2001, section 5.4.3).
    """

    requires: ClassVar[dict[str, str]] = {"anees": "per_step", "nis": "per_step"}

    filters: tuple[str, ...] | None = None
    """labels of the rows; default: all"""
    digits: Digits = 3
    """significant digits of the values"""

    def table(self, results: Results) -> Table:
        """Return the table from a results folder."""
        labels = results.chosen(self.filters)
        heads = [
            "ANEES, median step",
            "steps in its band",
            "ANIS, median step",
            "steps in its band ",
        ]
        table = Table(self.title, [*results.grid_heads, "Filter"], heads, self.digits)
        every: dict[str, dict[int, None]] = {"ANEES": {}, "ANIS": {}}
        for point in results.points():
            given = results.facts(point)
            sizes = {"anees": len(given.components), "nis": len(given.measured)}
            for name, n in zip(every, sizes.values(), strict=True):
                every[name][n] = None
            frame = results.columns("per_step", point)
            for label in labels:
                rows = frame.where(filter=label)
                cells = []
                for metric, n in sizes.items():
                    chosen = rows.where(metric=metric)
                    # ANEES is stored per component, NIS is not.
                    value = chosen["value"] if metric == "anees" else chosen["value"] / n
                    cells += _cells(value, n, chosen["runs"])
                table.add([*(str(v) for v in point.values()), label], cells)
        # Notes: the band for each number of components.
        runs = int(results.config["runs"])
        for name, n in ((name, n) for name, found in every.items() for n in found):
            low, high = anees_band(n, runs)
            of = f" of {n} components" if len(every[name]) > 1 else ""
            band = f"{low:.3f} to {high:.3f}"
            table.notes.append(f"95 % band of {name}{of} over {counted(runs, 'run')}: {band}.")
        return table


def _cells(value: Array, n: int, runs: Array) -> list[Cell]:
    """Return the median over the steps, and the share of steps inside their bands."""
    if not len(value):
        return [Cell.missing(), Cell.missing()]
    # A band for each number of runs that are left at a step.
    bands = {m: anees_band(n, m) for m in set(runs.tolist())}
    low, high = np.array([bands[m] for m in runs.tolist()]).T
    inside = float(((value >= low) & (value <= high)).mean())
    # Steps depend on each other, so no standard error is claimed.
    return [Cell(Estimate(x, np.nan), len(value), 0) for x in (float(np.median(value)), inside)]
