"""Table kind `claim-readings`: which of many readings of a paper makes most of what it says hold."""

from dataclasses import dataclass
from itertools import compress
from typing import NamedTuple

from trackbench.config.published import Claim, read_published
from trackbench.evaluation.statistics import Estimate
from trackbench.field_types import Count
from trackbench.registry import register
from trackbench.report.expressions import Evaluator
from trackbench.report.kinds import TableKind
from trackbench.report.results import Results
from trackbench.report.table import Cell, Table
from trackbench.report.tables.reading_search import readings
from trackbench.report.verdicts.claims import judge
from trackbench.report.verdicts.rules import CLAIM_WORDS
from trackbench.results.point_facts import GridPoint


class _Reading(NamedTuple):
    """Values of the keys, and the verdict on every claim."""

    shown: list[str]
    verdicts: list[str]

    def count(self, word: str) -> int:
        """Number of claims with this verdict."""
        return self.verdicts.count(word)


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
        """Return the table from a results folder."""
        # Step 1: judge every claim at every point.
        heads, points = readings(results, list(results.filters))
        claims, verdicts = _judged(results, self._claims(results), [point for _, point in points])
        if not claims:
            note = f"Nothing is claimed in {self.of} that these filters measure."
            return Table(self.title, ["Rank"], [], digits=1, notes=[note])
        # Step 2: the most claims that hold come first, then the fewest that fail.
        found = [_Reading(shown, at) for (shown, _), at in zip(points, verdicts, strict=True)]
        found.sort(key=lambda r: (-r.count("holds"), r.count("fails")))
        table = Table(self.title, ["Rank", *heads], [w.capitalize() for w in CLAIM_WORDS], digits=1)
        for rank, reading in enumerate(found[: self.rows], start=1):
            cells = [Cell(Estimate(reading.count(w), float("nan")), 0, 0) for w in CLAIM_WORDS]
            table.add([str(rank), *reading.shown], cells)
        table.notes += _notes(heads, claims, found)
        return table

    def _claims(self, results: Results) -> list[Claim]:
        """Return the claims about the experiment's filters."""
        published = read_published(results.folder, results.config.get("published", []), self.of)
        here = set(results.filters)
        return [
            claim
            for claim in published.claims
            if claim.labels
            and set(claim.labels) <= here
            and not any(m.metric.startswith("cpu_s") for m in claim.expressions)
        ]


def _judged(
    results: Results, claims: list[Claim], points: list[GridPoint]
) -> tuple[list[Claim], list[list[str]]]:
    """Return the claims that any point decides, and the words on each of them at every point."""
    evidence = [Evaluator(results, point) for point in points]
    found = [[judge(claim, there) for claim in claims] for there in evidence]
    measured = [any(at[i].is_measured for at in found) for i in range(len(claims))]
    words = [[judged.verdict.word for judged in compress(at, measured)] for at in found]
    return list(compress(claims, measured)), words


def _notes(heads: list[str], claims: list[Claim], found: list[_Reading]) -> list[str]:
    first, most = found[0], found[0].count("holds")
    alike = sum(reading.count("holds") == most for reading in found)
    words = ", ".join(f"{head} {value}" for head, value in zip(heads, first.shown, strict=True))
    notes = [
        f"{len(found)} readings, {len(claims)} claims. Most hold at {words}: {most}; as many at "
        f"{alike} of the readings."
    ]
    for claim, there in zip(claims, zip(*(r.verdicts for r in found), strict=True), strict=True):
        holds, fails = there.count("holds"), there.count("fails")
        notes.append(f"{claim.claim}: holds at {holds}, fails at {fails} of the readings.")
    return notes
