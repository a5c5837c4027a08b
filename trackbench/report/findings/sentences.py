"""Sentences on a ranking: which filter is best, or why none is; tuning, other metrics."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence

from trackbench.config.tuning import tuned_label
from trackbench.errors import counted
from trackbench.report.findings import phrases
from trackbench.report.findings.phrases import listed, metric_words, statistic_words, verb
from trackbench.report.findings.ranking import CommonSteps, Ranking, ranking_metrics, rankings
from trackbench.report.results import Results
from trackbench.statistics import rules

HOW_DECIDED = (
    f"Filters differ significantly {rules.HOW_FILTERS_DIFFER}. A ratio has its 95 % interval. A filter "
    "that loses significantly more runs than another is unranked."
)


def headline(results: Results) -> str:
    """Return the sentence on the best filter; empty if no filter can be called best.

    `answer` then has the reason.
    """
    scene_rankings = rankings(results)
    if len(scene_rankings) > 1:
        return _headline_over_scenes(scene_rankings)
    if not scene_rankings:
        return ""
    (ranking,) = scene_rankings
    number = len(ranking.order)
    if ranking.best is None or number < 2:
        return ""
    # No filter differs from the best, but some could not be compared with it.
    if not ranking.worse and ranking.undecided:
        return ""
    if not ranking.worse:
        return f"The {number} filters do not differ significantly."
    extreme = "highest" if ranking.metric.definition.is_score else "lowest"
    statistic = ranking.best.sample.statistic if ranking.runs > 1 else "rms"
    words = statistic_words(statistic, ranking.metric)
    sentence = f"{ranking.best.name} has the {extreme} {words} of {number} filters."
    if ranking.ties:
        names = [tie.filter.name for tie in ranking.ties]
        verb_of_names = "does" if len(names) == 1 else "do"
        sentence += f" {listed(names)} {verb_of_names} not differ significantly from it."
    return sentence


def unranked_count(results: Results) -> int:
    """Count the filters that `headline` leaves out: the reference, and those that cannot be compared.

    Several rankings may leave out different filters, for which it is 0.
    """
    scene_rankings = rankings(results)
    if len(scene_rankings) != 1:
        return 0
    (ranking,) = scene_rankings
    if ranking.best is None:
        return 0
    ranked_labels = {candidate.label for candidate in ranking.order}
    return len(set(results.filters) - ranked_labels)


def _headline_over_scenes(scene_rankings: Sequence[Ranking]) -> str:
    """Return the sentence on the filter that is among the best most often; empty if none ever is."""
    times_best = Counter[str]()
    for ranking in scene_rankings:
        times_best.update(candidate.label for candidate in ranking.among_the_best)
    if not times_best:
        return ""
    label, times = times_best.most_common(1)[0]
    paths = phrases.joined(phrases.axis(path) for path in scene_rankings[0].scene)
    return f"{label} is among the best at {times} of {len(scene_rankings)} values of {paths}."


def answer(results: Results) -> list[str]:
    """Return sentences on the ranking of a results folder, a line each."""
    scene_rankings = rankings(results)
    if len(scene_rankings) != 1:
        return []
    (ranking,) = scene_rankings
    target = (results.config.get("scenario") or {}).get("target") or {}
    is_recorded = isinstance(target, Mapping) and target.get("kind") == "measured"
    lines = [_explain_undecided(ranking, is_recorded)]
    if ranking.best is not None:
        lines += [_tuned(results, ranking), _other_metrics(results, ranking)]
        if ranking.runs == 1 and any(rival.comparison.is_tested for rival in ranking.rivals):
            what = "by an error of their mean difference that allows for autocorrelation"
            lines.append(f"One recording: its steps decide, {what}.")
    if ranking.common_steps is not None:
        lines.append(_explain_common_steps(ranking.common_steps))
    return [line for line in lines if line]


def _explain_common_steps(common: CommonSteps) -> str:
    """Explain over which steps filters are compared if some have the metric at fewer steps."""
    names = [candidate.name for candidate in common.skipping]
    verb = "has" if len(names) == 1 else "have"
    number = int(common.is_common.sum())
    return (
        f"The ranking is over the {number} of {common.most} measured steps at which every filter has a "
        f"value; {listed(names)} {verb} none at the others."
    )


def _explain_undecided(ranking: Ranking, is_recorded: bool) -> str:
    """Explain why no filter is best, or why a comparison with the best is undecided; else empty.

    ``is_recorded`` is True if the target was recorded, not simulated.
    """
    if ranking.best is not None:
        return " ".join(_undecided_pairs(ranking))
    if ranking.conflict is not None:
        leader = ranking.conflict.leader.name
        rival = ranking.conflict.rival.name
        common_runs = ranking.conflict.common_runs
        if common_runs:
            why = (
                f"{leader} leads over all runs that it keeps, but over the {common_runs} runs that "
                f"both keep {rival} is better"
            )
        else:
            why = f"{leader} and {rival} keep no run in common"
        return f"Which is best is inconclusive: {why}."
    if len(ranking.order) < 2:
        return ""
    needed = f"at least {rules.FEWEST_RUNS} are needed"
    sentence = f"{counted(ranking.runs, 'run')} cannot decide which filter is best; {needed}."
    if is_recorded:
        sentence += " A recorded run alone is decided by its steps: make the runs a grid, "
        sentence += "`grid: {scenario.target.runs: [[NAME], [NAME]]}`."
    return sentence


def _undecided_pairs(ranking: Ranking) -> Iterator[str]:
    """Yield a sentence for each reason why filters are not compared with the best, with their names."""
    assert ranking.best is not None
    names_by_reason: dict[str, list[str]] = {}
    for rival in ranking.undecided:
        if rival.difference.why:
            names_by_reason.setdefault(rival.difference.why, []).append(rival.filter.name)
    for reason, names in names_by_reason.items():
        yield f"Undecided between {listed([ranking.best.name, *names])}: {reason}."
    is_score = ranking.metric.definition.is_score
    is_correlated = any("autocorrelation" in reason for reason in names_by_reason)
    if ranking.runs == 1 and is_correlated and not is_score:
        yield (
            f"{rules.FEWEST_RUNS} recordings may decide, or the log score: filters are ranked by "
            "the first column of the first table."
        )


def _tuned(results: Results, ranking: Ranking) -> str:
    """Return the sentence on untuned filters that the best filter, a tuned one, is compared with."""
    best = ranking.best
    original_by_tuned_label = {
        tuned_label(label): label for label in results.config.get("tune") or {}
    }
    if best is None or best.label not in original_by_tuned_label:
        return ""
    # The tuned filters and their untuned originals are left out.
    left_out = {*original_by_tuned_label, *original_by_tuned_label.values()}
    compared = [rival.filter for rival in ranking.rivals]
    untuned = [candidate.name for candidate in compared if candidate.label not in left_out]
    if not untuned:
        return ""
    words = f"{listed(untuned)} {verb(untuned)} not"
    return f"{best.name} is tuned, {words}: tuning may be the difference."


def _other_metrics(results: Results, ranking: Ranking) -> str:
    """Return the sentence on other metrics by which another filter is significantly better."""
    metrics_by_leader: dict[str, list[str]] = {}
    for metric in ranking_metrics(results):
        if metric == ranking.metric.metric:
            continue
        for other in rankings(results, metric):
            # Another filter is best by this metric, and the best by the first metric is worse than it.
            worse = [rival.filter.name for rival in other.worse]
            if other.best and ranking.best and ranking.best.name in worse:
                words = metric_words(other.metric)
                metrics_by_leader.setdefault(other.best.name, []).append(words)
    parts = [f"by {listed(words)} {name} is better" for name, words in metrics_by_leader.items()]
    if not parts:
        return ""
    return f"But {', and '.join(parts[:2])}."
