"""Rank histograms from a results folder, and what a key may name that asks for them."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from trackbench.config.experiment import Point
from trackbench.core.arrays import Array
from trackbench.evaluation.consistency_and_calibration import bars
from trackbench.evaluation.inference import holm
from trackbench.evaluation.metric_expression import Measure
from trackbench.evaluation.uniformity_tests import Histogram, at_step, over_steps
from trackbench.field_types import InvalidKeyError
from trackbench.report.results import Results
from trackbench.results.point_facts import GridPoint


def check_rank(m: Measure, *path: str) -> None:
    """Raise InvalidKeyError at what is no PIT, at one step or over all of a window."""
    if m.family[0].name != "pit" or m.statistic or m.is_many or m.relation:
        raise InvalidKeyError(f"{str(m)!r} is no PIT, such as pit_nees or pit_px@20", *path)


def steps_that_are_not(
    key: str, measures: Iterable[Measure], points: Sequence[Point]
) -> dict[str, str]:
    """Return conflicts of a measures key with a step outside a point's run."""
    for m in measures:
        for steps in (point.scenario.steps for point in points):
            if m.step is not None and m.step not in steps:
                return {key: f"{m}: the steps are {steps[0]} to {steps[-1]}"}
    return {}


def pits(results: Results, point: GridPoint, label: str, m: Measure) -> Array:
    """Return the values (M,) of a PIT at a step; none if the filter has none."""
    return results.runs(point).get((label, str(m)), np.empty(0))


def shares_of_runs(results: Results, point: GridPoint, label: str, m: Measure) -> Array:
    """Share of each run's steps in each tenth (TENTHS, M) of a PIT; no runs if the filter has none."""
    runs = results.runs(point)
    names = [m._replace(metric=bar).name for bar in bars(m.family[1])]
    return np.stack([runs.get((label, name), np.empty(0)) for name in names])


def histogram(results: Results, point: GridPoint, label: str, m: Measure) -> Histogram:
    """Return the histogram of a PIT at a step, or over each run's steps; empty without the PIT."""
    if m.steps:
        return at_step(pits(results, point, label, m))
    return over_steps(shares_of_runs(results, point, label, m))


class Uniformity(NamedTuple):
    """Filters with the PITs of theirs that are not uniform; others; how many tests there were."""

    bad: dict[str, list[str]]
    good: list[str]
    tests: int


def judged(found: Iterable[tuple[str, str, Histogram]], alpha: float) -> Uniformity:
    """Test the histograms of (filter, PIT) with family-wise error alpha (Holm 1979)."""
    tests = [
        (label, head, p) for label, head, h in found for p in (h.p_distance, h.p) if np.isfinite(p)
    ]
    bad: dict[str, list[str]] = {}
    for (label, head, _), p in zip(tests, holm(np.array([p for _, _, p in tests])), strict=True):
        if p < alpha and head not in bad.setdefault(label, []):
            bad[label].append(head)
    good = [label for label, _, _ in tests if label not in bad]
    return Uniformity(bad, list(dict.fromkeys(good)), len(tests))
