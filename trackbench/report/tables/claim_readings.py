"""Table kind `claim-readings`: the readings of a paper by how many of its claims hold."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import nan
from typing import NamedTuple

from trackbench.config.published_numbers_and_claims import Claim
from trackbench.config.read_published_files import read_published
from trackbench.errors import counted
from trackbench.field_types import Count
from trackbench.registry import register
from trackbench.report.expressions import Evaluator
from trackbench.report.kinds import TableKind
from trackbench.report.table import Cell, Table
from trackbench.report.tables_and_figures import Results
from trackbench.report.verdicts.claim_verdicts import judge_at_points
from trackbench.report.verdicts.grid_points_as_readings import reading_name, searched_points
from trackbench.statistics.sample_statistics import Estimate
from trackbench.statistics.verdict_meanings import CLAIM_WORDS


class _JudgedReading(NamedTuple):
    """A reading of a paper: a point of the grid, with the verdicts on the claims there."""

    values: list[str]
    """what distinguishes the point, in the order of the headings"""
    words: list[str]
    """verdict on each claim"""


@register("tables", "claim-readings")
@dataclass(frozen=True, kw_only=True)
class ClaimReadings(TableKind):
    """The points of the grid, each a reading of a paper, by how many of its claims hold there.

    For a paper that prints no numbers. Of equal readings the one with fewer claims that fail comes
    first. The verdicts are those of the comparison, over all batches of runs; claims about times, and
    those that nothing here measures, are left out. With many readings one does well by chance: the notes
    say how many were tried, how many do as well, and at how many each claim holds.
    """

    of: str
    """experiment whose claims in the published files are judged at every point"""
    rows: Count = 10
    """how many readings are shown"""

    def table(self, results: Results) -> Table:
        """Rank the readings of a paper by the number of claims that hold.

        A reading is an interpretation of what the paper leaves open, here a point of the grid.
        """
        # Step 1: judge every claim at every point.
        heads, points = searched_points(results, list(results.filters))
        evaluators = [Evaluator(results, point) for _, point in points]
        claims, words_of_claims = judge_at_points(self._claims(results), evaluators)
        if not claims:
            note = f"Nothing is claimed in {self.of} that these filters measure."
            return Table(self.title, ["Rank"], [], digits=1, notes=[note])
        # Step 2: the most claims that hold come first, then the fewest that fail.
        readings = []
        for i, (values, _) in enumerate(points):
            words = [words_of_claim[i] for words_of_claim in words_of_claims]
            readings.append(_JudgedReading(values=values, words=words))
        readings.sort(
            key=lambda reading: (-reading.words.count("holds"), reading.words.count("fails"))
        )
        columns = [word.capitalize() for word in CLAIM_WORDS]
        table = Table(self.title, ["Rank", *heads], columns, digits=1)
        for rank, reading in enumerate(readings[: self.rows], start=1):
            cells = []
            for word in CLAIM_WORDS:
                number = reading.words.count(word)  # of claims: no estimate over runs
                cells.append(Cell(Estimate(number, nan), runs=0, lost=0))
            table.add([str(rank), *reading.values], cells)
        table.notes += _claim_notes(heads, claims, readings)
        return table

    def _claims(self, results: Results) -> list[Claim]:
        """Read the claims about filters of the results, without claims about times."""
        published = read_published(results.folder, results.config.get("published", []), self.of)
        claims = []
        for claim in published.claims:
            is_of_time = any(m.metric.startswith("cpu_s") for m in claim.expressions)
            if claim.labels and set(claim.labels) <= {*results.filters} and not is_of_time:
                claims.append(claim)
        return claims


def _claim_notes(
    heads: list[str], claims: list[Claim], readings: list[_JudgedReading]
) -> Iterator[str]:
    """Yield how many readings and claims there are, and at how many readings each claim holds.

    ``readings`` are points of the grid with the verdicts there, sorted by the number of claims that
    hold. ``heads`` are the headings of the values that name a reading.
    """
    best = readings[0]
    holding = [reading.words.count("holds") for reading in readings]
    name = reading_name(heads, best.values)
    most = f"Most hold at {name}: {holding[0]}; as many at {holding.count(holding[0])}"
    numbers = f"{counted(len(readings), 'reading')}, {counted(len(claims), 'claim')}"
    yield f"{numbers}. {most} of the readings."
    for i, claim in enumerate(claims):
        words = [reading.words[i] for reading in readings]
        holds = words.count("holds")
        fails = words.count("fails")
        yield f"{claim.claim}: holds at {holds}, fails at {fails} of the readings."
