"""The suites that come with the package: found by their names, their problems and recorded times."""

import csv
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from trackbench.config.shipped_folder import SUITES, TIMES, folder
from trackbench.errors import Mark, Problem, UserError


def problems_of_suites(name: str) -> Iterator[tuple[str, dict[str, object]]]:
    """Yield the shipped suites that have a problem of this name, each with the problem's keys."""
    for suite in suite_names():
        for problem_name, problem in all_problems(suite):
            if problem_name == name:
                yield suite, problem


def all_problems(suite: str) -> Iterator[tuple[str, dict[str, object]]]:
    """Yield the problems of a shipped suite, each with its keys."""
    from trackbench.yaml_source import read

    groups = read(suite_file(Path(suite))).data["groups"]
    for group in groups.values():
        yield from group["problems"].items()


def suite_names() -> list[str]:
    """List the shipped suites' names, sorted."""
    return sorted(path.stem for path in (folder() / SUITES).glob("*.yaml"))


def suite_file(suite: Path) -> Path:
    """Find a suite's file: of that path, or else the shipped suite of that name; raises UserError."""
    word = str(suite)
    if suite.is_file() or suite.suffix:
        return suite
    if word in suite_names():
        return folder() / SUITES / f"{word}.yaml"
    from trackbench.config.did_you_mean import unknown

    message = f"is neither a file nor a shipped suite; {unknown(word, suite_names())}"
    raise UserError(Problem(Mark(word), "", message))


class ListedSuite(NamedTuple):
    """A shipped suite as `trackbench list suites` shows it."""

    name: str
    title: str
    problems: int
    """number of problems"""
    cpu_s: float
    """recorded time of all problems on one processor, s"""


def listed_suites() -> list[ListedSuite]:
    """List the shipped suites, sorted by name."""
    from trackbench.yaml_source import read

    suites = []
    for name in suite_names():
        times = suite_times(name).values()
        config = read(suite_file(Path(name))).data
        suites.append(
            ListedSuite(
                name=name,
                title=config["title"],
                problems=sum(len(group["problems"]) for group in config["groups"].values()),
                # The last time of a problem is that of all runs.
                cpu_s=round(sum(times_of_problem[-1].cpu_s for times_of_problem in times), 3),
            )
        )
    return suites


class SuiteTime(NamedTuple):
    """Recorded time of a problem of a shipped suite: seconds on one processor for so many runs.

    They include the tuning of the roster, which `--quick` shortens.
    """

    runs: int
    cpu_s: float


def suite_times(name: str) -> dict[str, list[SuiteTime]]:
    """Return the recorded times of a shipped suite's problems by name; empty for another suite.

    Those of a problem are sorted by runs: the first is that of `--quick`, the last that of the suite.
    """
    times: dict[str, list[SuiteTime]] = {}
    with (folder() / SUITES / TIMES).open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            if row["suite"] == name:
                time = SuiteTime(runs=int(row["runs"]), cpu_s=float(row["cpu_s"]))
                times.setdefault(row["problem"], []).append(time)
    return {problem: sorted(times_of_problem) for problem, times_of_problem in times.items()}
