"""Problems of a suite that a filter can run on: which models it takes, and how it may run on more."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from trackbench.errors import counted
from trackbench.models.component_names import few_names
from trackbench.report.findings.phrases import joined, named
from trackbench.report.suite.scores import FILTER, SuiteScores

_FEW_PROBLEMS = 0.5
"""Share of the problems up to which a filter runs on few of them."""
_MOST_NAMED = 3
"""States or measurements that a sentence names."""


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
