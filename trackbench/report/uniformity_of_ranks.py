"""Rank histograms of PITs at the points of a grid, and tests of whether they are uniform."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.evaluation.calibration_series import bars
from trackbench.evaluation.metric_expression import Measure
from trackbench.evaluation.uniformity_tests import Histogram, at_step, over_steps
from trackbench.field_types import InvalidKeyError
from trackbench.report.tables_and_figures import Results
from trackbench.results.points_json import GridPoint
from trackbench.statistics.holm_correction import holm


def check_rank(m: Measure, *path: str) -> None:
    """Raise InvalidKeyError unless a measure is a PIT, at one step or over all steps of a window.

    ``path`` are the keys of the config that lead to the measure.
    """
    if m.definition.name != "pit" or m.statistic or m.is_many or m.relation:
        raise InvalidKeyError(f"{str(m)!r} is no PIT, such as pit_nees or pit_px@20", *path)


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
    """number of tests, two of each histogram with enough runs"""


def judge_histograms(histograms: Iterable[tuple[str, str, Histogram]], alpha: float) -> Uniformity:
    """Test whether histograms are uniform, with family-wise error ``alpha`` (Holm 1979).

    Each of ``histograms`` comes after the filter's label and the heading of its PIT. In the result
    ``bad`` has the headings of the PITs that are not uniform, by label; ``good`` are the other labels.
    """
    tests = []
    p_values = []
    for label, head, ranks in histograms:
        # Two tests of each histogram: of Kolmogorov's distance of the ranks from uniform ones, and of
        # the shares in tenths. p is NaN where a test has too few runs.
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
