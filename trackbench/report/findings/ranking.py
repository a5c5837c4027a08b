"""Rankings: the best filter, those without a significant difference from it, those that lose more runs.

Decided by the statistic of the first table's column, such as rms(rmse_position): its differences on
common runs, by the rule of the verdicts. A filter that loses significantly more runs than another is
never the best.
"""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from math import isfinite
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.evaluation.metric_expression import Measure, measured
from trackbench.report.findings import phrases
from trackbench.report.findings.phrases import named
from trackbench.report.paired import difference_of, primary_metrics
from trackbench.report.results import Results, own_values, points_of, scenes
from trackbench.results.folder_contents import TRACK
from trackbench.results.point_facts import GridPoint
from trackbench.statistics.estimates import MISSING, OfSteps, RunEstimate
from trackbench.statistics.intervals import loses_more
from trackbench.statistics.over_runs import STATISTICS, Estimate
from trackbench.statistics.rules import difference_sign


@dataclass(frozen=True, eq=False)
class Candidate:
    """A filter with the values that the grid gives it, and the point at which it has them."""

    label: str
    point: GridPoint
    lost: Array
    """why each run (M,) is lost, 0 if it is not"""
    values: Array
    """the metric of each run (M,), NaN where it is lost"""
    own: GridPoint = field(default_factory=dict)
    """what the grid gives the filter, by path"""
    statistic: str = "mean"
    """over the runs: mean or rms"""
    steps: OfSteps | None = None
    """the metric of the only run with its steps, if that is a recording"""

    @cached_property
    def name(self) -> str:
        """Return the name for a sentence, with the grid's values."""
        return f"{named(self.label)} at {self.setting}" if self.own else named(self.label)

    @property
    def setting(self) -> str:
        """Return the grid's values; several in parentheses."""
        text = phrases.heading(self.own)
        return f"({text})" if len(self.own) > 1 else text

    @cached_property
    def overall(self) -> Estimate:
        """Return the statistic over the runs that are not lost."""
        return STATISTICS[self.statistic](self.values[np.isfinite(self.values)])

    def minus(self, other: "Candidate") -> RunEstimate:
        """Return the difference of the statistic over common runs, or steps of a recording."""
        if self.steps is not None and other.steps is not None:
            return self.steps.minus(other.steps)
        a, b = self.common_runs(other)
        return difference_of(self.statistic, a, b) if len(a) else MISSING

    @cached_property
    def losses(self) -> int:
        """Number of runs that are lost."""
        return int(np.count_nonzero(self.lost))

    def common_runs(self, other: "Candidate") -> tuple[Array, Array]:
        """Return the values of both on the runs that neither loses."""
        both = np.isfinite(self.values) & np.isfinite(other.values)
        return self.values[both], other.values[both]


class Ranking(NamedTuple):
    """Ranking of one scenario's filters by one metric: the best, and what differs from it."""

    scene: GridPoint
    """what the grid gives the scenario"""
    metric: Measure
    best: Candidate | None
    """nothing where none can be said: without two runs, or where common runs contradict it"""
    ties: list[tuple[Candidate, RunEstimate]]
    """filters without a significant difference from the best; each with its difference"""
    worse: list[tuple[Candidate, RunEstimate]]
    losing: list[Candidate]
    """filters that lose more runs than another does"""
    reference: Candidate | None
    order: list[Candidate]
    """every filter that has a mean and is not among those losing more runs, the best mean first"""
    chosen: bool
    """whether a filter is there with the best of several values that the grid gives it"""
    runs: int
    batches: int = 1
    """of runs, each of which the rule leaves out"""
    conflict: tuple[Candidate, Candidate] | None = None
    """the filter that leads over its runs, and the one whose common runs with it contradict that"""

    @property
    def among_the_best(self) -> list[Candidate]:
        """Return the best, and those without a significant difference from it."""
        return [self.best, *(c for c, _ in self.ties)] if self.best is not None else []

    @property
    def nearest(self) -> tuple[Candidate, RunEstimate] | None:
        """Return the filter nearest to the best among those that are worse."""
        return min(self.worse, key=lambda item: abs(item[1].value), default=None)

    @property
    def more_is_better(self) -> bool:
        """Return whether the larger value is the better one."""
        return self.metric.family[0].more_is_better


def rankings(
    results: Results, metric: str = "", labels: Collection[str] | None = None
) -> list[Ranking]:
    """Return a ranking for each scenario of the grid, by the first table's or a given metric.

    ``labels`` are those of the ranked filters; by default all.
    """
    metric, statistic = _ranked_by(results, metric)
    found, labels = [], results.filters if labels is None else labels
    for where in scenes(results) if metric else []:
        every = _settings(results, points_of(results, where), metric, statistic)
        settings = [candidate for candidate in every if candidate.label in labels]
        reference, batches = results.config.get("reference"), results.batches
        found.append(ranking_of(settings, metric, reference, batches)._replace(scene=where))
    return found


def _ranked_by(results: Results, metric: str) -> tuple[str, str]:
    """Return the metric that decides, and its statistic: those of the first column that shows it."""
    known = ranking_metrics(results)
    tables = results.config.get("tables") or {}
    specs = [spec for spec in tables.values() if spec.get("kind") == "metrics"]
    for m in (measured(text) for spec in specs for text in spec["columns"].values()):
        whole = not (m.window or m.steps or m.relation) and m.statistic in ("mean", "rms")
        if whole and m.metric in known and metric in ("", m.metric):
            return m.metric, m.statistic
    # A config without tables, and figures but the default track, has a default table of rms errors.
    name = metric or next(iter(known), "")
    by_default = not tables and {*(results.config.get("figures") or ())} <= {TRACK}
    return name, "rms" if by_default and name and measured(name).is_error else "mean"


def best_settings(results: Results) -> list[Ranking]:
    """Yield for each varied filter which of its values are best, by scenario."""
    metric = next(iter(ranking_metrics(results)), "")
    found = []
    for where in scenes(results) if metric else []:
        settings = list(_settings(results, points_of(results, where), metric))
        for label in dict.fromkeys(c.label for c in settings if c.own):
            # One ranking for each filter with several values.
            mine = [c for c in settings if c.label == label]
            if len(mine) > 1:
                ranking = ranking_of(mine, metric, batches=results.batches, apart=True)
                found.append(ranking._replace(scene=where))
    return found


def ranking_metrics(results: Results) -> list[str]:
    """Return the metrics that filters are ranked by, the first one first."""
    points = results.points()
    names = dict.fromkeys(metric for point in points for _, metric in results.runs(point))
    found = primary_metrics(list(names))
    errors = [name for name in found if measured(name).is_error]
    told = [name for name in ("held_log_score", "log_score") if name in found]
    return [*errors, *told]


def ranking_of(
    settings: Sequence[Candidate],
    metric: str,
    reference: str | None = None,
    batches: int = 1,
    apart: bool = False,
) -> Ranking:
    """Return the ranking of filters, each with its best values, in one scenario.

    ``apart``: of the values themselves.
    """
    measure = measured(metric)
    sign = -1.0 if measure.family[0].more_is_better else 1.0
    # Step 1: set the reference apart; sort the filters, each at its best values.
    floor = next((c for c in settings if c.label == reference), None)
    tried = [c for c in settings if c.label != reference]
    ranked = sorted(tried if apart else _best_of_each(tried, sign), key=lambda c: _rank(c, sign))
    # Step 2: take out filters that lose more runs, and those without a value.
    losing = _losing(ranked)
    rivals = [c for c in ranked if c not in losing and isfinite(c.overall.value)]
    losing += [c for c in ranked if c not in rivals and c not in losing and c.losses]
    chosen, runs = len(tried) > len(ranked), max((len(c.lost) for c in ranked), default=0)
    # Step 3: compare the first of the others with all the rest on common runs.
    found = Ranking({}, measure, None, [], [], losing, floor, rivals, chosen, runs, batches)
    if not rivals or not (isfinite(rivals[0].overall.stderr) or rivals[0].steps is not None):
        return found
    best = rivals[0]
    ties: list[tuple[Candidate, RunEstimate]] = []
    worse: list[tuple[Candidate, RunEstimate]] = []
    for rival in rivals[1:]:
        difference = rival.minus(best)
        side = sign * difference_sign(difference, batches)
        if not difference.runs or side < 0.0:
            # No runs in common; or on these the other is the better one.
            return found._replace(conflict=(best, rival))
        (worse if side > 0.0 else ties).append((rival, difference))
    return found._replace(best=best, ties=ties, worse=worse)


def _settings(
    results: Results, points: Sequence[GridPoint], metric: str, statistic: str = "mean"
) -> Iterator[Candidate]:
    """Yield each filter with each of the values that the grid gives it, once."""
    for label in results.filters:
        seen = set()
        for point in points:
            runs, own = results.runs(point), own_values(results, point, label)
            # Each set of values counts once, at the first point that has it.
            if str(own) not in seen and (label, "lost") in runs:
                seen.add(str(own))
                lost = runs[label, "lost"]
                values = runs.get((label, metric), np.full(len(lost), np.nan))
                steps = results.judged_steps(point).get((label, metric))
                of_steps = None if steps is None else OfSteps.of(float(values[0]), steps)
                yield Candidate(label, point, lost, values, own, statistic, of_steps)


def _rank(candidate: Candidate, sign: float) -> tuple[bool, float]:
    value = candidate.overall.value
    return not isfinite(value), sign * value if isfinite(value) else 0.0


def _best_of_each(settings: Sequence[Candidate], sign: float) -> list[Candidate]:
    """Return each filter at its best values, of which those with which it loses more runs are none."""
    best = []
    for label in dict.fromkeys(c.label for c in settings):
        mine = [c for c in settings if c.label == label]
        # Values with which a filter loses more runs are out, unless no others are left.
        losing = _losing(mine)
        best.append(min([c for c in mine if c not in losing] or mine, key=lambda c: _rank(c, sign)))
    return best


def _losing(found: Sequence[Candidate]) -> list[Candidate]:
    """Return the filters that lose significantly more of the same runs than another."""
    return [
        a
        for a in found
        if any(
            len(a.lost) == len(b.lost) and loses_more(a.lost, b.lost, len(found))
            for b in found
            if b is not a
        )
    ]
