"""Verdicts on published numbers: each compared with what a filter measures, under its readings.

The rule is in `statistics.verdict_rules`: all runs together, and without each of the experiment's
batches.
"""

from collections.abc import Iterator
from dataclasses import replace
from math import floor, inf, isfinite, isnan, log10, nan
from typing import NamedTuple

from trackbench.config.published_numbers_and_claims import PublishedNumber
from trackbench.report.expressions import Evaluator
from trackbench.report.tables_and_figures import Results
from trackbench.report.verdicts.claim_verdicts import no_results
from trackbench.statistics import published_number_rules
from trackbench.statistics.estimates import MISSING, RunEstimate
from trackbench.statistics.influential_runs import without_each_batch
from trackbench.statistics.significance_rules import NEAR
from trackbench.statistics.verdict_meanings import NUMBER_WORDS
from trackbench.statistics.verdict_rules import NOT_MEASURED, TOO_FEW_RUNS, Verdict, noted

FEWER_STORED = "has all digits that are stored, but more are printed: run the experiment again"
_BEST_FIRST = (*NUMBER_WORDS, TOO_FEW_RUNS, NOT_MEASURED)
"""Words of verdicts on one number under several readings."""


class Compared(NamedTuple):
    """A published number, what was measured for it under one reading, and the verdict."""

    published: PublishedNumber
    label: str
    """filter that is measured; empty if none is"""
    measured: RunEstimate
    verdict: Verdict
    note: str
    """reasons for the verdict"""
    tried: int = 1
    """readings of which this one is the best"""


class Reproduced(NamedTuple):
    """A published number under every reading of it that was tried."""

    rows: list[Compared]
    """one for each reading; a search of many has one alone"""

    @property
    def best(self) -> Compared:
        """Reading that gives the number its verdict."""
        return min(self.rows, key=best_first)

    @property
    def readings(self) -> int:
        """Number of interpretations tried."""
        return sum(row.tried for row in self.rows)


def best_first(row: Compared) -> tuple[int, float]:
    """Return a key that sorts the best verdict first, and equal verdicts by distance from the print."""
    printed = row.published.value
    value = row.measured.value
    difference = inf
    if not isinstance(printed, str) and isfinite(value):
        difference = abs(value - printed)
    return _BEST_FIRST.index(row.verdict.word), difference


def compare_filters(number: PublishedNumber, evidence: Evaluator | None) -> Iterator[Compared]:
    """Yield a published number compared with what each of the filters that it names measures.

    ``evidence`` has the measures at the number's point; None if there are no results. The note has the
    texts ``number.reading``, how the row interprets the paper, and ``number.chosen``, what was chosen so
    that this number comes out.
    """
    if evidence is None or not number.expression:
        why = no_results(number, evidence)
        yield Compared(
            published=number,
            label="",
            measured=MISSING,
            verdict=Verdict(NOT_MEASURED, nan),
            note=noted(why, number.reading, number.note),
        )
        return
    for label in number.labels:
        m = number.expression.of(label)
        # Step 1: the measured number, in the paper's unit.
        measured = evidence.term(m)
        exact = None if measured.lost else evidence.exact(m)
        if number.factor != 1.0:
            measured = measured.scaled(number.factor * measured.value, number.factor)
        # Step 2: of a linear filter the exact number in its place.
        judged_number = number
        if exact is not None:
            # An exact number has no variance. The paper's runs then have that of the runs here.
            if number.variance is None:
                variance = measured.stderr**2 * measured.runs
                judged_number = replace(number, variance=variance)
            measured = RunEstimate(
                value=number.factor * exact, stderr=0.0, influences=None, runs=measured.runs
            )
        # Step 3: the verdict, with its reasons. The z of a verdict that compares digits is NaN. It is
        # then `agrees` if the results store fewer digits than the paper prints, which a note says.
        verdict = _verdict(judged_number, measured, label, evidence.results)
        has_all_stored_digits = verdict.word == "agrees" and isnan(verdict.z)
        note = noted(
            "differs by less than 10 %" if _is_near(number, measured, verdict) else "",
            measured.losses,
            FEWER_STORED if has_all_stored_digits else "",
            "" if exact is None else "exact, without runs",
            f"chosen for this number: {number.chosen}" if number.chosen else "",
            number.reading,
            number.note,
        )
        yield Compared(published=number, label=label, measured=measured, verdict=verdict, note=note)


def _is_near(number: PublishedNumber, measured: RunEstimate, verdict: Verdict) -> bool:
    """Test whether a number differs significantly from the printed one, but by at most 10 % of it."""
    if verdict.word != "differs" or isinstance(number.value, str):
        return False
    return abs(published_number_rules.difference(number, measured.value)) <= NEAR * abs(
        number.value
    )


def _verdict(
    number: PublishedNumber, measured: RunEstimate, label: str, results: Results
) -> Verdict:
    """Return the verdict on a measured number of the filter ``label``.

    If the results have fewer runs than the experiment, the verdict has z but is `TOO_FEW_RUNS`. A filter
    without random numbers on recorded data is judged by its digits, not by z. It is `equal` if all
    printed digits are, and `agrees` if more digits are printed than are stored.
    """
    value = measured.value
    # A NaN that no lost run explains is not in the results.
    if isnan(value) and not measured.lost:
        return Verdict(NOT_MEASURED, nan)
    if results.experiment_runs is not None:
        verdict = published_number_rules.number_verdict(
            number, measured, without_each_batch(measured, results.batches)
        )
        # A fragile word may change with other runs; this one says that more runs are needed anyway.
        return verdict._replace(word=TOO_FEW_RUNS, fragile=False)
    is_number = not isinstance(number.value, str) and isfinite(value)
    if label not in results.deterministic or not is_number:
        return published_number_rules.number_verdict(
            number, measured, without_each_batch(measured, results.batches)
        )
    # Nothing is random: the difference may be at most what the stored digits leave open. They are those
    # of the value before it was multiplied by the factor to the paper's unit.
    digits = results.digits_of(label)
    rounding = number.factor * _half_unit(value / number.factor, digits)
    if abs(published_number_rules.difference(number, value)) > rounding:
        return Verdict("differs", nan)
    return Verdict("equal" if number.significant_digits <= digits else "agrees", nan)


def _half_unit(value: float, digits: int) -> float:
    """Return half a unit of the last digit of a value with so many significant ``digits``.

    It is 0 for the value 0.
    """
    if not value:
        return 0.0
    exponent = floor(log10(abs(value)))
    return 0.5 * 10.0 ** (exponent + 1 - digits)
