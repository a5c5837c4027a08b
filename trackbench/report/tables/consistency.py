"""Table kind `consistency`: does a filter's covariance tell the truth about its errors?"""

from dataclasses import dataclass

import numpy as np

from trackbench.core.arrays import Array
from trackbench.evaluation.statistics import Estimate
from trackbench.registry import register
from trackbench.report.results import Results
from trackbench.report.table import Cell, Table


@register("tables", "consistency")
@dataclass(frozen=True, kw_only=True)
class Consistency:
    """Normalised errors and innovations over the runs at each step, and their chi-square bands.

    ANEES is NEES / n_x and ANIS is NIS / n_z: 1 if consistent. Averaged over M runs at one step they are
    chi-square of M n degrees of freedom over M n; a consistent filter stays in the 95 % band in 95 % of
    the steps (Bar-Shalom, Li & Kirubarajan 2001, section 5.4.3).
    """

    title: str = ""
    """caption"""
    filters: tuple[str, ...] | None = None
    """labels of the rows; default: all"""
    digits: int = 3
    """significant digits of the values"""

    def table(self, results: Results) -> Table:
        """The table from a results folder."""
        labels = [b for b in results.labels if self.filters is None or b in self.filters]
        model = results.scenario.model
        sizes = {"anees": len(model.motion.components), "nis": len(model.sensor.components)}
        heads = [
            "ANEES, median step",
            "steps in its band",
            "ANIS, median step",
            "steps in its band ",
        ]
        table = Table(self.title, [*results.grid_heads, "Filter"], heads, self.digits)
        for point in results.points():
            frame = results.at(results.per_step, point)
            for label in labels:
                rows = frame[frame["filter"] == label]
                cells = []
                for metric, n in sizes.items():
                    chosen = rows[rows["metric"] == metric]
                    value = chosen["value"].to_numpy(dtype=float)
                    runs = chosen["runs"].to_numpy(dtype=float)
                    cells += _cells(value if metric == "anees" else value / n, n * runs)
                table.add([*(str(v) for v in point.values()), label], cells)
        runs = int(results.config["runs"])
        for name, n in (("ANEES", sizes["anees"]), ("ANIS", sizes["nis"])):
            low, high = band(np.array([float(n * runs)]))
            table.notes.append(
                f"95 % band of {name} over {runs} runs: {low[0]:.3f} to {high[0]:.3f}."
            )
        return table


def band(degrees: Array) -> tuple[Array, Array]:
    """2.5 % and 97.5 % points of chi-square over its degrees of freedom."""
    from scipy.special import gammaincinv

    low, high = (2.0 * gammaincinv(degrees / 2.0, p) / degrees for p in (0.025, 0.975))
    return low, high


def _cells(value: Array, degrees: Array) -> list[Cell]:
    if not len(value):
        return [Cell.missing(), Cell.missing()]
    low, high = band(degrees)
    inside = float(((value >= low) & (value <= high)).mean())
    # Steps depend on each other, so no standard error is claimed.
    return [
        Cell(Estimate(float(np.median(value)), float("nan")), len(value), 0),
        Cell(Estimate(inside, float("nan")), len(value), 0),
    ]
