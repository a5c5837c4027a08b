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
    standings = rankings(results)
    if len(standings) != 1:
        return []
    (standing,) = standings
    lines = [_undecided(standing)]
    if standing.best is not None:
        lines += [_tuned(results, standing), _other_metrics(results, standing)]
        if standing.runs == 1 and any(r.comparison.is_tested for r in standing.rivals):
            what = "by an error of their mean difference that allows for autocorrelation"
            lines.append(f"One recording: its steps decide, {what}.")
    return [line for line in lines if line]


def _undecided(standing: Ranking) -> str:
    """Explain why no filter is best, or why one that looks worse than another is not."""
    reasons = dict.fromkeys(rival.difference.why for rival in standing.undecided)
    if standing.best is not None:
        return " ".join(f"Undecided: {why}." for why in reasons if why)
    if standing.conflict is not None:
        first, other, common = standing.conflict
        why = f"{first.name} and {other.name} keep no run in common"
        if common:
            why = (
                f"{first.name} leads over all runs that it keeps, but over the {common} runs that "
            )
            why += f"both keep {other.name} is better"
        return f"Which is best is inconclusive: {why}."
    if not standing.order[1:]:
        return ""
    needed = f"at least {rules.FEWEST_RUNS} are needed"
    return f"{counted(standing.runs, 'run')} cannot decide which filter is best; {needed}."


def _tuned(results: Results, standing: Ranking) -> str:
    """Name the untuned filters that a tuned best one is compared with."""
    tuned = {tuned_label(label): label for label in results.config.get("tune") or {}}
    best = standing.best
    if best is None or best.label not in tuned:
        return ""
    compared = [rival.filter for rival in standing.rivals]
    others = [c.name for c in compared if c.label not in tuned and c.label not in tuned.values()]
    if not others:
        return ""
    untuned = f"{listed(others)} {verb(others)} not"
    return f"{best.name} is tuned, {untuned}: tuning may be the difference."


def _other_metrics(results: Results, standing: Ranking) -> str:
    """Name the other metrics by which another filter is better than the best."""
    better: dict[str, list[str]] = {}
    names = [name for name in ranking_metrics(results) if name != standing.metric.metric]
    for metric in names:
        for other in rankings(results, metric):
            # Another filter leads by this metric, and the best by the first metric is worse.
            worse = [rival.filter.name for rival in other.worse]
            if other.best and standing.best and standing.best.name in worse:
                better.setdefault(other.best.name, []).append(metric_words(other.metric))
    parts = [f"by {listed(words)} {name} is better" for name, words in better.items()]
    return f"But {', and '.join(parts[:2])}." if parts else ""
