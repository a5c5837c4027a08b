"""Does it reproduce? Published numbers and claims against a results folder.

The rule is in `statistics.rules`: all runs together, and without each of the experiment's batches.
"""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, partial
from itertools import chain
from math import floor, inf, isfinite, isnan, log10, nan
from typing import Any, NamedTuple

import numpy as np

from trackbench.config.published import PublishedNumber
from trackbench.errors import counted
from trackbench.report.expressions import Evaluator
from trackbench.report.results import Results
from trackbench.report.verdicts.claims import (
    NOT_MEASURED,
    ClaimVerdict,
    evidence_at,
    judge,
    no_results,
    noted,
)
from trackbench.report.verdicts.cpu_times import without_times
from trackbench.report.verdicts.searches import searched_numbers
from trackbench.statistics import rules
from trackbench.statistics.estimates import MISSING, RunEstimate
from trackbench.statistics.rules import NEAR, NUMBER_WORDS, UNDECIDED, Verdict

FEWER_STORED = "has all digits that are stored, but more are printed: run the experiment again"


class Compared(NamedTuple):
    """A published number, what was measured for it under one reading, and the verdict."""

    published: PublishedNumber
    label: str
    measured: RunEstimate
    verdict: Verdict
    note: str
    tried: int = 1
    """readings of which this one is the best"""


class Ranked(NamedTuple):
    """Agreement of the order of the filters in one column of a published table."""

    paper: str
    table: str
    metric: str
    filters: int
    tau: float


class Reproduced(NamedTuple):
    """A published number under every reading of it that was tried."""

    rows: list[Compared]

    @property
    def best(self) -> Compared:
        """Reading that gives the number its verdict."""
        return min(self.rows, key=_rank)

    @property
    def readings(self) -> int:
        """Number of interpretations tried."""
        return sum(row.tried for row in self.rows)


@dataclass(frozen=True, repr=False)
class Verdicts:
    """Everything that is published about one experiment, with verdicts."""

    rows: list[Compared]
    claims: list[ClaimVerdict]
    ranks: list[Ranked]
    left_out: list[PublishedNumber] = field(default_factory=list)
    """printed numbers that no filter here measures: without a verdict"""

    def __repr__(self) -> str:
        numbers, claims = counted(len(self.numbers), "number"), counted(len(self.claims), "claim")
        return f"<Verdicts on {numbers} and {claims}>"

    @cached_property
    def numbers(self) -> list[Reproduced]:
        """Verdict for each published number, however many readings of it were tried."""
        readings: dict[tuple[str, ...], list[Compared]] = defaultdict(list)
        # Rows that are printed at one place are readings of one number.
        for row in self.rows:
            readings[row.published.printed_at].append(row)
        return [Reproduced(rows) for rows in readings.values()]


def _rank(row: Compared) -> tuple[int, float]:
    """Sort the best verdict first; of equal ones the nearest value."""
    printed, value = row.published.value, row.measured.value
    off = abs(value - printed) if not isinstance(printed, str) and isfinite(value) else inf
    return NUMBER_WORDS.index(row.verdict.word), off


def compare(results: Results) -> Verdicts:
    """Hold the results against what is published about the experiment."""
    published, at = without_times(results.published), cache(partial(evidence_at, results))
    left_out = [number for number in published.numbers if not number.labels]
    measured = [number for number in published.numbers if number.labels]
    readings = (_readings(number, at(number.point)) for number in measured)
    rows = list(chain.from_iterable(readings))
    claims = [judge(claim, at(claim.point)) for claim in published.claims]
    every_row = [*rows, *_best_of_searches(results)]
    return Verdicts(every_row, claims, list(rank_agreement(rows)), left_out)


def _best_of_searches(results: Results) -> Iterator[Compared]:
    """Yield each number of a searched paper under the best of all its readings."""
    evidence: dict[tuple[str, ...], Evaluator] = {}
    for readings in searched_numbers(results):
        rows = list[Compared]()
        for number, point in readings:
            values = tuple(map(str, point.values()))
            if values not in evidence:
                evidence[values] = Evaluator(results, point)
            for row in _readings(number, evidence[values]):
                is_measured = row.measured.lost or not isnan(row.measured.value)
                rows += [row] if is_measured else []
        if rows:
            best = Reproduced(rows).best
            note = noted(f"best of {len(rows)} readings searched", best.note)
            yield best._replace(tried=len(rows), note=note)


def rank_agreement(rows: list[Compared]) -> Iterator[Ranked]:
    """Yield Kendall's tau of published and measured order, per column of three or more filters."""
    columns: dict[tuple[str, str, str, str], list[Compared]] = defaultdict(list)
    # Collect the columns of the published tables.
    for row in rows:
        if isfinite(row.measured.value) and not isinstance(row.published.value, str):
            p = row.published
            columns[p.paper, p.table, p.row, p.metric].append(row)
    for (paper, table, part, metric), column in columns.items():
        # Skip columns of one or two filters, and those in which a filter has several readings.
        if len(column) < 3 or len({r.published.filter for r in column}) < len(column):
            continue
        order = kendall([r.published.value for r in column], [r.measured.value for r in column])
        heading = f"{metric}, {part}" if part else metric
        yield Ranked(paper, table, heading, len(column), order)


def kendall(a: Sequence[Any], b: Sequence[Any]) -> float:
    """Return Kendall's tau-b of two orders; NaN if one is constant (Kendall 1945, Biometrika 33)."""
    x, y = (np.sign(np.subtract.outer(values, values)) for values in (a, b))
    untied = [np.count_nonzero(signs) / 2 for signs in (x, y)]
    if not all(untied):
        return nan
    # tau_b = sum over pairs of sign(da) sign(db) / sqrt(untied pairs of a, times those of b)
    tau = np.sum(x * y) / 2 / np.sqrt(untied[0]) / np.sqrt(untied[1])
    return float(np.clip(tau, -1.0, 1.0))


def _readings(number: PublishedNumber, evidence: Evaluator | None) -> Iterator[Compared]:
    if evidence is None or not number.expression:
        why = no_results(number, evidence) or NOT_MEASURED
        note = noted(why, number.reading, number.note)
        yield Compared(number, "", MISSING, Verdict(UNDECIDED, nan), note)
        return
    for label in number.labels:
        measured = evidence.term(number.expression.of(label))
        exact = None if measured.lost else evidence.exact(number.expression.of(label))
        if number.factor != 1.0:
            measured = measured.scaled(number.factor * measured.value, number.factor)
        judged = number
        if exact is not None:
            if number.variance is None:  # the paper's error is that of our runs, scaled to its own
                judged = replace(number, variance=measured.stderr**2 * measured.runs)
            measured = RunEstimate(number.factor * exact, 0.0, None, measured.runs)
        verdict = _verdict(judged, measured, label, evidence.results)
        reasons = [
            "differs by less than 10 %" if _is_near(number, measured, verdict) else "",
            NOT_MEASURED if isnan(measured.value) and not measured.lost else "",
            measured.losses,
            FEWER_STORED if verdict.word == "agrees" and isnan(verdict.z) else "",
            "" if exact is None else "exact, without runs",
            f"chosen for this number: {number.chosen}" if number.chosen else "",
        ]
        note = noted(*reasons, number.reading, number.note)
        yield Compared(number, label, measured, verdict, note)


def _is_near(number: PublishedNumber, measured: RunEstimate, verdict: Verdict) -> bool:
    """Test whether a number differs significantly from the printed one, but by a small share."""
    if verdict.word != "differs" or isinstance(number.value, str):
        return False
    return abs(rules.difference(number, measured.value)) <= NEAR * abs(number.value)


def _verdict(
    number: PublishedNumber, measured: RunEstimate, label: str, results: Results
) -> Verdict:
    """Judge a number; a filter without random numbers on recorded data has the digits, or not.

    It `agrees` if it has all digits that are stored, and more are printed.
    """
    value = measured.value
    if label in results.deterministic and not isinstance(number.value, str) and isfinite(value):
        digits = results.digits_of(label)
        rounding = number.factor * _half_unit(value / number.factor, digits)
        if abs(rules.difference(number, value)) > rounding:
            return Verdict("differs", nan)
        return Verdict("equal" if number.significant_digits <= digits else "agrees", nan)
    return rules.number_verdict(number, measured, measured.parts(results.batches))


def _half_unit(value: float, digits: int) -> float:
    """Return half a unit of the last one of so many significant digits; 0 for 0."""
    return 0.5 * 10.0 ** (floor(log10(abs(value))) + 1 - digits) if value else 0.0
