"""Rank histograms over points and filters, and the table kind `calibration`: are ranks uniform?"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from trackbench.config.experiment import Point
from trackbench.core.arrays import Array
from trackbench.evaluation.calibration import bars
from trackbench.evaluation.metric_expression import Measure, OfRank
from trackbench.evaluation.uniformity_tests import Histogram, at_step, over_steps
from trackbench.field_types import Digits, InvalidKeyError, OpenShare
from trackbench.registry import register
from trackbench.report.findings.phrases import joined
from trackbench.report.kinds import TableKind
from trackbench.report.table import Cell, Table
from trackbench.report.tables_and_figures import Results
from trackbench.results.points_json import GridPoint
from trackbench.statistics.holm_correction import holm
from trackbench.statistics.sample_statistics import Estimate


def check_rank(m: Measure, *path: str) -> None:
    """Raise InvalidKeyError unless a measure is a PIT, at one step or over all steps of a window.

    ``path`` are the keys of the config that lead to the measure.
    """
    if m.definition.name != "pit" or m.statistic or m.is_many or m.relation:
        raise InvalidKeyError(f"{str(m)!r} is no PIT, such as pit_nees or pit_px@20", *path)


def missing_steps(key: str, measures: Iterable[Measure], points: Sequence[Point]) -> dict[str, str]:
    """Return the mistake of the config's ``key`` if one of its measures is at a step outside the run.

    The mapping has the message under this key. It is empty without a mistake. Runs may have other steps
    at each of the grid's ``points``.
    """
    for m in measures:
        for point in points:
            steps = point.scenario.steps
            if m.step is not None and m.step not in steps:
                return {key: f"{m}: the steps are {steps[0]} to {steps[-1]}"}
    return {}


def pits(results: Results, point: GridPoint, label: str, m: Measure) -> Array:
    """Return the values (M,) of a PIT at a step in each run; empty if the filter does not have it."""
    return results.runs(point).get((label, str(m)), np.empty(0))


def shares_of_runs(results: Results, point: GridPoint, label: str, m: Measure) -> Array:
    """Return the share of each run's steps in each tenth of a PIT (TENTHS, M).

    ``m`` is the measure of the PIT, such as ``pit_px``. The result is (TENTHS, 0) if the filter
    ``label`` does not have it.
    """
    runs = results.runs(point)
    names = [m._replace(metric=bar).name for bar in bars(m.quantity)]
    return np.stack([runs.get((label, name), np.empty(0)) for name in names])


def histogram(results: Results, point: GridPoint, label: str, m: Measure) -> Histogram:
    """Return the rank histogram of a PIT at a step, or over each run's steps, with its tests.

    ``m`` is the measure of the PIT, such as ``pit_px@20``. Without a step, the histogram is over the
    steps of each run. It has no runs if the filter ``label`` does not have the PIT.
    """
    if m.steps:
        return at_step(pits(results, point, label, m))
    return over_steps(shares_of_runs(results, point, label, m))


class Uniformity(NamedTuple):
    """Which filters have PITs that are not uniform, by a family of tests."""

    bad: dict[str, list[str]]
    """PITs that are not uniform, by filter"""
    good: list[str]
    """filters with no such PIT"""
    tests: int
    """number of tests"""


def judge_histograms(histograms: Iterable[tuple[str, str, Histogram]], alpha: float) -> Uniformity:
    """Test whether histograms are uniform, with family-wise error ``alpha`` (Holm 1979).

    Each of ``histograms`` comes after the filter's label and the heading of its PIT. In the result
    ``bad`` has the headings of the PITs that are not uniform, by label; ``good`` are the other labels.
    """
    tests = []
    p_values = []
    for label, head, ranks in histograms:
        # Two tests of each histogram; p is NaN where a test has too few runs.
        for p in (ranks.p_distance, ranks.p):
            if np.isfinite(p):
                tests.append((label, head))
                p_values.append(p)
    bad: dict[str, list[str]] = {}
    for (label, head), p in zip(tests, holm(np.array(p_values)), strict=True):
        if p < alpha and head not in bad.setdefault(label, []):
            bad[label].append(head)
    good = [label for label, _ in tests if label not in bad]
    return Uniformity(bad=bad, good=list(dict.fromkeys(good)), tests=len(tests))


_HEADS = ["Distance", "p of the distance", "p of the histogram"]


@register("tables", "calibration")
@dataclass(frozen=True, kw_only=True)
class CalibrationTable(TableKind):
    """Kolmogorov's distance of each PIT from the uniform distribution, and tests of it.

    At a step (`pit_px@20`) the runs are independent: Kolmogorov's test, and Pearson's of the histogram
    in tenths. Over all steps (`pit_px`) each run has its share of steps in each tenth: Hotelling's T^2.
    Talts et al. 2018; Gneiting, Balabdaoui & Raftery 2007.
    """

    rows: dict[str, OfRank]
    """what it is called: pit_nees (the whole state), pit_<component>; with @20 or @last at a step"""
    filters: tuple[str, ...] | None = None
    """labels of the rows; default: all"""
    alpha: OpenShare = 0.01
    """probability that a calibrated filter is said not to be, anywhere in the table"""
    digits: Digits = 3
    """significant digits of the values"""

    def __post_init__(self) -> None:
        for head, m in self.rows.items():
            check_rank(m, "rows", head)

    def conflicts(self, points: Sequence[Point]) -> dict[str, str]:
        """Reject steps outside the run."""
        return missing_steps("rows", self.rows.values(), points)

    def table(self, results: Results) -> Table:
        """Fill a row for each filter and PIT; a note judges all histograms together."""
        heads = [*results.grid_heads, "Filter", "PIT"]
        table = Table(self.title, heads, _HEADS, self.digits)
        # Each histogram with the point and filter in words, and the heading of the PIT.
        histograms: list[tuple[str, str, Histogram]] = []
        for point in results.points():
            for label in results.chosen(self.filters):
                keys = [*map(str, point.values()), label]
                for head, m in self.rows.items():
                    ranks = histogram(results, point, label, m)
                    cells = []
                    # Kolmogorov's distance from a uniform distribution, and the p-values of both tests.
                    for number in (ranks.distance, ranks.p_distance, ranks.p):
                        cells.append(Cell(Estimate(number, np.nan), runs=ranks.runs, lost=0))
                    table.add([*keys, head], cells)
                    histograms.append((", ".join(keys), head, ranks))
        table.notes += _verdict(judge_histograms(histograms, self.alpha), self.alpha)
        return table


def _verdict(uniformity: Uniformity, alpha: float) -> Iterator[str]:
    """Yield a sentence on the filters that are not calibrated, and one on those that may be.

    ``uniformity`` has the outcome of tests at the family-wise error ``alpha``.
    """
    rule = f"by {uniformity.tests} tests, {alpha:g} for all of them (Holm)"
    if uniformity.bad:
        words = "; ".join(f"{label} in {joined(heads)}" for label, heads in uniformity.bad.items())
        yield f"Not calibrated {rule}: {words}."
    if uniformity.good:
        yield f"Not seen to be otherwise than calibrated {rule}: {', '.join(uniformity.good)}."
