"""Does it reproduce? Published numbers and claims against a results folder.

The rule is in `statistics.verdict_rules`: all runs together, and without each of the experiment's
batches.
"""

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, partial
from math import floor, isfinite, isnan, log10, nan

from trackbench.config.published_csv import PublishedNumber
from trackbench.errors import counted
from trackbench.report.expressions import Evaluator
from trackbench.report.tables_and_figures import Results
from trackbench.report.verdicts.claim_verdicts import (
    ClaimVerdict,
    evidence_at,
    judge,
    no_results,
)
from trackbench.report.verdicts.compared_number import Compared, Reproduced
from trackbench.report.verdicts.cpu_time_verdicts import without_times
from trackbench.report.verdicts.rank_agreement import Ranked, rank_agreement
from trackbench.report.verdicts.searched_readings import searched_numbers
from trackbench.statistics import published_number_rules
from trackbench.statistics.estimates import MISSING, RunEstimate
from trackbench.statistics.influential_runs import without_each_batch
from trackbench.statistics.significance_rules import NEAR
from trackbench.statistics.verdict_rules import NOT_MEASURED, TOO_FEW_RUNS, Verdict, noted

FEWER_STORED = "has all digits that are stored, but more are printed: run the experiment again"


@dataclass(frozen=True, repr=False)
class Verdicts:
    """Everything that is published about one experiment, with verdicts."""

    rows: list[Compared]
    """one for each reading of each number"""
    claims: list[ClaimVerdict]
    ranks: list[Ranked]
    left_out: list[PublishedNumber] = field(default_factory=list)
    """printed numbers that no filter here measures: without a verdict"""
    experiment_runs: int | None = None
    """runs of the experiment, if the results have fewer: then nothing is decided"""

    def __repr__(self) -> str:
        numbers = counted(len(self.numbers), "number")
        claims = counted(len(self.claims), "claim")
        return f"<Verdicts on {numbers} and {claims}>"

    @cached_property
    def numbers(self) -> list[Reproduced]:
        """Verdict for each published number, however many readings of it were tried."""
        # Rows that are printed at one place are readings of one number.
        rows_by_place: dict[tuple[str, ...], list[Compared]] = defaultdict(list)
        for row in self.rows:
            rows_by_place[row.published.printed_at].append(row)
        return [Reproduced(rows) for rows in rows_by_place.values()]


def compare(results: Results) -> Verdicts:
    """Compare the results with what is published about the experiment.

    Parameters
    ----------
    results : results folder, whose config names the published files

    Returns
    -------
    Verdicts on numbers and claims, without those about CPU times.
    """
    published = without_times(results.published)
    # Measures at a point of the grid; rows with one point share them.
    evidence_of = cache(partial(evidence_at, results))
    # Step 1: the published rows, each a reading of a number, and each filter that a row names. A row
    # that names no filter of the experiment is left out.
    rows: list[Compared] = []
    left_out = []
    for number in published.numbers:
        if number.labels:
            rows += _compare_filters(number, evidence_of(number.point))
        else:
            left_out.append(number)
    # Step 2: claims, and the agreement of the published with the measured order of the filters.
    claims = [judge(claim, evidence_of(claim.point)) for claim in published.claims]
    ranks = list(rank_agreement(rows))
    # Step 3: numbers of papers that leave open how they were computed. A `readings` table measures each
    # under many readings, and the best one gives the number its row.
    rows_of_searches = list(_best_rows_of_searches(results))
    return Verdicts(
        rows=[*rows, *rows_of_searches],
        claims=claims,
        ranks=ranks,
        left_out=left_out,
        experiment_runs=results.experiment_runs,
    )


def _best_rows_of_searches(results: Results) -> Iterator[Compared]:
    """Yield each printed number that a `readings` table searches, compared under its best reading.

    A reading is an interpretation of what the paper leaves open: a point of the grid, and an expression
    of a filter that measures the number. The best one has the best verdict, and of equal verdicts the
    number nearest to the printed one. A number that no reading measures is left out.
    """
    evaluators: dict[tuple[str, ...], Evaluator] = {}
    for readings in searched_numbers(results):
        rows: list[Compared] = []
        for number, point in readings:
            values = tuple(map(str, point.values()))
            if values not in evaluators:
                evaluators[values] = Evaluator(results, point)
            # One row: the number of a reading names a single filter.
            for row in _compare_filters(number, evaluators[values]):
                # A NaN without lost runs means that this reading is not measured.
                if row.measured.lost or not isnan(row.measured.value):
                    rows.append(row)
        if rows:
            best = Reproduced(rows).best
            note = noted(f"best of {counted(len(rows), 'reading')} searched", best.note)
            yield best._replace(tried=len(rows), note=note)


def _compare_filters(number: PublishedNumber, evidence: Evaluator | None) -> Iterator[Compared]:
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
