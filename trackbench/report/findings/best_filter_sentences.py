"""Sentences on a ranking: which filter is best, or why none is; tuning, other metrics."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from math import exp, inf, isfinite

from trackbench.config.tuning import tuned_label
from trackbench.errors import counted
from trackbench.report.findings import grid_phrases, phrases
from trackbench.report.findings.common_steps import explain_common_steps
from trackbench.report.findings.metric_phrases import metric_words, statistic_words
from trackbench.report.findings.phrases import listed, verb
from trackbench.report.findings.ranking import Ranking, Rival, ranking_metrics, rankings
from trackbench.report.tables_and_figures import Results
from trackbench.statistics import significance_rules as rules

_FAR_OFF = 10.0
"""Multiple of the best error, or of the density of the best score, beyond which a filter is far off."""
_WITHIN_ONE_PERCENT = 1.01
"""Multiple of the best error up to which an error is called within 1 %."""
_MOST_NATS = 700.0
"""Difference of log scores whose exponential is a finite number; larger ones count as this one."""
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


def _headline_over_scenes(scene_rankings: Sequence[Ranking]) -> str:
    """Return the sentence on the filter that is among the best most often; empty if none ever is."""
    times_best = Counter[str]()
    for ranking in scene_rankings:
        times_best.update(candidate.label for candidate in ranking.among_the_best)
    if not times_best:
        return ""
    label, times = times_best.most_common(1)[0]
    paths = phrases.joined(grid_phrases.axis(path) for path in scene_rankings[0].scene)
    name = phrases.named(label)
    return f"{name} is among the best at {times} of {len(scene_rankings)} values of {paths}."


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
            return " ".join(_on_this_recording(ranking, has_inputs))
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


def _undecided_pairs(ranking: Ranking) -> Iterator[str]:
    """Yield a sentence for each reason why filters are not compared with the best, with their names.

    Such a reason is, for example, a difference without a standard error.
    """
    assert ranking.best is not None
    for reason, names in _names_by_reason(ranking).items():
        yield f"Undecided between {listed([ranking.best.name, *names])}: {reason}."


def _names_by_reason(ranking: Ranking) -> dict[str, list[str]]:
    """Collect the filters that are not compared with the best, by the reason why they are not."""
    names_by_reason: dict[str, list[str]] = {}
    for rival in ranking.not_worse:
        if rival.difference.why:
            names_by_reason.setdefault(rival.difference.why, []).append(rival.filter.name)
    return names_by_reason


def _on_this_recording(ranking: Ranking, has_inputs: bool) -> Iterator[str]:
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
        distance = _distance(ranking, rival)
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
        farthest = max(near, key=lambda rival: _distance(ranking, rival))
        clauses.append(f"{listed(names)} {verb(names)} {_within(ranking, farthest)} of it")
    if between:
        names = [rival.filter.name for rival in between]
        clauses.append(f"{listed(names)} {verb(names)} farther off, {_sizes(ranking, between)}")
    if far:
        names = [rival.filter.name for rival in far]
        clauses.append(f"{listed(names)} {verb(names)} far off, {_sizes(ranking, far)}")
    if clauses:
        yield f"{'; '.join(clauses)}."
    # Step 3: why this is not tested.
    names_by_reason = _names_by_reason(ranking)
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


def _distance(ranking: Ranking, rival: Rival) -> float:
    """Return a filter's error over that of the best; for a score, the best density over the filter's.

    A log score is the logarithm of a density. The result is infinite if the best error is zero.
    """
    value = rival.difference.value
    if ranking.metric.definition.is_score:
        return exp(min(abs(value), _MOST_NATS))
    ratio = rival.comparison.ratio.value
    return ratio if isfinite(ratio) else inf


def _within(ranking: Ranking, rival: Rival) -> str:
    """Write within what factor of the best an error is, or within how many nats a score.

    The text is ``within 1 %``, ``within a factor of 1.24`` or ``within 0.31 nats``. The factor is the
    ratio as the ranking's table has it, rounded alike.
    """
    if ranking.metric.definition.is_score:
        return f"within {phrases.rounded(abs(rival.difference.value), 2)} nats"
    # At least 1, as the rival is behind the best in the order, and less is better of every error.
    multiple_of_best = _distance(ranking, rival)
    if multiple_of_best < _WITHIN_ONE_PERCENT:
        return "within 1 %"
    return f"within a factor of {phrases.multiple(multiple_of_best, inf)}"


def _sizes(ranking: Ranking, rivals: Sequence[Rival]) -> str:
    """Write how far filters are from the best: ``at 55.9 times``; ``3.2 and 4 nats below``."""
    if ranking.metric.definition.is_score:
        nats = [phrases.rounded(abs(rival.difference.value), 2) for rival in rivals]
        return f"{listed(nats)} nats below"
    ratios = [_distance(ranking, rival) for rival in rivals]
    # Without the width of an interval a ratio has three digits.
    texts = [phrases.multiple(ratio, width=inf) for ratio in ratios if isfinite(ratio)]
    # A ratio is infinite if the error of the best is zero. Then all of them are.
    if len(texts) < len(ratios):
        return "as the error of the best is zero"
    return f"at {listed(texts)} times its error"


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

    It names two other filters at most, and is empty if there is none. ``ranking`` is the only one by its
    metric, that of the only scenario in the results.
    """
    # Words of the other metrics, by the name of the filter that is best by them.
    metrics_by_leader: dict[str, list[str]] = {}
    for metric in ranking_metrics(results):
        if metric == ranking.metric.metric:
            continue
        for other in rankings(results, metric):  # one ranking, as there is one scenario
            # Another filter is best by this metric, and the best by the first metric is worse than it.
            worse = [rival.filter.name for rival in other.worse]
            if other.best and ranking.best and ranking.best.name in worse:
                words = metric_words(other.metric)
                metrics_by_leader.setdefault(other.best.name, []).append(words)
    parts = [f"by {listed(words)} {name} is better" for name, words in metrics_by_leader.items()]
    if not parts:
        return ""
    return f"But {', and '.join(parts[:2])}."
