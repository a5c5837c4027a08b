"""Table kind `claims`: where on a grid one filter beats another, by how much, and where it does not."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from trackbench.evaluation.statistics import z_score
from trackbench.registry import register
from trackbench.report import style
from trackbench.report.results import Results
from trackbench.report.table import Cell, Table
from trackbench.report.verdicts import SURE


@dataclass(frozen=True, kw_only=True)
class Claim:
    """That one filter's metric is less than another's."""

    label_keys: ClassVar[tuple[str, ...]] = ("less", "than")

    less: str
    """label of the filter said to be better"""
    than: str
    """label of the filter said to be worse"""
    metric: str
    """metric of per_run.csv, smaller is better"""


@register("tables", "claims")
@dataclass(frozen=True, kw_only=True)
class Claims:
    """A row per claim, a column per value of the grid: paired difference, negative where it holds.

    A claim holds, or fails, beyond three standard errors of the paired difference; between them it is
    undecided. The notes give the values at which each is the case.
    """

    asks: ClassVar[dict[str, str]] = {"claims": "per_run"}
    label_keys: ClassVar[tuple[str, ...]] = ("claims",)

    title: str = ""
    """caption"""
    claims: dict[str, Claim]
    """claims by their words"""
    digits: int = 3
    """significant digits of the values"""

    def table(self, results: Results) -> Table:
        """The table from a results folder."""
        points = results.points()
        names = [", ".join(map(style.number, point.values())) or "all runs" for point in points]
        table = Table(self.title, ["Claim"], names, self.digits)
        runs = [results.runs(point) for point in points]
        for words, claim in self.claims.items():
            better, worse = ((label, claim.metric) for label in (claim.less, claim.than))
            cells = [Cell.difference(found.get(better), found.get(worse)) for found in runs]
            table.add([words], cells)
            table.notes.append(f"{words}: {_ranges(names, cells)}.")
        return table


def _ranges(names: list[str], cells: list[Cell]) -> str:
    """``holds at 0, 0.1; undecided at 1; fails at 10``."""
    found: dict[str, list[str]] = {"holds": [], "undecided": [], "fails": []}
    for name, cell in zip(names, cells, strict=True):
        z = z_score(cell.estimate) if cell.runs else np.nan
        found["holds" if z <= -SURE else "fails" if z >= SURE else "undecided"].append(name)
    return "; ".join(f"{verdict} at {', '.join(at)}" for verdict, at in found.items() if at)
