"""A published number, what was measured for it, and the verdict, under one or several readings."""

from math import inf, isfinite
from typing import NamedTuple

from trackbench.config.published_numbers_and_claims import PublishedNumber
from trackbench.statistics.estimates import RunEstimate
from trackbench.statistics.verdict_meanings import NUMBER_WORDS
from trackbench.statistics.verdict_rules import NOT_MEASURED, TOO_FEW_RUNS, Verdict

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
