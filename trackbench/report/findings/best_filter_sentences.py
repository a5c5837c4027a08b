"""Sentences on a ranking: which filter is best, or why none is; tuning, other metrics."""

from collections.abc import Iterator, Mapping

from trackbench.config.tuning import tuned_label
from trackbench.errors import counted
from trackbench.report.findings.common_steps import explain_common_steps
from trackbench.report.findings.metric_phrases import metric_words, statistic_words
from trackbench.report.findings.phrases import listed, verb
from trackbench.report.findings.ranking import Ranking, Rival, rankings
from trackbench.report.findings.ranking_metrics import ranking_metrics
from trackbench.report.findings.ranking_over_scenarios import headline_over_scenarios
from trackbench.report.findings.ratio_to_best import (
    distance_from_best,
    distance_in_parentheses,
    distances_in_words,
    share_of_difference,
    within_in_words,
)
from trackbench.report.tables_and_figures import Results
from trackbench.statistics import significance_rules as rules

_FAR_OFF = 10.0
"""Multiple of the best error, or of the density of the best score, beyond which a filter is far off."""


def how_decided(results: Results) -> str:
    """Return the sentences on the rules of the ranking, which are other ones for one recorded run."""
    interval = "A ratio has its 95 % interval."
    if results.steps_decide:
        return f"Filters differ significantly {rules.HOW_STEPS_DIFFER}. {interval}"
    return (
        f"Filters differ significantly {rules.HOW_FILTERS_DIFFER}. {interval} A filter that loses "
        "significantly more runs than another is unranked."
    )


def headline(results: Results) -> str:
    """Return the sentence on the best filter; empty if no filter can be called best.

    `answer` then has the reason.
    """
    scene_rankings = rankings(results)
    if len(scene_rankings) > 1:
        return headline_over_scenarios(scene_rankings)
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
    # Over a single run mean and rms are equal, and the words on the rms are shorter.
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

    The count is 0 if there is no best filter, and for several scenarios of a grid, whose rankings may
    leave out different filters.
    """
    scene_rankings = rankings(results)
    if len(scene_rankings) != 1:
        return 0
    (ranking,) = scene_rankings
    if ranking.best is None:
        return 0
    ranked_labels = {candidate.label for candidate in ranking.order}
    return len(set(results.filters) - ranked_labels)


def answer(results: Results) -> list[str]:
    """Return lines of sentences that explain what `headline` leaves open about the ranking.

    They are about undecided comparisons, tuning, other metrics and the steps of a recording. There are
    none for several scenarios of a grid.
    """
    scene_rankings = rankings(results)
    if len(scene_rankings) != 1:
        return []
    (ranking,) = scene_rankings
    target = (results.config.get("scenario") or {}).get("target") or {}
    is_recorded = isinstance(target, Mapping) and target.get("kind") == "measured"
    has_inputs = is_recorded and bool(target.get("input"))
    lines = [_explain_undecided(ranking, is_recorded, has_inputs)]
    if ranking.best is not None:
        lines += [_tuning_sentence(results, ranking), _other_metrics_sentence(results, ranking)]
        if ranking.runs == 1 and any(rival.comparison.is_tested for rival in ranking.rivals):
            method = "by an error of their mean difference that allows for autocorrelation"
            # ``why`` is the reason why a difference has no standard error; empty if it has one.
            if any(rival.difference.why for rival in ranking.rivals):
                lines.append(f"The other comparisons are decided by the steps, {method}.")
            else:
                lines.append(f"One recording: its steps decide, {method}.")
    if ranking.common_steps is not None:
        lines.append(explain_common_steps(ranking.common_steps))
    return [line for line in lines if line]


def _explain_undecided(ranking: Ranking, is_recorded: bool, has_inputs: bool) -> str:
    """Explain why no filter is best, or why a comparison with the best is undecided; else empty.

    ``is_recorded`` is True if the target was recorded, not simulated. ``has_inputs`` is True if its
    motion has recorded inputs.
    """
    if ranking.best is not None:
        if ranking.runs == 1 and any(rival.difference.why for rival in ranking.not_worse):
            return " ".join(_sentences_on_recording(ranking, has_inputs))
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
    # Of two or more filters without a conflict one is best, unless there are too few runs for a test.
    needed = f"at least {rules.FEWEST_RUNS} are needed"
    sentence = f"{counted(ranking.runs, 'run')} cannot decide which filter is best; {needed}."
    if is_recorded:
        sentence += " A recorded run alone is decided by its steps: make the runs a grid, "
        sentence += "`grid: {scenario.target.runs: [[NAME], [NAME]]}`."
    return sentence


def _sentences_on_recording(ranking: Ranking, has_inputs: bool) -> Iterator[str]:
    """Yield sentences on one recording whose steps cannot be tested: it is described, and not more.

    They name the best on this recording, and how near it or far from it each other filter is. Then
    they say why another recording may be different. ``has_inputs`` is True if it has inputs of a motion.
    """
    assert ranking.best is not None
    # Step 1: the filters by how far they are from the best; those that are worse have been tested.
    near: list[Rival] = []
    between: list[Rival] = []
    far: list[Rival] = []
    for rival in ranking.not_worse:
        distance = distance_from_best(ranking, rival)
        if distance <= rules.NEAR_BEST:
            near.append(rival)
        elif distance <= _FAR_OFF:
            between.append(rival)
        else:
            far.append(rival)
    # Step 2: a clause for each of these groups.
    extreme = "highest" if ranking.metric.definition.is_score else "lowest"
    words = metric_words(ranking.metric)
    yield f"On this recording {ranking.best.name} has the {extreme} {words}."
    clauses = []
    if near:
        names = [rival.filter.name for rival in near]
        farthest = max(near, key=lambda rival: distance_from_best(ranking, rival))
        clauses.append(f"{listed(names)} {verb(names)} {within_in_words(ranking, farthest)} of it")
    if between:
        names = [rival.filter.name for rival in between]
        clauses.append(
            f"{listed(names)} {verb(names)} farther off, {distances_in_words(ranking, between)}"
        )
    if far:
        names = [rival.filter.name for rival in far]
        clauses.append(f"{listed(names)} {verb(names)} far off, {distances_in_words(ranking, far)}")
    if clauses:
        yield f"{'; '.join(clauses)}."
    # Step 3: why this is not tested.
    names_by_reason = ranking.names_by_reason
    for reason, names in names_by_reason.items():
        yield (
            "One recording cannot decide how it would be on another, and no test compares it with "
            f"{listed(names)}: {reason}."
        )
    # Errors of successive steps are correlated, often over most of the recording. The terms of a log
    # score, one for each measurement given those before, are hardly correlated and can be tested. A
    # user ranks by it with a first column of the first table that has the log score.
    is_score = ranking.metric.definition.is_score
    is_correlated = any("autocorrelation" in reason for reason in names_by_reason)
    if is_correlated and not is_score:
        way = "filters are ranked by the first column of the first table"
        if has_inputs:
            # Runs with inputs of their own exclude each other in one experiment (`inputs_at`).
            yield f"The log score may decide: {way}. A grid over recordings judges each alone."
        else:
            recordings = f"{rules.FEWEST_RUNS} recordings as runs of one experiment"
            yield f"{recordings} may decide, or the log score: {way}."


def _undecided_pairs(ranking: Ranking) -> Iterator[str]:
    """Yield a sentence for each reason why filters are not compared with the best, with their names.

    Such a reason is, for example, a difference without a standard error.
    """
    assert ranking.best is not None
    for reason, names in ranking.names_by_reason.items():
        yield f"Undecided between {listed([ranking.best.name, *names])}: {reason}."


def _tuning_sentence(results: Results, ranking: Ranking) -> str:
    """Return the sentence on untuned filters that the best filter, a tuned one, is compared with.

    It is empty if the best filter is not tuned. It does not name the originals of tuned filters.
    """
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


def _other_metrics_sentence(results: Results, ranking: Ranking) -> str:
    """Return the sentence on other metrics by which another filter is significantly better.

    It has by how much the error of the best is larger, and leaves out tiny differences. It names two
    other filters at most, and is empty if there is none. ``ranking`` is the only one by its metric, that
    of the only scenario in the results.
    """
    best = ranking.best
    if best is None:
        return ""
    matters = rules.share_that_matters(results.config.get("matters"))
    # Words of the other metrics, by the name of the filter that is best by them.
    metrics_by_leader: dict[str, list[str]] = {}
    for metric in ranking_metrics(results):
        if metric == ranking.metric.metric:
            continue
        for other in rankings(results, metric):  # one ranking, as there is one scenario
            # Another filter is best by this metric, and the best by the first metric is worse than it.
            for rival in other.worse:
                if other.best is None or rival.filter.name != best.name:
                    continue
                # NaN, of a best error of zero, is not tiny.
                if share_of_difference(other.metric, rival.comparison) < matters:
                    continue
                distance = distance_in_parentheses(other.metric, rival.comparison)
                words = f"{metric_words(other.metric)} {distance}".rstrip()
                metrics_by_leader.setdefault(other.best.name, []).append(words)
    parts = []
    for name, metrics in metrics_by_leader.items():
        parts.append(f"by {listed(metrics)} {name} is better than {best.name}")
    if not parts:
        return ""
    return f"But {', and '.join(parts[:2])}."
