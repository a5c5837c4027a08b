"""How many verdicts there are of each word: as words, and as parts of a bar."""

from collections import Counter
from collections.abc import Iterable
from typing import NamedTuple

from trackbench.experiment.problems import counted
from trackbench.report.agreement import CLAIM_WORDS, NUMBER_WORDS
from trackbench.report.judging import Judged
from trackbench.report.verdicts import Compared, Comparison

_VERBS = ("agrees", "differs", "holds", "fails")


class Tally(NamedTuple):
    """So many verdicts of one word: ``18``, ``differs``, ``differ``, ``(3 fragile)``."""

    number: int
    word: str
    verb: str
    fragile: int


class Bar(NamedTuple):
    """The verdicts on numbers, or on claims."""

    title: str
    parts: list[Tally]

    @property
    def words(self) -> str:
        """The bar as a line: ``11 claims: 10 agree (2 fragile), 1 differs``."""
        parts = (
            f"{p.number} {p.verb}{f' ({p.fragile} fragile)' * bool(p.fragile)}" for p in self.parts
        )
        return f"{self.title}: {', '.join(parts)}"


def parts(found: Iterable[Compared | Judged]) -> list[Tally]:
    """The parts in a fixed order, without those of which there is none."""
    rows = list(found)
    numbers = Counter(row.verdict.word for row in rows)
    fragile = Counter(row.verdict.word for row in rows if row.verdict.fragile)
    words = (*(word for word in NUMBER_WORDS if word not in CLAIM_WORDS), *CLAIM_WORDS)
    return [
        Tally(n, word, word.removesuffix("s") if n > 1 and word in _VERBS else word, fragile[word])
        for word in words
        if (n := numbers[word])
    ]


def bars(comparison: Comparison) -> list[Bar]:
    """Return a bar of the numbers, one of the words on a bias, one of the claims, without empty ones."""
    best, claims = [number.best for number in comparison.numbers], comparison.claims
    words = [row for row in best if isinstance(row.published.value, str)]
    numbers = [row for row in best if not isinstance(row.published.value, str)]
    found = (
        (counted(len(numbers), "published number"), parts(numbers)),
        (
            counted(len(words), "published word") + " on a bias, by a margin chosen here",
            parts(words),
        ),
        (counted(len(claims), "claim"), parts(claims)),
    )
    return [Bar(title, there) for title, there in found if there]
