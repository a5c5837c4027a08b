"""Filter that is first over the problems of a suite: whether that depends on the runs or on a class."""

from dataclasses import dataclass

import numpy as np

from trackbench.errors import counted
from trackbench.report.findings.phrases import joined, named
from trackbench.report.suite.scores import FILTER, SuiteScores, typical_ratios

_FEW_RUNS = 20
"""Runs below which a sentence is called preliminary."""
_MOST_RIVALS = 3
"""Filters that the sentence names as first with other runs."""


@dataclass(frozen=True, kw_only=True)
class Leader:
    """Filter that is first over the problems, and whether that depends on the runs or on a class."""

    label: str
    typical_ratio: float
    low: float
    """95 % interval of the typical ratio over resampled runs"""
    high: float
    share_first: float
    """share of the resamplings of the runs in which it is first"""
    rivals: tuple[str, ...]
    """filters that are first in the other resamplings, at most three"""
    without: dict[str, str]
    """filter that is first when a class is left out, by class, where it is another one"""
    classes: int
    """number of classes of problems"""

    @property
    def is_robust(self) -> bool:
        """True if it is first in 95 % of the resamplings, and without any one of several classes."""
        return self.share_first >= 0.95 and not self.without and self.classes > 1


def leader_of(group: SuiteScores) -> Leader | None:
    """Find the filter with the smallest typical ratio; None if the group has no problem.

    A typical ratio is the geometric mean over the problems of a filter's error over that of the
    problem's best filter. Also find which filter would be first over resampled runs, and without each
    class of problems.
    """
    typical = typical_ratios(group)
    if not typical:
        return None
    labels = [*typical]
    first = min(typical, key=lambda label: typical[label])
    # With other runs: the logarithm of each filter's typical ratio, (resamplings, labels), its mean over
    # the problems, and in which share of the resamplings it is first.
    logs = np.log(group.resampled).mean(axis=2)
    low, high = np.exp(np.quantile(logs[:, labels.index(first)], [0.025, 0.975]))
    is_first = logs <= logs.min(axis=1, keepdims=True)
    shares = dict(zip(labels, is_first.mean(axis=0).tolist(), strict=True))
    others = sorted((label for label in labels if label != first), key=lambda label: -shares[label])
    rivals = tuple(label for label in others[:_MOST_RIVALS] if shares[label] > 0.0)
    # Without each class of problems, if there are several: another filter that is first then.
    classes = list(dict.fromkeys(group.classes.values()))
    without = {}
    if len(classes) > 1:
        for name in classes:
            rest = typical_ratios(group, without_class=name)
            best = min(rest, key=lambda label: rest[label])
            if rest[best] < rest[first]:
                without[name] = best
    return Leader(
        label=first,
        typical_ratio=typical[first],
        low=float(low),
        high=float(high),
        share_first=shares[first],
        rivals=rivals,
        without=without,
        classes=len(classes),
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
    # A score has fewer runs than the others only if it has none, as that of a filter that is left out.
    runs = max(score.runs for score in group.scores)
    these_problems = f"these {number} problems" if number > 1 else "this problem"
    few = ""
    if runs < _FEW_RUNS:
        few = f" Preliminary: {counted(runs, 'run')}."
    name = named(leader.label)
    ratio = (
        f"smallest typical ratio, {leader.typical_ratio:.2f} ({leader.low:.2f} to {leader.high:.2f} "
        "over resampled runs)"
    )
    if leader.is_robust:
        return (
            f"{group.title}: over {these_problems} {name} comes first with the {ratio}. "
            f"It is first in {100.0 * leader.share_first:.0f} % of the resampled runs, and without any "
            f"one of the {leader.classes} classes of problems. Other problems may decide otherwise.{few}"
        )
    reasons = []
    if leader.share_first < 0.95:  # the limit of `Leader.is_robust`
        reasons.append(
            f"with other runs {joined(map(named, leader.rivals))} may be first "
            f"({name} is in {100.0 * leader.share_first:.0f} %)"
        )
    # `without` has the filter that is first without a class, for each class where it is another one.
    for problem_class, label in leader.without.items():
        reasons.append(f"without the class {problem_class} it is {named(label)}")
    if leader.classes < 2:
        reasons.append("all problems are of one class")
    return (
        f"{group.title}: no filter is the best over {these_problems}. {name} has the "
        f"{ratio}; {'; '.join(reasons)}.{few}"
    )
