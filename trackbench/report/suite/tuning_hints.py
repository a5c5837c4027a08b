"""Hints on tuning in a suite: where only the roster is tuned, or only the filter of the user."""

from collections.abc import Sequence

from trackbench.report.findings.phrases import joined
from trackbench.report.suite.scores import FILTER, SuiteScores


def tuning_hints(group: SuiteScores, label: str, problems: Sequence[str]) -> list[str]:
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
