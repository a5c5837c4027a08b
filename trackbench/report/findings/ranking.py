"""Rankings: the best filter, those without a significant difference from it, those that lose more runs.

Decided by the statistic of the first table's column, such as rms(rmse_position): its differences on
common runs, by the rule for filters. A filter that loses significantly more runs than another is never
the best.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain, takewhile
from math import isfinite
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.evaluation.metric_expression import Measure, measured
from trackbench.report.findings import phrases
from trackbench.report.findings.phrases import named
from trackbench.report.paired import compared_statistic, compared_statistics, primary_metrics
from trackbench.report.results import Results, own_values, points_of, scenes
from trackbench.results.point_facts import GridPoint
from trackbench.statistics import rules
from trackbench.statistics.comparison import Comparison, Sample, compare_all
from trackbench.statistics.estimates import RunEstimate
from trackbench.statistics.over_runs import Estimate


@dataclass(frozen=True, eq=False)
class Candidate:
    """A filter with the values that the grid gives it, and the point at which it has them."""

    label: str
    point: GridPoint
    lost: Array
    """why each run (M,) is lost, 0 if it is not"""
    sample: Sample
    """the metric of each run (M,), NaN where it is lost, and the statistic that decides"""
    varied: GridPoint = field(default_factory=dict)
    """what the grid gives the filter, by path"""

    @cached_property
    def name(self) -> str:
        """Name for a sentence, with the grid's values."""
        return f"{named(self.label)} at {self.setting}" if self.varied else named(self.label)

    @property
    def setting(self) -> str:
        """Grid's values; several in parentheses."""
        text = phrases.heading(self.varied)
        return f"({text})" if len(self.varied) > 1 else text

    @cached_property
    def overall(self) -> Estimate:
        """Statistic over the runs that are not lost."""
        return self.sample.overall.estimate

    def has_error(self, untested: bool) -> bool:
        """Return whether its number has an error; unless ``untested``, one that differences need."""
        enough = 2 if untested else rules.FEWEST_RUNS
        return self.sample.steps is not None or np.isfinite(self.sample.values).sum() >= enough

    @cached_property
    def losses(self) -> int:
        """Number of runs that are lost."""
        return int(np.count_nonzero(self.lost))


class Rival(NamedTuple):
    """A filter beside the best one."""

    filter: Candidate
    comparison: Comparison
    """of this filter with the best"""

    @property
    def difference(self) -> RunEstimate:
        """Difference of its number from that of the best."""
        return self.comparison.difference

    @property
    def is_near(self) -> bool:
        """True if its error is at most `rules.NEAR_BEST` times the best, with 95 % confidence."""
        return self.comparison.is_equal or self.comparison.ratio_interval[1] <= rules.NEAR_BEST

    @property
    def is_near_score(self) -> bool:
        """True if its score is at most `rules.NATS_NEAR_BEST` below the best, with 95 % confidence."""
        low, _ = self.difference.interval()
        return self.comparison.is_equal or -low <= rules.NATS_NEAR_BEST


class Ranking(NamedTuple):
    """Ranking of one scenario's filters by one metric: the best, and what differs from it."""

    scene: GridPoint
    """what the grid gives the scenario"""
    metric: Measure
    best: Candidate | None
    """nothing where none can be said: without two runs, or where common runs contradict it"""
    ties: "list[Rival]"
    """filters without a significant difference from the best, up to the first with one"""
    worse: "list[Rival]"
    """filters that are significantly worse"""
    undecided: "list[Rival]"
    """filters of too few common runs, or further off than one that is worse without being so"""
    losing: list[Candidate]
    """filters that lose more runs than another does"""
    reference: Candidate | None
    order: list[Candidate]
    """every filter that has a mean and is not among those losing more runs, the best mean first"""
    chosen: bool
    """whether a filter is there with the best of several values that the grid gives it"""
    runs: int
    compared: Mapping[str, Comparison] = MappingProxyType({})
    """by name, each filter with the first of the order, decided or not; the reference, too"""
    conflict: tuple[Candidate, Candidate, int] | None = None
    """the filter that leads over its runs, the one whose common runs with it contradict that, and the
    number of these"""

    @property
    def among_the_best(self) -> list[Candidate]:
        """Best, and those without a significant difference from it."""
        return [self.best, *(rival.filter for rival in self.ties)] if self.best is not None else []

    @property
    def marked(self) -> list[Candidate]:
        """Filters that a table marks: the best, and ties up to the first that is not near it.

        None if a filter is not near and none is worse, or if one is untested: nothing is decided.
        """
        if not all(
            rival.comparison.is_tested or rival.comparison.is_equal for rival in self.rivals
        ):
            return []
        is_score = self.metric.family[0].is_score
        near = [*takewhile(lambda tie: tie.is_near_score if is_score else tie.is_near, self.ties)]
        decides = self.worse or len(near) == len(self.not_worse)
        return self.among_the_best[: len(near) + 1] if decides else []

    @property
    def rivals(self) -> "list[Rival]":
        """Every filter that is compared with the best."""
        return [*self.not_worse, *self.worse]

    @property
    def not_worse(self) -> "list[Rival]":
        """Filters that are not significantly worse than the best."""
        return [*self.ties, *self.undecided]

    @property
    def nearest(self) -> "Rival | None":
        """Filter nearest to the best among those that are worse."""
        return min(self.worse, key=lambda rival: abs(rival.difference.value), default=None)


def rankings(results: Results, metric: str = "") -> list[Ranking]:
    """Rank the filters in each scenario of the grid, by the first table's or a given metric."""
    metric = metric or leading_metric(results)
    if metric not in results.known_rankings:
        every = []
        for where in scenes(results) if metric else []:
            statistic = compared_statistic(results.config, metric)
            settings = list(candidates_of(results, points_of(results, where), metric, statistic))
            reference = results.config.get("reference")
            every.append(ranking_of(settings, metric, reference)._replace(scene=where))
        results.known_rankings[metric] = every
    return [*results.known_rankings[metric]]


def best_settings(results: Results) -> list[Ranking]:
    """Yield for each varied filter which of its values are best, by scenario."""
    metric = next(iter(ranking_metrics(results)), "")
    best = []
    for where in scenes(results) if metric else []:
        settings = list(candidates_of(results, points_of(results, where), metric))
        for label in dict.fromkeys(c.label for c in settings if c.varied):
            # One ranking for each filter with several values.
            mine = [c for c in settings if c.label == label]
            if len(mine) > 1:
                ranking = ranking_of(mine, metric, apart=True)
                best.append(ranking._replace(scene=where))
    return best


def ranking_metrics(results: Results) -> list[str]:
    """Find the metrics that filters are ranked by, the first one first."""
    points = results.points()
    runs = chain.from_iterable(map(results.runs, points))
    names = dict.fromkeys(metric for _, metric in runs)
    metrics = primary_metrics(list(names))
    errors = [name for name in metrics if measured(name).is_error]
    return [*errors, *(name for name in ("held_log_score", "log_score") if name in metrics)]


def leading_metric(results: Results) -> str:
    """Return the error that filters are ranked by: the first table's; empty if there is none."""
    known = ranking_metrics(results)
    shown = [name for name in compared_statistics(results.config) if name in known]
    return next(iter([*shown, *known]), "")


def ranking_of(
    settings: Sequence[Candidate],
    metric: str,
    reference: str | None = None,
    apart: bool = False,
    unranked: Sequence[Candidate] = (),
) -> Ranking:
    """Rank the filters, each with its best values, in one scenario.

    ``apart``: of the values themselves. ``unranked`` filters belong to the family of tests alone.
    """
    measure = measured(metric)
    sign = -1 if measure.family[0].more_is_better else 1
    # Step 1: set the reference apart; sort the filters, each at its best values.
    exact = next((c for c in settings if c.label == reference), None)
    tried = [c for c in settings if c.label != reference]
    ranked = sorted(tried if apart else _best_of_each(tried, sign), key=lambda c: _rank(c, sign))
    # Step 2: take out filters that lose more runs, and those without a value.
    losing = _losing(ranked)
    rivals = [c for c in ranked if c not in losing and isfinite(c.overall.value)]
    losing += [c for c in ranked if c not in rivals and c not in losing and c.losses]
    chosen, runs = len(tried) > len(ranked), max((len(c.lost) for c in ranked), default=0)
    ranking = Ranking({}, measure, None, [], [], [], losing, exact, rivals, chosen, runs)
    if not rivals:
        return ranking
    # Step 3: compare the first of the others with all the rest on common runs.
    best, beside = rivals[0], [exact] if exact is not None else []
    family = compare_all({c.name: c.sample for c in (*ranked, *beside, *unranked)})
    pairs = {c.name: family.between(c.name, best.name) for c in (*rivals[1:], *beside)}
    compared = {name: comparison for name, comparison in pairs.items() if comparison is not None}
    ranking = ranking._replace(compared=compared)
    if not best.has_error(untested=apart or not rivals[1:]):
        return ranking
    ties, worse, undecided = list[Rival](), list[Rival](), list[Rival]()
    for rival in rivals[1:]:
        comparison = compared.get(rival.name)
        if comparison is None or sign * comparison.sign < 0:
            # No runs in common; or on these the other is the better one.
            common = 0 if comparison is None else comparison.difference.runs
            return ranking._replace(conflict=(best, rival, common))
        tested = comparison.is_tested or comparison.is_equal
        # A filter further off than one that is no tie is no tie either.
        tie = ties if tested and not (worse or undecided) else undecided
        (worse if comparison.sign else tie).append(Rival(rival, comparison))
    return ranking._replace(best=best, ties=ties, worse=worse, undecided=undecided)


def candidates_of(
    results: Results, points: Sequence[GridPoint], metric: str, statistic: str = "mean"
) -> Iterator[Candidate]:
    """Yield each filter with each of the values that the grid gives it, once."""
    for label in results.filters:
        yielded = set()
        for point in points:
            runs, varied = results.runs(point), own_values(results, point, label)
            # Each set of values counts once, at the first point that has it.
            if str(varied) not in yielded and (label, "lost") in runs:
                yielded.add(str(varied))
                lost = runs[label, "lost"]
                values = runs.get((label, metric), np.full(len(lost), np.nan))
                steps = results.judged_steps(point).get((label, metric))
                yield Candidate(label, point, lost, Sample.of(values, statistic, steps), varied)


def _rank(candidate: Candidate, sign: float) -> tuple[bool, float]:
    value = candidate.overall.value
    return not isfinite(value), sign * value if isfinite(value) else 0.0


def _best_of_each(settings: Sequence[Candidate], sign: float) -> list[Candidate]:
    best = []
    for label in dict.fromkeys(c.label for c in settings):
        mine = [c for c in settings if c.label == label]
        # Values with which a filter loses more runs are out, unless no others are left.
        losing = _losing(mine)
        best.append(min([c for c in mine if c not in losing] or mine, key=lambda c: _rank(c, sign)))
    return best


def _losing(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Find the filters that lose significantly more of the same runs than another."""
    losing = []
    for a in candidates:
        if not a.losses:
            continue
        others = (b.lost for b in candidates if b is not a and len(b.lost) == len(a.lost))
        if any(rules.loses_more(a.lost, lost, len(candidates)) for lost in others):
            losing.append(a)
    return losing
