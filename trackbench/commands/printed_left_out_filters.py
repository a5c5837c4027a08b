"""Filters of a suite that are left out of problems: lines with the reasons."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from trackbench.config.suite import Suite
from trackbench.errors import counted


class _LeftOut(NamedTuple):
    """A filter that is left out of a problem, with the reason ``why``."""

    label: str
    problem: str
    why: str


def _misfits(suite: Suite) -> list[_LeftOut]:
    """List each filter that is left out of a problem, with the reason; added filters come first.

    The scenario of the problem does not fit the filter, or the filter is a program that refuses it.
    Filters are added by `--filter`, the others are those of the suite's roster. Problems that are not
    computed, because no added filter fits them, are listed for added filters only.
    """
    misfits_of_added = []
    misfits_of_roster = []
    not_computed = {problem.name for problem in suite.without_added}
    for problem in [*suite.problems, *suite.without_added]:
        for label, why in problem.left_out.items():
            left = _LeftOut(label, problem.name, why)
            if label in suite.added:
                misfits_of_added.append(left)
            elif problem.name not in not_computed:
                misfits_of_roster.append(left)
    return misfits_of_added + misfits_of_roster


def left_out_lines(suite: Suite) -> list[str]:
    """Return lines on filters that are left out of problems, one for each filter and reason.

    Lines come first on how many problems added filters run on, and how many problems are not computed.
    """
    return [*_own_filter_lines(suite), *_reason_lines(_misfits(suite))]


def _own_filter_lines(suite: Suite) -> Iterator[str]:
    """Yield a line for each filter of `--filter` that runs on some problems only, with their number.

    A last line has the number of problems that are not computed, if any.
    """
    problems = [*suite.problems, *suite.without_added]
    for label in suite.added:
        number = sum(label not in problem.left_out for problem in problems)
        if number < len(problems):
            yield f"{label} runs on {number} of {len(problems)} problems"
    if suite.without_added:
        yield (
            f"{counted(len(suite.without_added), 'problem')} on which no filter of yours runs are not "
            "computed; `--problem NAME` computes one"
        )


def _reason_lines(misfits: Sequence[_LeftOut]) -> Iterator[str]:
    """Yield a line for each filter and reason why it is left out of problems."""
    problems: dict[tuple[str, str], list[str]] = {}
    for left in misfits:
        problems.setdefault((left.label, left.why), []).append(left.problem)
    for (label, why), names in problems.items():
        yield f"{label} is left out of {', '.join(names)}: {why}"


_MOST_REASONS = 3
"""Number of reasons that are printed for one filter; if it has more, an example is printed."""


def left_out_notes(suite: Suite) -> Iterator[str]:
    """Yield `left_out_lines` for the screen.

    A filter with many reasons to be left out has one line, with one of the reasons.
    """
    yield from _own_filter_lines(suite)
    misfits = _misfits(suite)
    for label in dict.fromkeys(left.label for left in misfits):
        filter_misfits = [left for left in misfits if left.label == label]
        lines = [*_reason_lines(filter_misfits)]
        if len(lines) <= _MOST_REASONS:
            yield from lines
        else:
            example = filter_misfits[0]
            yield (
                f"{label} is left out of {len(filter_misfits)} problems, such as {example.problem}: "
                f"{example.why}; --dry-run and scores.csv have all reasons"
            )
