"""Numbers of a stored suite, for the pages that quote them.

A quoted number is named by words with semicolons between them, as a row of
``docs/findings/numbers/which-filter.csv`` has them:

- ``ratio; PROBLEM; FILTER``: its error over that of the problem's best filter
- ``ratio; PROBLEM; FILTER; OTHER``: its error over that of another filter, smoother or reference
- ``excess; PROBLEM; FILTER``: the percent by which its error is above that of the problem's best filter
- ``typical; GROUP; FILTER``: its typical ratio over a group's problems
- ``cost; GROUP; FILTER``: the median of its CPU time over that of the fastest filter
- ``cost; PROBLEM; FILTER; OTHER``: its CPU time over that of another filter
- ``near; GROUP; FILTER``: the problems on which it is within 10 % of the best
- ``twice; GROUP; FILTER``: the problems on which it is within a factor of two
- ``fails; GROUP; FILTER``, ``best; GROUP; FILTER``: the problems on which it fails, or is the best
- ``lost; PROBLEM; FILTER``: the runs that it loses
- ``problems; GROUP``, ``filters; GROUP``: their number
"""

import csv
from dataclasses import replace
from functools import cache
from math import nan
from pathlib import Path
from typing import Any

from trackbench.report.suite.scores import (
    FILTER,
    Ratio,
    Score,
    SuiteScores,
    relative_costs,
    typical_ratios,
)
from trackbench.report.suite.tables import NEAR, fails, is_best

ROOT = Path(__file__).resolve().parent.parent


@cache
def stored_suite(name: str = "standard") -> dict[str, SuiteScores]:
    """Return the stored scores of a suite by group, with the recorded CPU times."""
    times = {}
    costs = ROOT / "results" / "times" / name / "costs.csv"
    if costs.is_file():  # not of another seed
        for row in csv.DictReader(costs.read_text(encoding="utf-8").splitlines()):
            times[row["problem"], row["filter"]] = float(row["cpu_s_per_run"])
    groups: dict[str, list[Score]] = {}
    with (ROOT / "results" / name / "scores.csv").open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            score = _score(row)
            seconds = times.get((score.problem, score.label), nan)
            groups.setdefault(score.group, []).append(replace(score, cpu_s=seconds))
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
    what, *words = source.split("; ")
    if what in ("ratio", "cost") and len(words) == 3:
        score = score_of(words[0], words[1], name)
        other = score_of(words[0], words[2], name)
        return score.error / other.error if what == "ratio" else score.cpu_s / other.cpu_s
    if what == "ratio":
        return score_of(words[0], words[1], name).ratio_to_best.value
    if what == "excess":
        return 100.0 * (score_of(words[0], words[1], name).ratio_to_best.value - 1.0)
    if what == "lost":
        return score_of(words[0], words[1], name).lost
    group = stored_suite(name)[words[0]]
    if what == "problems":
        return len(group.problems)
    if what == "filters":
        return len(group.labels(FILTER))
    label = words[1]
    if what == "typical":
        return typical_ratios(group)[label]
    if what == "cost":
        return relative_costs(group)[label]
    counted: dict[str, Any] = {
        "near": lambda score: score.has_error and score.limited_ratio <= NEAR,
        "twice": lambda score: score.has_error and score.limited_ratio <= 2.0,
        "fails": fails,
        "best": is_best,
    }
    mine = [score for score in group.of_role(FILTER) if score.label == label]
    return sum(counted[what](score) for score in mine)


def is_suite(name: str) -> bool:
    """Test whether a folder of results/ has the scores of a suite."""
    return bool(name) and (ROOT / "results" / name / "scores.csv").is_file()
