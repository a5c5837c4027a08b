"""Sentences on what a ranking's table cannot say: why no filter is best, tuning, other metrics."""

from trackbench.config.tuning import tuned_label
from trackbench.errors import counted
from trackbench.report.findings.phrases import listed, metric_words, verb
from trackbench.report.findings.ranking import Ranking, ranking_metrics, rankings
from trackbench.report.results import Results
from trackbench.statistics import rules

HOW_DECIDED = (
    f"Filters differ significantly {rules.HOW_FILTERS_DIFFER}. A ratio has its 95 % interval. A filter "
    "that loses significantly more runs than another is unranked."
)


def answer(results: Results) -> list[str]:
    """Return sentences on the ranking of a results folder, a line each."""
    scene_rankings = rankings(results)
    if len(scene_rankings) != 1:
        return []
    (ranking,) = scene_rankings
    lines = [_explain_undecided(ranking)]
    if ranking.best is not None:
        lines += [_tuned(results, ranking), _other_metrics(results, ranking)]
        if ranking.runs == 1 and any(rival.comparison.is_tested for rival in ranking.rivals):
            what = "by an error of their mean difference that allows for autocorrelation"
            lines.append(f"One recording: its steps decide, {what}.")
    return [line for line in lines if line]


def _explain_undecided(ranking: Ranking) -> str:
    """Explain why no filter is best, or why one that looks worse than another is not."""
    if ranking.best is not None:
        reasons = dict.fromkeys(rival.difference.why for rival in ranking.undecided)
        return " ".join(f"Undecided: {why}." for why in reasons if why)
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
    return f"{counted(ranking.runs, 'run')} cannot decide which filter is best; {needed}."


def _tuned(results: Results, ranking: Ranking) -> str:
    """Name the untuned filters that a tuned best one is compared with."""
    best = ranking.best
    label_by_tuned_label = {tuned_label(label): label for label in results.config.get("tune") or {}}
    if best is None or best.label not in label_by_tuned_label:
        return ""
    # The tuned filters and their untuned originals are left out.
    tuned_labels = {*label_by_tuned_label, *label_by_tuned_label.values()}
    compared = [rival.filter for rival in ranking.rivals]
    untuned = [candidate.name for candidate in compared if candidate.label not in tuned_labels]
    if not untuned:
        return ""
    words = f"{listed(untuned)} {verb(untuned)} not"
    return f"{best.name} is tuned, {words}: tuning may be the difference."


def _other_metrics(results: Results, ranking: Ranking) -> str:
    """Name the other metrics by which another filter is better than the best."""
    metrics_by_leader: dict[str, list[str]] = {}
    for metric in ranking_metrics(results):
        if metric == ranking.metric.metric:
            continue
        for other in rankings(results, metric):
            # Another filter leads by this metric, and the best by the first metric is worse.
            worse = [rival.filter.name for rival in other.worse]
            if other.best and ranking.best and ranking.best.name in worse:
                words = metric_words(other.metric)
                metrics_by_leader.setdefault(other.best.name, []).append(words)
    parts = [f"by {listed(words)} {name} is better" for name, words in metrics_by_leader.items()]
    return f"But {', and '.join(parts[:2])}." if parts else ""
