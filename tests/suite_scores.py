"""Numbers of a stored suite, for the pages that quote them.

A quoted number is named by words with semicolons between them, as a row of
``docs/findings/numbers/which-filter.csv`` has them:

- ``ratio; PROBLEM; FILTER``: its error over that of the problem's best filter
- ``ratio; PROBLEM; FILTER; OTHER``: its error over that of another filter, smoother or reference
- ``excess; PROBLEM; FILTER``: the percent by which its error is above that of the problem's best filter
- ``typical; GROUP; FILTER``: its typical ratio over a group's problems
- ``near; GROUP; FILTER``: the problems on which it is within 10 % of the best
- ``twice; GROUP; FILTER``: the problems on which it is within a factor of two
- ``fails; GROUP; FILTER``: the problems on which it fails
- ``gray; GROUP; FILTER``: the problems on which it cannot be run
- ``problems; GROUP``: their number
"""

import csv
from collections.abc import Callable
from functools import cache
from math import nan
from pathlib import Path

from trackbench.report.suite.score_words import NEAR, fails
from trackbench.report.suite.scores import (
    FILTER,
    Ratio,
    Score,
    SuiteScores,
    typical_ratios,
)

ROOT = Path(__file__).resolve().parent.parent


@cache
def stored_suite(name: str = "standard") -> dict[str, SuiteScores]:
    """Return the stored scores of a suite by group."""
    groups: dict[str, list[Score]] = {}
    with (ROOT / "results" / name / "scores.csv").open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            groups.setdefault(row["group"], []).append(_score(row))
    return {
        group: SuiteScores(group=group, title=group, scores=scores, runs={})
        for group, scores in groups.items()
    }


def _score(row: dict[str, str]) -> Score:
    def number(column: str) -> float:
        return float(row[column]) if row[column] else nan

    best = Ratio(value=number("ratio_to_best"), low=number("low"), high=number("high"))
    reference = Ratio(
        value=number("ratio_to_reference"),
        low=number("reference_low"),
        high=number("reference_high"),
    )
    was_run = int(row["runs"]) > 0
    return Score(
        group=row["group"],
        problem=row["problem"],
        problem_class=row["class"],
        label=row["filter"],
        role=row["role"],
        metric=row["metric"],
        error=number("error"),
        stderr=number("stderr"),
        ratio_to_best=best,
        ratio_to_reference=reference,
        word=row["word"],
        runs=int(row["runs"]),
        lost=int(row["lost"]),
        collapsed=int(row["collapsed"]),
        consistency=row["consistency"],
        reason=row["reason"],
        failed=bool(row["reason"]) and was_run,
    )


def score_of(problem: str, label: str, name: str = "standard") -> Score:
    """Return the score of a filter, smoother or reference on a problem."""
    for group in stored_suite(name).values():
        for score in group.scores:
            if (score.problem, score.label) == (problem, label):
                return score
    raise ValueError(f"results/{name}/scores.csv has no {label!r} on {problem!r}")


def scores_of_class(problem_class: str, label: str, name: str = "standard") -> list[Score]:
    """Return a filter's scores on the problems of a class."""
    return [
        score
        for group in stored_suite(name).values()
        for score in group.scores
        if score.problem_class == problem_class and score.label == label
    ]


def suite_number(source: str, name: str = "standard") -> float:
    """Return a number of a stored suite; see the module's list."""
    kind, *words = source.split("; ")
    if kind == "ratio" and len(words) == 3:
        problem, label, other = words
        return score_of(problem, label, name).error / score_of(problem, other, name).error
    if kind == "ratio":
        problem, label = words
        return score_of(problem, label, name).ratio_to_best.value
    if kind == "excess":
        problem, label = words
        return 100.0 * (score_of(problem, label, name).ratio_to_best.value - 1.0)
    group = stored_suite(name)[words[0]]
    if kind == "problems":
        return len(group.problems)
    label = words[1]
    if kind == "typical":
        return typical_ratios(group)[label]
    counted: dict[str, Callable[[Score], bool]] = {
        "near": lambda score: score.has_error and score.limited_ratio <= NEAR,
        "twice": lambda score: score.has_error and score.limited_ratio <= 2.0,
        "fails": fails,
        "gray": lambda score: score.is_left_out,
    }
    mine = [score for score in group.of_role(FILTER) if score.label == label]
    return sum(counted[kind](score) for score in mine)


def is_suite(name: str) -> bool:
    """Test whether a folder of results/ has the scores of a suite."""
    return bool(name) and (ROOT / "results" / name / "scores.csv").is_file()
