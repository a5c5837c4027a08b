"""Sentences of a suite on each filter of the user: where it ran, is best or fails, and may also run."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from trackbench.errors import counted
from trackbench.models.component_names import few_names
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

_FEW_PROBLEMS = 0.5
"""Share of the problems up to which a filter runs on few of them."""
_MOST_NAMED = 3
"""States or measurements that a sentence names."""


def filter_sentences(group: SuiteScores, label: str) -> list[str]:
    """Return sentences on one filter: where it ran, where it is best or fails, and what it resembles."""
    scores = [score for score in group.of_role(FILTER) if score.label == label]
    run = [score for score in scores if not score.is_left_out]
    # Problems that are not computed are those on which no filter of the user runs.
    number = len(scores) + sum(score.label == label for score in group.not_computed)
    lines = [f"{group.title}: {named(label)} ran on {len(run)} of {counted(number, 'problem')}."]
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
    lines += tuning_hints(group, label, [score.problem for score in run])
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
    return (
        f"Its typical ratio to the best filter is {typical_ratio_where_run(group, label):.2f} where it "
        f"ran, and {typical:.2f} over all {problems} problems here, of which one that it cannot run on "
        f"counts as {WORST:g}, as a failure does."
    )


@dataclass(frozen=True, kw_only=True)
class ProblemModel:
    """State and measurement of a problem."""

    state: tuple[str, ...]
    """names of the components"""
    measurement: tuple[str, ...]
    """names of the components"""
    is_linear: bool
    """whether both the motion and the sensor are linear"""


def reach_sentence(
    groups: Sequence[SuiteScores],
    label: str,
    is_program: bool,
    models: Mapping[str, ProblemModel],
) -> str:
    """Return which models a filter takes, and how it may run on more problems; empty if it runs on most.

    ``models`` are those of all problems by name. ``is_program`` says that the filter is a program in
    another language, and not a Python class. The problems of ``groups`` that are not computed, as no
    filter of the user fits them, count as problems that the filter cannot run on.
    """
    scores = []
    for group in groups:
        for score in (*group.of_role(FILTER), *group.not_computed):
            if score.label == label:
                scores.append(score)
    fitted = [models[score.problem] for score in scores if not score.is_left_out]
    others = [models[score.problem] for score in scores if score.is_left_out]
    if len(fitted) > _FEW_PROBLEMS * len(scores):
        return ""
    lines = [f"{named(label)} runs on {len(fitted)} of {counted(len(scores), 'problem')}."]
    lines += _neighbor_sentences(fitted, others)
    if not is_program:
        lines.append(
            "A filter that takes its model as functions runs on nearly all: `trackbench new filter NAME "
            "--per-run --nonlinear` writes one."
        )
    elif any(model.is_linear for model in fitted) or not fitted:
        lines.append(
            "A program that takes F, Q, H and R from its first line runs on every linear problem: "
            "`trackbench new filter NAME --language c` writes one. `motion` and `sensors` on that "
            "line have the model of every problem: docs/any-language.md."
        )
    else:
        lines.append(
            "The first line of the protocol has the components, `motion` and `sensors` of every "
            "problem. A program that finds its own components there by name may run on problems with "
            "further ones: docs/any-language.md. docs/suites.md lists states and measurements."
        )
    return " ".join(lines)


def _neighbor_sentences(
    fitted: Sequence[ProblemModel], others: Sequence[ProblemModel]
) -> list[str]:
    """Return sentences on the state and measurement of the problems that a filter runs on.

    ``fitted`` are the models of these problems, ``others`` those of the problems that it cannot run on.
    One sentence counts the others whose measurement alone a fitted problem has, by their state. Another
    counts those whose state alone a fitted problem has, by their measurement.
    """
    states = {model.state for model in fitted}
    measurements = {model.measurement for model in fitted}
    other_states = Counter(
        few_names(model.state)
        for model in others
        if model.measurement in measurements and model.state not in states
    )
    other_measurements = Counter(
        few_names(model.measurement)
        for model in others
        if model.state in states and model.measurement not in measurements
    )
    lines = []
    if len(states) == 1 and len(measurements) == 1:
        lines.append(
            f"It takes the state {few_names(*states)} and the measurement {few_names(*measurements)}."
        )
    if other_states:
        number = other_states.total()
        lines.append(
            f"With such a measurement {counted(number, 'problem')} {_have(number)} another state: "
            f"{_most_frequent(other_states)}."
        )
    if other_measurements:
        number = other_measurements.total()
        lines.append(
            f"With such a state {counted(number, 'problem')} {_have(number)} another measurement: "
            f"{_most_frequent(other_measurements)}."
        )
    return lines


def _have(number: int) -> str:
    """Return "has" for one problem and "have" for several."""
    return "has" if number == 1 else "have"


def _most_frequent(names: Counter[str]) -> str:
    """Return the most frequent names with their numbers: ``x y (7), bearing (1) and 2 more``.

    ``names`` has the number of problems of each name. At the end stands the number of further names.
    """
    texts = [f"{name} ({number})" for name, number in names.most_common(_MOST_NAMED)]
    rest = len(names) - len(texts)
    if rest:
        texts.append(f"{rest} more")
    return joined(texts)
