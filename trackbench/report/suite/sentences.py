"""Sentences of a suite: on each of the user's filters, and on the filter that is first."""

from collections.abc import Sequence
from math import isfinite

from trackbench.errors import counted
from trackbench.report.findings.phrases import joined
from trackbench.report.suite.scores import (
    FILTER,
    LOSES_MORE,
    WORST,
    Likeness,
    Score,
    SuiteScores,
    leader_of,
    nearest_filter,
    typical_ratio_where_run,
    typical_ratios,
)
from trackbench.report.suite.tables import (
    fails,
    indefinite_text,
    is_best,
    is_open,
    is_overconfident,
)
from trackbench.statistics.indefinite_covariances import NOT_DEFINITE
from trackbench.statistics.significance_rules import WORSE

_ALIKE = 0.25
"""Largest relative difference of a run's errors, typical of the problems, of filters that are alike."""
_FEW_RUNS = 20
"""Runs below which a sentence is called preliminary."""


def filter_sentences(group: SuiteScores, label: str) -> list[str]:
    """Return sentences on one filter: where it ran, where it is best or fails, and what it resembles."""
    scores = [score for score in group.of_role(FILTER) if score.label == label]
    run = [score for score in scores if not score.is_left_out]
    # Problems that are not computed are those on which no filter of the user runs.
    number = len(scores) + sum(score.label == label for score in group.not_computed)
    lines = [f"{group.title}: {label} ran on {len(run)} of {counted(number, 'problem')}."]
    if not run:
        return lines
    if len(group.labels(FILTER)) > 1:
        lines.append(_typical_ratio_sentence(group, label, len(run), len(scores)))
        lines += _first_sentences(group, run)
    failing = [score.problem for score in run if fails(score)]
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
    lines += _tuning_sentences(group, label, [score.problem for score in run])
    likeness = nearest_filter(group, label)
    if likeness is not None:
        lines.append(_likeness_sentence(likeness))
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
        # Words of other filters compare with the best one, which this filter is, or which it equals.
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


def _tuning_sentences(group: SuiteScores, label: str, problems: Sequence[str]) -> list[str]:
    """Return sentences on the problems where only the roster is tuned, or only the user's own filter.

    ``problems`` are those that the user's own filter ran on.
    """
    roster = [other for other in group.labels(FILTER) if other not in group.added]
    if not roster:  # all filters are the user's own
        return []
    unfair_to_own = []
    unfair_to_roster = []
    for problem in problems:
        tuned = group.tuned.get(problem, ())
        is_roster_tuned = any(other in tuned for other in roster)
        if is_roster_tuned and label not in tuned:
            unfair_to_own.append(problem)
        if label in tuned and not is_roster_tuned:
            unfair_to_roster.append(problem)
    lines = []
    if unfair_to_own:
        place = _on_problems(unfair_to_own, problems)
        lines.append(
            f"The filters of the roster are tuned {place}, and yours is not: --set "
            f"'groups.{group.group}.tune.{label}={{KEY: log:LOW..HIGH}}' tunes a key of it."
        )
    if unfair_to_roster:
        place = _on_problems(unfair_to_roster, problems)
        lines.append(f"Your filter is tuned {place}, and those of the roster are not.")
    return lines


def _on_problems(chosen: Sequence[str], problems: Sequence[str]) -> str:
    """Return ``on each problem`` if all ``problems`` are chosen, or the names of the chosen ones."""
    if len(chosen) == len(problems):
        return "on each problem"
    return f"on {joined(chosen)}"


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
    return (
        f"Its typical ratio to the best filter is {typical_ratio_where_run(group, label):.2f} where it "
        f"ran, and {typical:.2f} over all {problems} problems here, of which one that it cannot run on "
        f"counts as {WORST:g}, as a failure does."
    )


def _likeness_sentence(likeness: Likeness) -> str:
    """Return the sentence on the filter of the roster that a filter equals, or is nearest to."""
    number = len(likeness.differences)
    # Step 1: equal on all problems.
    if not likeness.others:
        name = likeness.label
        if likeness.also:
            name += f", which equals {joined(likeness.also)} there"
        return (
            f"It is the {name}: the errors of every run agree to 1e-6 on all problems "
            f"that both ran on ({number})."
        )
    # Step 2: equal on some problems. A difference is infinite if only one of the two lost some run.
    largest = max(likeness.differences.values())
    apart = f"by up to {100.0 * largest:.2g} %" if isfinite(largest) else "in which runs are lost"
    if likeness.same:
        return (
            f"On {len(likeness.same)} of {number} problems it is the {likeness.label}: the errors of "
            f"every run agree to 1e-6. On {joined(likeness.others)} they differ {apart}. Where a "
            "filter diverges, or the system is chaotic, rounding alone can grow so much."
        )
    # Step 3: near, or like no filter.
    place = "on half of the problems" if number > 1 else f"on {likeness.others[0]}"
    if likeness.typical_difference <= _ALIKE:
        return (
            f"The nearest filter is {likeness.label}: the errors of a run differ by up to "
            f"{100.0 * likeness.typical_difference:.2g} % {place}."
        )
    return (
        f"No filter of the roster resembles it: {place} the error of some run differs by more than "
        f"{100.0 * _ALIKE:.0f} % from that of each of them, or only one of the two loses the run."
    )


def leader_sentence(group: SuiteScores) -> str:
    """Return the sentence on the filter that is first over the problems, and on what that depends.

    It is empty with fewer than two filters.
    """
    if len(group.labels(FILTER)) < 2:
        return ""
    leader = leader_of(group)
    if leader is None:
        return ""
    number = len({score.problem for score in group.of_role(FILTER)})
    runs = max(score.runs for score in group.scores)
    these_problems = f"these {number} problems" if number > 1 else "this problem"
    few = ""
    if runs < _FEW_RUNS:
        few = f" Preliminary: {runs} runs."
    ratio = (
        f"smallest typical ratio, {leader.typical_ratio:.2f} ({leader.low:.2f} to {leader.high:.2f} "
        "over resampled runs)"
    )
    if leader.is_robust:
        return (
            f"{group.title}: over {these_problems} {leader.label} comes first with the {ratio}. "
            f"It is first in {100.0 * leader.share_first:.0f} % of the resampled runs, and without any "
            f"one of the {leader.classes} classes of problems. Other problems may decide otherwise.{few}"
        )
    reasons = []
    if leader.share_first < 0.95:  # the limit of `Leader.is_robust`
        reasons.append(
            f"with other runs {joined(leader.rivals)} may be first "
            f"({leader.label} is in {100.0 * leader.share_first:.0f} %)"
        )
    for name, label in leader.without.items():
        reasons.append(f"without the class {name} it is {label}")
    if leader.classes < 2:
        reasons.append("all problems are of one class")
    return (
        f"{group.title}: no filter is the best over {these_problems}. {leader.label} has the "
        f"{ratio}; {'; '.join(reasons)}.{few}"
    )
