"""Words on a filter's score on a problem: best, near the best, undecided, fails, overconfident."""

from collections.abc import Sequence
from math import isfinite

from trackbench.errors import counted
from trackbench.report import rounded_numbers
from trackbench.report.findings.candidates import Candidate
from trackbench.report.findings.phrases import joined
from trackbench.report.findings.ranking import Ranking
from trackbench.report.suite.scores import BEST, LOSES_MORE, WORST, Score
from trackbench.statistics.collapsed_runs import COLLAPSED_NOTE
from trackbench.statistics.indefinite_covariances import indefinite_in_words
from trackbench.statistics.significance_rules import ALIKE, BETTER, TINY, UNTESTED, WORSE

NEAR = 1.1
"""Factor within which a filter is near the best."""
_ROUNDING_OF_RATIOS = 1e-5
"""Width of an interval of equal errors: each of its ends is found to 1e-6."""


def is_best(score: Score) -> bool:
    """Test whether a filter has the smallest error of its problem, alone or with an equal one.

    Its ``limited_ratio`` is then 1, but for rounding.
    """
    return score.has_error and score.limited_ratio <= 1.0 + 1e-9


def fails(score: Score) -> bool:
    """Test whether a filter counts as useless for a problem on which it was run.

    Its error is `WORST` times that of the best filter or more, or it loses all runs, or significantly
    more runs than another filter, or it raises an exception.
    """
    return not score.is_left_out and score.limited_ratio >= WORST


def is_open(score: Score) -> bool:
    """Test whether the runs do not decide about a filter that is not near the best."""
    return score.word == ALIKE and score.ratio_to_best.value > NEAR


def undecided_words(scores: Sequence[Score]) -> str:
    """Return ``undecided (8 runs)``, or ``undecided (N runs)`` if the undecided scores differ in runs.

    A score is undecided by `is_open`.
    """
    numbers = {score.runs for score in scores if score.has_error and is_open(score)}
    if len(numbers) == 1:
        return f"undecided ({counted(numbers.pop(), 'run')})"
    return "undecided (N runs)"


def is_overconfident(score: Score) -> bool:
    """Test whether a filter's covariance is too small, in all runs together or in some by far."""
    return score.consistency == "overconfident" or score.collapsed > 0


def indefinite_text(score: Score) -> str:
    """Return where a covariance is not positive definite: ``on x in 4 of 8 runs, first at step 63``."""
    words = indefinite_in_words(
        score.indefinite,
        runs=score.runs,
        lost=score.lost,
        first_step=score.first_indefinite_step,
    )
    return f"on {score.problem} {words}"


def ratio_in_words(score: Score) -> str:
    """Write the ratio to the best with its interval, ``1.2 x (1.1 to 1.4)``, and the rule's word.

    The word is ``n.s.``, ``undecided (8 runs)`` (also not significant, at a ratio above `NEAR`),
    ``untested`` or ``loses more runs``. A filter that is significantly worse has none, or ``tiny`` if it
    is worse by less than the share `TINY`. The best filter is ``best``, without a ratio, and another
    with the same errors ``equal to the best``.
    """
    ratio = score.ratio_to_best
    width = ratio.high - ratio.low
    if score.word == BEST:  # the first filter of the ranking alone
        return "best"
    # Another filter is among the best by `is_best` if its ratio is 1 or less, as with equal errors. If
    # the interval has no width but that of rounding, the errors are equal in every run.
    if is_best(score) and width < _ROUNDING_OF_RATIOS:
        return "equal to the best"
    text = f"{rounded_numbers.multiple(ratio.value, width)} x"
    # Beside "no significant difference" no interval of the pair alone may show one.
    contradicts = score.word == ALIKE and not ratio.low <= 1.0 <= ratio.high
    if isfinite(width) and ratio.low <= 0.0:
        text += f" (at most {rounded_numbers.multiple(ratio.high, width)})"
    elif isfinite(width) and not contradicts:
        low = rounded_numbers.multiple(ratio.low, width)
        high = rounded_numbers.multiple(ratio.high, width)
        text += f" ({low} to {high})"
    alike = " n.s."
    if is_open(score):
        alike = f", {undecided_words([score])}"
    words = {ALIKE: alike, LOSES_MORE: ", loses more runs", UNTESTED: " untested"}
    if score.word in (WORSE, BETTER) and abs(ratio.value - 1.0) < TINY:
        return f"{text} tiny"
    return text + words.get(score.word, "")


def word_of_score(ranking: Ranking, candidate: Candidate) -> str:
    """Return how the filter compares with the best, as the ranking decides it.

    It is `LOSES_MORE`, `BEST`, `UNTESTED`, `WORSE` or `BETTER` (significantly), or `ALIKE` (no
    significant difference). A filter can be better than the first of the ranking on the runs that
    neither of them loses.
    """
    if candidate in ranking.losing:
        return LOSES_MORE
    if is_first(ranking, candidate):
        return BEST
    comparison = ranking.compared.get(candidate.name)
    if comparison is None or not (comparison.is_tested or comparison.is_equal):
        return UNTESTED
    # The errors of a suite are better if they are lower.
    if comparison.sign > 0:
        return WORSE
    if comparison.sign < 0:
        return BETTER
    return ALIKE


def is_first(ranking: Ranking, candidate: Candidate) -> bool:
    """Test whether a filter is the first of its ranking.

    The ranking of a recording may have a copy of the candidate, over the steps that all filters have.
    """
    return bool(ranking.order) and ranking.order[0].name == candidate.name


def collapsed_note(scores: Sequence[Score]) -> str:
    """Return what a collapsed run is, and on which problems the covariance has no spread at all.

    ``scores`` are those of one filter.
    """
    without_spread = [
        f"{score.problem} in {score.without_spread} of {counted(score.runs, 'run')}"
        for score in scores
        if score.without_spread
    ]
    if not without_spread:
        return f"{COLLAPSED_NOTE} Here the covariance is far too small, but has some spread."
    return (
        f"{COLLAPSED_NOTE} Some covariances have no spread in a direction, as if all particles were at "
        f"one point: on {joined(without_spread)}."
    )
