"""Sentences of a suite on each filter of the user: where it ran, is best or fails."""

from collections.abc import Sequence

from trackbench.errors import counted
from trackbench.report.findings.phrases import joined, named
from trackbench.report.suite.nearest_filter import likeness_sentences
from trackbench.report.suite.score_words import (
    fails,
    indefinite_text,
    is_best,
    is_open,
    is_overconfident,
)
from trackbench.report.suite.scores import (
    FILTER,
    LOSES_MORE,
    WORST,
    Score,
    SuiteScores,
    typical_ratio_where_run,
    typical_ratios,
)
from trackbench.report.suite.tuning_hints import tuning_hints
from trackbench.statistics.indefinite_covariances import NOT_DEFINITE
from trackbench.statistics.significance_rules import WORSE


def filter_sentences(group: SuiteScores, label: str) -> list[str]:
    """Return sentences on one filter: where it ran, where it is best or fails, and what it resembles."""
    scores = [score for score in group.of_role(FILTER) if score.label == label]
    run = [score for score in scores if not score.is_left_out]
    raised = [score for score in run if score.has_raised]
    # Problems that are not computed are those on which no filter of the user runs.
    number = len(scores) + sum(score.label == label for score in group.not_computed)
    number_run = len(run) - len(raised)
    lines = [f"{group.title}: {named(label)} ran on {number_run} of {counted(number, 'problem')}."]
    if raised:
        # The reason begins with the place in the user's file, and ends with run and step.
        reasons = [f"{score.problem} ({score.reason})" for score in raised]
        lines.append(f"It raised an exception on {joined(reasons)}.")
    if not run:
        return lines
    if len(group.labels(FILTER)) > 1:
        lines.append(_typical_ratio_sentence(group, label, len(run), len(scores)))
        lines += _first_sentences(group, run)
    failing = [score.problem for score in run if fails(score) and not score.has_raised]
    if failing:
        text = (
            f"It fails on {joined(failing)}: its error is {WORST:g} times that of the best filter or "
            "more, or it loses all runs or significantly more than another filter"
        )
        undecided = [score.problem for score in run if fails(score) and is_open(score)]
        if undecided:
            text += f"; on {joined(undecided)} the runs do not yet decide this by a test"
        lines.append(f"{text}.")
    overconfident = [score.problem for score in run if is_overconfident(score)]
    if overconfident:
        lines.append(f"It is overconfident on {joined(overconfident)}.")
    indefinite = [indefinite_text(score) for score in run if score.indefinite]
    if indefinite:
        lines.append(f"Its covariance is {NOT_DEFINITE} {'; '.join(indefinite)}.")
    lines += tuning_hints(group, label, [score.problem for score in run if not score.has_raised])
    lines += likeness_sentences(group, label)
    return lines


def _first_sentences(group: SuiteScores, scores: Sequence[Score]) -> list[str]:
    """Return sentences on the problems where a filter has the smallest error, by its ``scores``.

    Problems where it is significantly smaller than that of every other filter have a sentence of their
    own.
    """
    significant = []
    not_significant = []
    for score in scores:
        if not is_best(score):
            continue
        others = [
            other
            for other in group.of_role(FILTER)
            if other.problem == score.problem and other.label != score.label
        ]
        compared = [other for other in others if not other.is_left_out]
        if not compared:
            continue
        # The word of another filter is that of its comparison with the best filter. That is this one, or
        # has the same error. A filter without an error failed or lost all runs, and counts as worse.
        if all(not other.has_error or other.word in (WORSE, LOSES_MORE) for other in compared):
            significant.append(score.problem)
        else:
            not_significant.append(score.problem)
    lines = []
    if significant:
        place = f"on {joined(significant)}"
        lines.append(f"Its error is significantly smaller than that of every other filter {place}.")
    if not_significant:
        lines.append(
            f"It has the smallest error of these runs on {joined(not_significant)}, but not "
            "significantly: with other runs another filter may have it."
        )
    return lines


def _typical_ratio_sentence(
    group: SuiteScores, label: str, problems_run: int, problems: int
) -> str:
    """Return a sentence on the geometric mean of a filter's ratios to the best filter.

    The filter ran on ``problems_run`` of the ``problems`` that were computed.
    """
    typical = typical_ratios(group)[label]
    if problems_run == problems:
        return (
            f"Its typical ratio to the best filter is {typical:.2f}; a failure counts as {WORST:g}."
        )
    not_run = problems - problems_run
    which = "one that it cannot run on counts"
    if not_run > 1:
        which = f"{not_run} that it cannot run on count"
    return (
        f"Its typical ratio to the best filter is {typical_ratio_where_run(group, label):.2f} where it "
        f"ran, and {typical:.2f} over all {problems} problems here, of which {which} as "
        f"{WORST:g}, as a failure does."
    )
