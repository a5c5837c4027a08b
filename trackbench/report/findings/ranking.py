"""Rankings: the best filter, those without a significant difference from it, those that lose more runs.

Decided by the statistic of the first table's column, such as rms(rmse_position): its differences on
common runs, by the rule for filters. A filter that loses significantly more runs than another is never
the best.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import isfinite
from types import MappingProxyType
from typing import NamedTuple

from trackbench.evaluation.metric_expression import Measure, measured
from trackbench.report.findings.candidates import (
    Candidate,
    best_setting_of_each,
    candidates_of,
    losing_candidates,
    sort_key,
)
from trackbench.report.findings.common_steps import CommonSteps, common_steps_of
from trackbench.report.findings.ranking_metrics import leading_metric
from trackbench.report.mean_or_rms_of_metric import compared_statistic
from trackbench.report.points_by_scenario import points_of, scenes
from trackbench.report.tables_and_figures import Results
from trackbench.results.points_json import GridPoint
from trackbench.statistics import significance_rules as rules
from trackbench.statistics.compare_all_pairs import compare_all
from trackbench.statistics.comparison import Comparison
from trackbench.statistics.estimates import RunEstimate


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


class Conflict(NamedTuple):
    """Two filters of which one is better over the runs that it keeps, the other over common runs."""

    leader: Candidate
    """filter that leads over its runs"""
    rival: Candidate
    """filter that is better over their common runs"""
    common_runs: int
    """number of the common runs"""


class Ranking(NamedTuple):
    """Ranking of one scenario's filters by one metric: the best, and what differs from it."""

    scene: GridPoint
    """values that the grid gives the scenario, by path"""
    metric: Measure
    best: Candidate | None
    """None if no filter can be called best: without two runs, or where common runs contradict it"""
    ties: list[Rival]
    """filters without a significant difference from the best, up to the first with one"""
    worse: list[Rival]
    """filters that are significantly worse"""
    undecided: list[Rival]
    """filters that are neither: those that cannot be tested, such as of too few common runs, and those
    without a significant difference whose number is behind that of one in `worse` or `undecided`"""
    losing: list[Candidate]
    """filters that lose more runs than another does"""
    reference: Candidate | None
    """filter that is compared with the best, but has no rank; None if there is none"""
    order: list[Candidate]
    """every filter that has a mean and is not among those losing more runs, the best mean first"""
    chosen: bool
    """whether any filter has several settings in the grid, of which its best one is ranked"""
    runs: int
    """largest number of runs of any filter but the reference, lost ones included"""
    compared: Mapping[str, Comparison] = MappingProxyType({})
    """by name, each filter with the first of the order, decided or not; the reference, too"""
    conflict: Conflict | None = None
    """why no filter is best, if common runs contradict the order"""
    common_steps: CommonSteps | None = None
    """steps of a recording that count; None if all do"""

    @property
    def among_the_best(self) -> list[Candidate]:
        """Best, and those without a significant difference from it."""
        if self.best is None:
            return []
        return [self.best, *(tie.filter for tie in self.ties)]

    @property
    def marked(self) -> list[Candidate]:
        """Filters that a table marks: the best, and those of the `ties` that are near it.

        The ties are sorted, the best mean first. Those behind the first that is not near the best are
        not marked either. `undecided` filters, which are no ties, never are.

        The list is empty where nothing is decided. That is so if a filter has neither been tested nor
        has equal values. It is also so if a filter is not near the best and none is significantly worse:
        the marks would then divide filters that no test divides.
        """
        if self.best is None:
            return []
        # A filter with the values of the best in every run has no standard error and needs no test.
        for rival in self.rivals:
            if not (rival.comparison.is_tested or rival.comparison.is_equal):
                return []
        is_score = self.metric.definition.is_score
        near_filters: list[Candidate] = []
        for tie in self.ties:
            is_near = tie.is_near_score if is_score else tie.is_near
            if not is_near:
                break
            near_filters.append(tie.filter)
        all_are_near = len(near_filters) == len(self.ties) and not self.undecided
        if not self.worse and not all_are_near:
            return []
        return [self.best, *near_filters]

    @property
    def rivals(self) -> list[Rival]:
        """Every filter that is compared with the best."""
        return [*self.not_worse, *self.worse]

    @property
    def not_worse(self) -> list[Rival]:
        """Filters that are not significantly worse than the best."""
        return [*self.ties, *self.undecided]

    @property
    def names_by_reason(self) -> dict[str, list[str]]:
        """Names of the filters that are not compared with the best, by the reason why they are not."""
        names_by_reason: dict[str, list[str]] = {}
        for rival in self.not_worse:
            if rival.difference.why:
                names_by_reason.setdefault(rival.difference.why, []).append(rival.filter.name)
        return names_by_reason

    @property
    def nearest(self) -> Rival | None:
        """Filter nearest to the best among those that are worse."""
        return min(self.worse, key=lambda rival: abs(rival.difference.value), default=None)


def rankings(results: Results, metric: str = "") -> list[Ranking]:
    """Rank the filters in each scenario of the grid.

    Parameters
    ----------
    results
        results folder
    metric
        metric of per_run.csv that ranks, such as ``rmse_position``; default: the first table's

    Returns
    -------
    list[Ranking]
        rankings in the order of the scenarios; none without a metric.
    """
    metric = metric or leading_metric(results)
    if not metric:
        return []
    # The rankings by a metric are computed once for all tables, figures and sentences.
    if metric not in results.known_rankings:
        ranked_scenes = []
        for scene in scenes(results):
            points = points_of(results, scene)
            statistic = compared_statistic(results.config, metric)
            candidates = list(candidates_of(results, points, metric, statistic))
            ranking = ranking_of(candidates, metric, results.config.get("reference"))
            ranked_scenes.append(ranking._replace(scene=scene))
        results.known_rankings[metric] = ranked_scenes
    return [*results.known_rankings[metric]]


def ranking_of(
    candidates: Sequence[Candidate],
    metric: str,
    reference: str | None = None,
    ranks_settings: bool = False,
    unranked: Sequence[Candidate] = (),
) -> Ranking:
    """Rank the filters of one scenario, each with its best values.

    Parameters
    ----------
    candidates
        filters with each of the values that the grid gives them
    metric
        metric that ranks, by which the candidates' samples are
    reference
        label of the filter that has no rank, but is compared with the best
    ranks_settings
        rank all candidates, which are one filter with several values
    unranked
        filters without a rank, which count in the correction for the number of tests

    Returns
    -------
    Ranking
        ranking with the best, if the runs decide it.
    """
    m = measured(metric)
    # Times this sign, a lower number is a better one.
    sign = -1 if m.definition.more_is_better else 1
    # Step 1: set the reference apart. Sort the filters, each with the best of its values.
    reference_candidate = next((c for c in candidates if c.label == reference), None)
    tried = [c for c in candidates if c.label != reference]
    contenders = tried if ranks_settings else best_setting_of_each(tried, sign)
    ranked = sorted(contenders, key=lambda c: sort_key(c, sign))
    # Step 2: take out filters that lose more runs, and those without a value. Of the latter those with
    # lost runs count among the losing ones.
    losing = losing_candidates(ranked)
    order = [c for c in ranked if c not in losing and isfinite(c.overall.value)]
    losing += [c for c in ranked if c not in order and c not in losing and c.losses]
    # Step 3: filters of a recording count over the steps at which all have the metric.
    common_steps = common_steps_of(order)
    if common_steps is not None:
        others = [c for c in ranked if c not in order]
        is_common = common_steps.is_common
        compared_alike = [replace(c, sample=c.sample.over_steps(is_common)) for c in order]
        order = sorted(compared_alike, key=lambda c: sort_key(c, sign))
        ranked = [*order, *others]
    ranking = Ranking(
        scene={},
        metric=m,
        best=None,
        ties=[],
        worse=[],
        undecided=[],
        losing=losing,
        reference=reference_candidate,
        order=order,
        chosen=len(tried) > len(ranked),  # a filter has several sets of values, of which one ranks
        runs=max((len(c.lost) for c in ranked), default=0),
        common_steps=common_steps,
    )
    if not order:
        return ranking
    # Step 4: compare all the rest with the first of the order on common runs. All pairs of filters are
    # one family of tests.
    first = order[0]
    rivals = order[1:]
    references = [] if reference_candidate is None else [reference_candidate]
    family = compare_all({c.name: c.sample for c in (*ranked, *references, *unranked)})
    compared: dict[str, Comparison] = {}
    for candidate in (*rivals, *references):
        comparison = family.between(candidate.name, first.name)
        if comparison is not None:
            compared[candidate.name] = comparison
    ranking = ranking._replace(compared=compared)
    # A filter with too few runs for a standard error of its number is not called the best. Two runs are
    # enough without rivals, and for settings of one filter. Otherwise the rivals must be tested, which
    # takes more.
    if not first.has_error(untested=ranks_settings or not rivals):
        return ranking
    # Step 5: divide the rivals into ties, worse and undecided ones. If common runs contradict the order,
    # no filter is best.
    ties: list[Rival] = []
    worse: list[Rival] = []
    undecided: list[Rival] = []
    for candidate in rivals:
        comparison = compared.get(candidate.name)
        if comparison is None:
            conflict = Conflict(leader=first, rival=candidate, common_runs=0)
            return ranking._replace(conflict=conflict)
        # The comparison is of the rival with the first: the rival is significantly better.
        if sign * comparison.sign < 0:
            common_runs = comparison.difference.runs
            conflict = Conflict(leader=first, rival=candidate, common_runs=common_runs)
            return ranking._replace(conflict=conflict)
        rival = Rival(filter=candidate, comparison=comparison)
        is_decided = comparison.is_tested or comparison.is_equal
        if comparison.sign:  # significantly worse, as the rival is not better
            worse.append(rival)
        elif is_decided and not worse and not undecided:
            ties.append(rival)
        else:  # a filter further off than one that is no tie is no tie either
            undecided.append(rival)
    return ranking._replace(best=first, ties=ties, worse=worse, undecided=undecided)
