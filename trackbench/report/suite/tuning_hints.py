"""Hints on tuning in a suite: where only the roster or the user's filter is tuned, or gets worse."""

from collections.abc import Sequence

from trackbench.report.findings.phrases import joined
from trackbench.report.suite.scores import FILTER, SuiteScores
from trackbench.statistics.holm_correction import as_family


def tuning_hints(group: SuiteScores, label: str, problems: Sequence[str]) -> list[str]:
    """Return sentences on the problems where tuning is unfair, or makes the user's own filter worse.

    It is unfair if only the roster is tuned, or only the user's own filter. ``problems`` are those that
    this filter ran on.
    """
    return [*_unfair_hints(group, label, problems), *_worse_hints(group, label)]


def _worse_hints(group: SuiteScores, label: str) -> list[str]:
    """Return a sentence on the problems where the tuned filter is significantly worse than untuned.

    The list is empty if there are none.
    """
    gains = {
        problem: runs.gains[label] for problem, runs in group.runs.items() if label in runs.gains
    }
    # The comparisons of all problems are tested together.
    worse = [problem for problem, gain in as_family(gains).items() if gain.sign > 0]
    if not worse:
        return []
    errors = [
        f"{problem} ({gains[problem].a.value:.4g} in place of {gains[problem].b.value:.4g})"
        for problem in worse
    ]
    return [
        f"Tuning makes it significantly worse on {joined(errors)}. More trials or a narrower range may "
        f"help. The search begins at the value of --set filters.{label}.KEY=VALUE, or without it in the "
        "middle of the range."
    ]


def _unfair_hints(group: SuiteScores, label: str, problems: Sequence[str]) -> list[str]:
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
