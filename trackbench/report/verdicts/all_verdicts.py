"""All verdicts on an experiment: published numbers, claims and ranks, compared with its results."""

from collections import defaultdict
from dataclasses import dataclass, field
from functools import cache, cached_property, partial

from trackbench.config.published_numbers_and_claims import PublishedNumber
from trackbench.errors import counted
from trackbench.report.tables_and_figures import Results
from trackbench.report.verdicts.claim_verdicts import ClaimVerdict, evidence_at, judge
from trackbench.report.verdicts.cpu_time_verdicts import without_times
from trackbench.report.verdicts.number_verdicts import Compared, Reproduced, compare_filters
from trackbench.report.verdicts.rank_agreement import Ranked, rank_agreement
from trackbench.report.verdicts.searched_readings import best_rows_of_searches


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
    results
        results folder, whose config names the published files

    Returns
    -------
    Verdicts
        verdicts on numbers and claims, without those about CPU times.
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
            rows += compare_filters(number, evidence_of(number.point))
        else:
            left_out.append(number)
    # Step 2: claims, and the agreement of the published with the measured order of the filters.
    claims = [judge(claim, evidence_of(claim.point)) for claim in published.claims]
    ranks = list(rank_agreement(rows))
    # Step 3: numbers of papers that leave open how they were computed. A `readings` table measures each
    # under many readings, and the best one gives the number its row.
    rows_of_searches = list(best_rows_of_searches(results))
    return Verdicts(
        rows=[*rows, *rows_of_searches],
        claims=claims,
        ranks=ranks,
        left_out=left_out,
        experiment_runs=results.experiment_runs,
    )
