"""Counts of the verdicts of each word, as bars and in lines, or how many runs the verdicts need."""

from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

from trackbench.errors import counted
from trackbench.report.verdicts.all_verdicts import Verdicts
from trackbench.report.verdicts.claim_verdicts import ClaimVerdict
from trackbench.report.verdicts.number_verdicts import Compared
from trackbench.statistics.verdict_rules import NOT_MEASURED, TOO_FEW_RUNS, UNDECIDED

_VERBS = ("agrees", "differs", "holds", "fails")
"""Words of verdicts that are verbs, and have no "s" if several agree, differ, ..."""


class Tally(NamedTuple):
    """Number of verdicts of one word."""

    number: int
    word: str
    verb: str
    """the word in a sentence, such as "differ" of several"""
    fragile: int
    """number of these verdicts that are fragile"""


class Bar(NamedTuple):
    """The verdicts on numbers, or on claims."""

    title: str
    """what is counted, such as ``11 claims``"""
    parts: list[Tally]
    """one for each word that occurs"""

    @property
    def words(self) -> str:
        """Bar as a line: ``11 claims: 10 agree (2 fragile), 1 differs``."""
        texts = []
        for tally in self.parts:
            text = f"{tally.number} {tally.verb}"
            if tally.fragile:
                text += f" ({tally.fragile} fragile)"
            texts.append(text)
        return f"{self.title}: {', '.join(texts)}"


_WORDS = (
    *("equal", "agrees", "compatible", "differs", "holds", "fails"),
    *(UNDECIDED, TOO_FEW_RUNS, NOT_MEASURED),
)
"""Words of verdicts, in the order in which they are counted."""


def tallies(verdicts: Iterable[Compared | ClaimVerdict]) -> list[Tally]:
    """Count the verdicts of each word, in the order of `_WORDS`; leave out words without a verdict."""
    rows = list(verdicts)
    numbers = Counter(row.verdict.word for row in rows)
    fragile = Counter(row.verdict.word for row in rows if row.verdict.fragile)
    counts = []
    for word in _WORDS:
        number = numbers[word]
        if number:
            verb = word  # 1 agrees, 2 agree
            if word == TOO_FEW_RUNS:
                verb = f"with {word}"
            elif number > 1 and word in _VERBS:
                verb = word.removesuffix("s")
            counts.append(Tally(number=number, word=word, verb=verb, fragile=fragile[word]))
    return counts


def bars(comparison: Verdicts) -> list[Bar]:
    """Return counts of the verdicts on numbers, on words on a bias and on claims, to be drawn as bars.

    A bar without any verdict is left out. The list is empty if the results have fewer runs than the
    experiment: see `needed_runs`.
    """
    if comparison.experiment_runs is not None:
        return []
    return _all_bars(comparison)


def needed_runs(comparison: Verdicts) -> str:
    """Return the sentence on verdicts that need more runs; empty if the results have all runs."""
    titles = " and ".join(bar.title for bar in _all_bars(comparison))
    if comparison.experiment_runs is None or not titles:
        return ""
    return f"Verdicts on {titles} need all {comparison.experiment_runs} runs"


def _all_bars(comparison: Verdicts) -> list[Bar]:
    """Return the bars of numbers, words on a bias and claims; leave out those without a verdict."""
    # A published value that is a text is a word on a bias, and is counted apart from numbers.
    words = []
    numbers = []
    for reproduced in comparison.numbers:
        # A number counts once, by the best of its rows, one for each reading and filter.
        row = reproduced.best
        if isinstance(row.published.value, str):
            words.append(row)
        else:
            numbers.append(row)
    claims = comparison.claims
    margin = " on a bias, by a margin chosen here"
    all_bars = [
        Bar(counted(len(numbers), "published number"), tallies(numbers)),
        Bar(counted(len(words), "published word") + margin, tallies(words)),
        Bar(counted(len(claims), "claim"), tallies(claims)),
    ]
    return [bar for bar in all_bars if bar.parts]


def summary_lines(comparison: Verdicts) -> list[str]:
    """Count the verdicts: a line on numbers, one on words on a bias, one on claims.

    A number with several readings counts once. A last line counts the numbers left out. If the results
    have fewer runs than the experiment, the only line is how many runs the verdicts need.
    """
    needed = needed_runs(comparison)
    if needed:
        return [f"{needed}."]
    lines = [bar.words for bar in bars(comparison)]
    with_readings = [number for number in comparison.numbers if number.readings > 1]
    if with_readings:
        agree = sum(number.best.verdict.word == "agrees" for number in with_readings)
        remark = (
            f"{len(with_readings)} were tried under several readings, of which {agree} agree in one"
        )
        lines[0] += f"; {remark}"  # the first line is that of the numbers
    if comparison.left_out:
        lines.append(f"{counted(len(comparison.left_out), 'printed number')} left out")
    return lines


def verdict_lines(comparison: Verdicts, folder: Path, config: Path) -> Iterator[str]:
    """Yield lines on the verdicts that compare the results with a paper's numbers and claims.

    These are the numbers of verdicts by word, and the first claim. With fewer runs than the experiment
    has, a line names the number of runs that verdicts need. ``folder`` is the results folder, and
    ``config`` the config as the user named it.
    """
    need_of_runs = needed_runs(comparison)  # a sentence, or empty
    if need_of_runs:
        yield f"{need_of_runs}: trackbench run {config}"
    # A bar has the verdicts on all numbers, or on all claims: a tally for each word.
    verdict_bars = bars(comparison)
    if not verdict_bars:
        return
    texts = []
    for bar in verdict_bars:
        numbers = ", ".join(f"{tally.number} {tally.verb}" for tally in bar.parts)
        texts.append(f"{bar.title}: {numbers}")
    yield f"Verdicts on {'; on '.join(texts)}. Reasons: trackbench compare {folder}"
    if comparison.claims:
        first = comparison.claims[0]
        yield f"The first claim: {first.claim.claim}: {first.verdict.word}."


def join_verdicts(comparisons: list[Verdicts]) -> Verdicts:
    """Join the verdicts of several experiments, to count them together.

    The result has no ``experiment_runs``: experiments with fewer runs than planned are not marked.
    """
    joined = Verdicts(rows=[], claims=[], ranks=[])
    for comparison in comparisons:
        joined.rows.extend(comparison.rows)
        joined.claims.extend(comparison.claims)
        joined.ranks.extend(comparison.ranks)
        joined.left_out.extend(comparison.left_out)
    return joined
