"""Tables of a suite, for the screen and the page."""

from collections.abc import Sequence
from math import isfinite, isnan

from trackbench.errors import counted
from trackbench.report.findings.phrases import percent
from trackbench.report.markdown_table import Text, TextTable
from trackbench.report.rounded_numbers import rounded
from trackbench.report.suite.score_words import (
    NEAR,
    collapsed_note,
    fails,
    indefinite_text,
    is_best,
    is_overconfident,
    ratio_in_words,
    undecided_words,
)
from trackbench.report.suite.scores import (
    BEST,
    FILTER,
    SMOOTHER,
    WORST,
    Score,
    SuiteScores,
    ordered_labels,
    relative_costs,
    typical_ratio_where_run,
    typical_ratios,
)
from trackbench.report.suite.tuning_hints import tuning_note
from trackbench.statistics.indefinite_covariances import (
    INDEFINITE_NOTE,
    NOT_DEFINITE,
)
from trackbench.statistics.significance_rules import FEWEST_RUNS, TINY


def roster_table(group: SuiteScores) -> TextTable:
    """Tabulate the filters over all problems, the best first."""
    typical = typical_ratios(group)
    costs = relative_costs(group)
    number = len({score.problem for score in group.of_role(FILTER)})
    heads = ["Filter", "Typical ratio", "Where it ran", "Within 10 %", "Within 2 x", "Best at"]
    heads += ["Fails at", "Overconfident at", "Not run at", "CPU time"]
    problems = counted(number, "problem")
    # Problems on which no filter of the user runs are not computed at all.
    if group.not_computed:
        all_problems = {score.problem for score in group.not_computed} | {*group.problems}
        problems = f"{number} of {counted(len(all_problems), 'problem')}"
    table = TextTable(f"{group.title}: {problems}", heads)
    for label in ordered_labels(group):
        # Numbers of problems, with an error of the filter or without.
        scores = [score for score in group.of_role(FILTER) if score.label == label]
        with_error = [score for score in scores if score.has_error]
        left_out = sum(score.is_left_out for score in scores)
        near = sum(score.limited_ratio <= NEAR for score in with_error)
        within = sum(score.limited_ratio <= 2.0 for score in with_error)
        first = sum(is_best(score) for score in with_error)
        failing = sum(fails(score) for score in scores)
        overconfident = sum(is_overconfident(score) or score.indefinite > 0 for score in with_error)
        # Not so of a filter without covariance.
        is_judged = any(score.consistency or not isnan(score.anees) for score in with_error)
        cost = costs.get(label)
        where_run = typical_ratio_where_run(group, label)
        # The second field of a text is the number by which the page sorts.
        table.rows.append(
            [
                Text(label),
                Text(f"{typical[label]:.2f}", typical[label]),
                Text(f"{where_run:.2f}" if isfinite(where_run) else "–", where_run),
                Text(str(near), near),
                Text(str(within), within),
                Text(str(first), first),
                Text(str(failing), failing),
                Text(str(overconfident), overconfident) if is_judged else Text("–"),
                Text(str(left_out), left_out),
                Text("–" if cost is None else f"{cost:.3g} x", cost),
            ]
        )
    definite = ""
    if any(score.indefinite for score in group.of_role(FILTER)):
        definite = f", or {NOT_DEFINITE} in some"
    table.notes = [
        "Typical ratio: geometric mean over the problems of the error over that of the problem's best "
        "filter. A ratio counts as 10 at most, and a filter that cannot be run, or loses significantly "
        "more runs than another, as 10. Where it ran: the same without the problems that the filter "
        "cannot be run on; filters that ran on different problems cannot be compared by it.",
        "Best, Within 10 %, Within 2 x: by the errors of these runs, significant or not.",
        f"Fails: {WORST:g} times the error of the best filter or more, or all runs lost, or "
        "significantly more than another filter loses, or an exception.",
        "Overconfident: its covariance is too small, in all runs together, or in some by far (collapsed "
        f"runs){definite}. CPU time: median of its ratio to the fastest filter. That of a program "
        "includes the exchange of lines with it, some microseconds a step.",
    ]
    table.notes += tuning_note(group)
    return table


def smoother_table(group: SuiteScores) -> TextTable | None:
    """Tabulate each smoother's error divided by that of its filter; None without any such ratio."""
    smoothers = group.of_role(SMOOTHER)
    if not smoothers:
        return None
    filters = {(score.problem, score.label): score for score in group.of_role(FILTER)}
    table = TextTable(
        "Smoothers", ["Problem", "Smoother", "Error", "Error / its filter's", "Lost runs"]
    )
    for score in smoothers:
        filter_score = filters.get((score.problem, score.label.removesuffix(", smoothed")))
        if not score.has_error or filter_score is None or not filter_score.has_error:
            continue
        ratio = score.error / filter_score.error
        table.rows.append(
            [
                Text(score.problem),
                Text(score.label),
                Text(rounded(score.error, score.stderr, 4), number=score.error),
                Text(f"{ratio:.3g} x", number=ratio),
                Text(str(score.lost), number=score.lost),
            ]
        )
    if not table.rows:
        return None
    return table


def filter_table(groups: Sequence[SuiteScores], label: str) -> TextTable:
    """Tabulate one filter's scores, a row a problem, with notes on the words that occur."""
    heads = ["Problem", "Error", "Ratio to the best (95 %)", "Lost runs", "ANEES", "Consistency"]
    table = TextTable(f"{label}, problem by problem", heads)
    scores = [score for group in groups for score in group.scores if score.label == label]
    table.rows += map(_score_row, scores)
    ratios = " ".join(ratio_in_words(score) for score in scores if score.has_error)
    words_on_consistency = " ".join(score.consistency for score in scores)
    if any(score.word == BEST for score in scores):
        table.notes.append("best: the smallest error of these runs, significant or not.")
    if "n.s." in ratios:
        table.notes.append("n.s.: no significant difference from the best filter of the problem.")
    if "tiny" in ratios:
        table.notes.append(
            f"tiny: significantly different from the best, but at most {percent(TINY)}."
        )
    if "undecided" in ratios:
        table.notes.append(
            f"{undecided_words(scores)}: the ratio is above {NEAR:g}, but the runs do not decide by "
            "the test over all pairs of filters whether the filter is worse than the best. More runs "
            "may: leave "
            "out --quick, or raise --runs. An interval is of its pair alone, and left out where it "
            "excludes 1."
        )
    if "untested" in ratios:
        table.notes.append(
            f"untested: with fewer than {FEWEST_RUNS} runs no difference from the best filter is tested."
        )
    anees_note = "ANEES: squared error over the covariance, per component; 1 is consistent."
    if any(score.has_error and not isfinite(score.anees) for score in scores):
        anees_note += (
            " –: the filter gives no covariance, or the problem has no truth of the whole state."
        )
    table.notes.append(anees_note)
    if "undecided" in words_on_consistency:
        table.notes.append(
            "undecided: these few runs do not show by a test that the ANEES differs from 1, nor that it "
            "is near 1. Even a large ANEES may be undecided: look at it. The test is over all filters "
            "of a problem, so that the word may change with the roster."
        )
    if "collapsed" in words_on_consistency:
        table.notes.append(collapsed_note(scores))
    indefinite = [indefinite_text(score) for score in scores if score.indefinite]
    if indefinite:
        table.notes.append(f"Covariance {NOT_DEFINITE}: {'; '.join(indefinite)}. {INDEFINITE_NOTE}")
    return table


def _score_row(score: Score) -> list[Text]:
    """Write the cells of one score: problem, error, ratio to the best, lost runs, ANEES, consistency.

    A cell has the number by which the page sorts its column.
    """
    ratio = score.ratio_to_best
    if score.has_error:
        error = rounded(score.error, score.stderr, 4)
        ratio_or_reason = ratio_in_words(score)
    else:
        error = "–"
        ratio_or_reason = score.reason
    lost = f"{score.lost} of {score.runs}" if score.lost else "0"
    if score.is_left_out or score.has_raised:
        lost = "–"
    anees = "–"
    if isfinite(score.anees):
        anees = rounded(score.anees, score.anees_stderr, 3)
    return [
        Text(score.problem),
        Text(error, number=score.error),
        Text(ratio_or_reason, number=ratio.value),
        Text(lost, number=score.lost),
        Text(anees, number=score.anees),
        Text(score.consistency or "–"),
    ]
