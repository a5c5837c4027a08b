"""Likeness of a filter to one of the roster: whether their errors agree, run by run."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf, isfinite

import numpy as np

from trackbench.core.arrays import Array
from trackbench.report.findings.phrases import joined, named
from trackbench.report.suite.scores import FILTER, SuiteScores

_ALIKE = 0.25
"""Largest relative difference of a run's errors, typical of the problems, of filters that are alike."""

SAME = 1e-6
"""Relative difference up to which two errors are the same."""


@dataclass(frozen=True, kw_only=True)
class Likeness:
    """Nearness of a filter's errors, run by run, to those of a filter of the roster."""

    label: str
    """of the filter of the roster"""
    differences: dict[str, float]
    """largest relative difference of a run's error, by problem that both were run on"""
    also: tuple[str, ...] = ()
    """further filters whose errors are the same where those of this one are"""

    @property
    def same(self) -> list[str]:
        """Problems on which all errors agree to `SAME`."""
        return [name for name, difference in self.differences.items() if difference <= SAME]

    @property
    def others(self) -> list[str]:
        """Problems on which errors differ."""
        return [name for name, difference in self.differences.items() if not difference <= SAME]

    @property
    def typical_difference(self) -> float:
        """Median of the differences over the problems."""
        return float(np.median([*self.differences.values()]))


def nearest_filter(group: SuiteScores, label: str, problems: Sequence[str]) -> Likeness | None:
    """Find the other filter of the group whose errors, run by run, are nearest to those of ``label``.

    It is returned with the largest relative difference of a run's error on each of the ``problems``.
    None if no other filter has errors on one of these problems that both ran on.
    """
    likenesses = []
    for other in group.labels(FILTER):
        if other == label:
            continue
        differences = {}
        for problem in problems:
            runs = group.runs[problem]
            errors = runs.values.get(label)
            other_errors = runs.values.get(other)
            if errors is None or other_errors is None or len(errors) != len(other_errors):
                continue
            differences[problem] = _largest_difference(errors, other_errors)
        if differences:
            likenesses.append(Likeness(label=other, differences=differences))
    if not likenesses:
        return None
    # The one with the same errors on the most problems; of several the one that is typically nearest.
    nearest = min(
        likenesses, key=lambda likeness: (-len(likeness.same), likeness.typical_difference)
    )
    also = [
        likeness.label
        for likeness in likenesses
        if likeness is not nearest and likeness.same and likeness.same == nearest.same
    ]
    return replace(nearest, also=tuple(also))


def _largest_difference(mine: Array, theirs: Array) -> float:
    """Return the largest relative difference of two filters' errors (M,) in a run.

    Runs that both lost agree. The difference is infinite if only one of the filters lost a run.
    """
    both_lost = ~np.isfinite(mine) & ~np.isfinite(theirs)
    scale = np.maximum(np.abs(mine), np.abs(theirs))
    with np.errstate(all="ignore"):
        relative = np.abs(mine - theirs) / scale
    relative = np.where(both_lost | (mine == theirs), 0.0, relative)
    return float(np.nan_to_num(relative, nan=inf).max(initial=0.0))


def likeness_sentences(group: SuiteScores, label: str) -> list[str]:
    """Return sentences on the filter of the roster that a filter equals, or is nearest to.

    Linear problems on which it equals a filter have a sentence of their own. All kinds of Kalman filters
    are equal there, so that only the other problems show which of them it is.
    """
    sentences = []
    linear = [problem for problem in group.runs if problem in group.linear]
    on_linear = nearest_filter(group, label, linear)
    same_linear: list[str] = []
    if on_linear is not None and on_linear.same:
        same_linear = on_linear.same
        equals = joined(map(named, (on_linear.label, *on_linear.also)))
        noun = "problem" if len(same_linear) == 1 else "problems"
        sentences.append(
            f"On the linear {noun} {joined(same_linear)} it equals {equals}: the "
            "errors of every run agree to 1e-6. Kalman filters of all kinds are equal there, so this "
            "does not show which of them it is."
        )
    others = [problem for problem in group.runs if problem not in same_linear]
    likeness = nearest_filter(group, label, others)
    if likeness is not None:
        sentences.append(_likeness_sentence(likeness, leaves_out_linear=bool(same_linear)))
    return sentences


def _likeness_sentence(likeness: Likeness, leaves_out_linear: bool) -> str:
    """Return the sentence on the filter of the roster that a filter equals, or is nearest to.

    ``leaves_out_linear`` is True if the likeness leaves out linear problems, which have a sentence
    of their own.
    """
    number = len(likeness.differences)
    kind = "other " if leaves_out_linear else ""
    name = named(likeness.label)
    equal_name = name
    if likeness.also:
        equal_name += f", which equals {joined(map(named, likeness.also))} there"
    # Step 1: equal on all problems.
    if not likeness.others:
        return (
            f"It is the {equal_name}: the errors of every run agree to 1e-6 on all {kind}problems "
            f"that both ran on ({number})."
        )
    # Step 2: equal on some problems. A difference is infinite if only one of the two lost some run.
    largest = max(likeness.differences.values())
    apart = f"by up to {100.0 * largest:.2g} %" if isfinite(largest) else "in which runs are lost"
    if likeness.same:
        return (
            f"On {len(likeness.same)} of {number} {kind}problems it is the {equal_name}: the errors of "
            f"every run agree to 1e-6. On {joined(likeness.others)} they differ {apart}. Where a "
            "filter diverges, or the system is chaotic, rounding alone can grow so much."
        )
    # Step 3: near, or like no filter.
    place = f"on half of the {kind}problems" if number > 1 else f"on {likeness.others[0]}"
    if likeness.typical_difference <= _ALIKE:
        return (
            f"The nearest filter is {name}: the errors of a run differ by up to "
            f"{100.0 * likeness.typical_difference:.2g} % {place}."
        )
    return (
        f"No filter of the roster resembles it: {place} the error of some run differs by more than "
        f"{100.0 * _ALIKE:.0f} % from that of each of them, or only one of the two loses the run."
    )
