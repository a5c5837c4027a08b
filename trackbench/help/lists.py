"""Lists that `trackbench list` prints: groups, kinds of a group, experiments, standard problems, suites.

A listing reads docstrings without importing what it lists.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, cast

from trackbench.durations import listed_time_in_words
from trackbench.help.descriptions import paragraphs
from trackbench.help.metrics import JsonRow, columns, common_metrics, facts, statistics_known
from trackbench.metrics import METRICS
from trackbench.registry import GROUPS, Group, documentation


def listing(group: str) -> str:
    """List the kinds of a group with the first paragraph of their documentation."""
    docs = documentation(cast(Group, group))
    rows = columns((kind, paragraphs(doc)[0]) for kind, doc in docs.items())
    return "\n".join([f"{group}:", *rows])


def groups_with_counts() -> str:
    """List the groups of what a config may name, with their numbers of members and the first five."""
    from trackbench.config.shipped_experiments import names

    known: dict[str, list[str]] = {group: list(documentation(group)) for group in GROUPS}
    known["metrics"] = common_metrics()
    known["experiments"] = names()
    rows = []
    for group, group_names in known.items():
        number = len(group_names)
        if group == "metrics":
            number = len(METRICS)  # the names are the common ones alone
        # Five names and dots. The slice drops the dots if there are no more than five names.
        first_names = ", ".join([*group_names[:5], "..."][:number])
        rows.append((group, f"{number:>3}", first_names))
    return "\n".join(["groups (trackbench list GROUP):", *columns(rows)])


def experiments() -> str:
    """List the shipped experiments grouped by paper, with their run times."""
    from itertools import groupby

    from trackbench.config.shipped_experiments import listed

    # Experiments without a paper come last.
    shipped = sorted(listed(), key=lambda entry: (not entry.paper, entry.paper, entry.name))
    width = max(len(entry.name) for entry in shipped)
    lines = ["experiments (trackbench run NAME; time on one processor):"]
    for paper, entries_of_paper in groupby(shipped, key=lambda entry: entry.paper):
        lines.append(f"\n  {paper or 'Beyond the papers'}")
        for entry in entries_of_paper:
            time = listed_time_in_words(entry.cpu_s)
            lines.append(f"    {entry.name:<{width}}  {time:>6}  {entry.title}")
    return "\n".join(lines)


def problems() -> str:
    """List the standard problems with their versions, published numbers, references and times."""
    from trackbench.config.shipped_problems import problems

    rows = [("name", "version", "numbers", "time", "reference", "title")]
    for problem in problems():
        rows.append(
            (
                problem.name,
                f"v{problem.version}",
                str(problem.numbers),
                listed_time_in_words(problem.cpu_s),
                problem.reference,
                problem.title,
            )
        )
    heading = "standard problems (trackbench run NAME; cited as trackbench/NAME vVERSION, N runs;"
    return "\n".join([f"{heading} time on one processor):", "", *columns(rows)])


def suites() -> str:
    """List the shipped suites with their numbers of problems and times."""
    from trackbench.config.shipped_suites import listed_suites

    rows = [("name", "problems", "time", "title")]
    for suite in listed_suites():
        time = listed_time_in_words(suite.cpu_s)
        rows.append((suite.name, str(suite.problems), time, suite.title))
    heading = "suites (trackbench suite NAME; time on one processor):"
    return "\n".join([heading, "", *columns(rows)])


def rows(groups: Sequence[str]) -> Iterator[JsonRow]:
    """Yield a row of JSON for each member of the groups.

    These are registered kinds, metrics, statistics, shipped experiments or suites, or standard problems.
    """
    from trackbench.config.shipped_experiments import listed
    from trackbench.config.shipped_problems import problems
    from trackbench.config.shipped_suites import listed_suites

    # Each returns named tuples, whose fields are the columns.
    entries_of: dict[str, Callable[[], Iterable[Any]]] = {
        "experiments": listed,
        "problems": problems,
        "suites": listed_suites,
    }
    for group in groups:
        if group == "metrics":
            yield from _rows_of_metrics(METRICS)
        elif group == "statistics":
            yield from _rows_of_metrics(statistics_known())
        elif group in entries_of:
            for entry in entries_of[group]():
                yield {"group": group, **entry._asdict()}
        else:
            for kind, doc in documentation(cast(Group, group)).items():
                yield {"group": group, "kind": kind, "text": paragraphs(doc)[0]}


def _rows_of_metrics(words: Iterable[str]) -> Iterator[JsonRow]:
    """Yield a row for each metric or statistic that is documented."""
    for word in words:
        row = facts(word)
        if row:
            yield row
