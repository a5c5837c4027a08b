"""Rules of the verdicts: what one measurement says, and what all independent batches of it decide.

A difference has to show in every batch by itself: only so a number `differs` (or is `biased`), and a
claim `holds` or `fails`. An agreement is an equivalence, which takes all runs to be shown, and which no
batch may contradict.
"""

from collections.abc import Iterator, Sequence
from math import fsum, inf, isfinite, isnan, log, nan, sqrt
from typing import NamedTuple

from trackbench.experiment.reading.published import PublishedNumber
from trackbench.report.terms import Term

SURE = 3.0
"""Standard errors beyond which a difference is taken for real."""
NEAR = 0.1
"""Share of a published number within which the difference must lie to be none."""
NOT_MEASURED, UNDECIDED = "not measured", "not decided"
NUMBER_WORDS = ("agrees", "compatible", "near", "differs", "chosen", UNDECIDED, NOT_MEASURED)
"""Verdicts on a number, the best first."""
CLAIM_WORDS = ("holds", "fails", UNDECIDED, NOT_MEASURED)
_TO_BE_SHOWN_BY_EACH = ("differs", "holds", "fails", "biased")
_CONTRADICTS = {
    "agrees": ("near", "differs"),
    "compatible": ("near", "differs"),
    "unbiased": ("biased",),
}


class Verdict(NamedTuple):
    """The word, z over all runs, z of each batch; ``shown``: those that had to be beyond `SURE`.

    None had to where the test is exact and not normal.
    """

    word: str
    z: float
    batches: tuple[float, ...] = ()
    shown: tuple[float, ...] = ()
    turns: bool = False
    """whether a number as far off as that of another seed may well be would have another word"""

    @property
    def is_close(self) -> bool:
        """Whether as many runs of another seed could well say something else than what is said here.

        What each batch has shown: their values of z are normal about the same mean.
        """
        if self.turns:
            return True
        B = len(self.shown)
        if self.word not in _TO_BE_SHOWN_BY_EACH or not B:
            return False
        return abs(fsum(self.shown)) / B < SURE + _room_of_another_seed(B)


def _room_of_another_seed(B: int = 1) -> float:
    """Standard errors from the mean of B numbers to beyond which one of B others is in 5 % of cases.

    At most, on one side (Bonferroni).
    """
    from scipy.special import ndtri

    return float(ndtri(1.0 - 0.05 / B)) * sqrt(1.0 + 1.0 / B)


def of_number(number: PublishedNumber, whole: Term, batches: Sequence[Term]) -> Verdict:
    """The verdict on a published number from all runs and from each batch of them."""
    judge = _bias if isinstance(number.value, str) else _difference
    word, z = judge(number, whole)
    found = [judge(number, batch) for batch in batches]
    turns = any(judge(number, other)[0] != word for other in _measured_again(whole))
    word = settled(word, [w for w, _ in found])
    if word in ("biased", "unbiased"):
        word = "agrees" if word == number.value else "differs"
    if number.chosen and word not in (NOT_MEASURED, UNDECIDED):
        word = "chosen"
    zs = tuple(z for _, z in found)
    return Verdict(word, z, zs, zs or (z,), turns and word not in (NOT_MEASURED, UNDECIDED))


def _measured_again(whole: Term) -> Iterator[Term]:
    """The ends of where nine in ten numbers of another seed are."""
    room = _room_of_another_seed() * whole.stderr
    for end in (-room, room) if isfinite(room) else ():
        yield whole._replace(value=whole.value + end)


def of_claim(
    z: float, batches: Sequence[float], equal: bool = False, exact: bool = False
) -> Verdict:
    """The verdict on a claim from the z in its favour.

    To be ``equal`` is shown by all runs together; and anything is whose test is ``exact``, as that of a
    share is: a batch of 200 could not show 0.99. No batch may contradict that.
    """
    word, found, zs = _claimed(z), [_claimed(b) for b in batches], tuple(batches)
    if exact or (equal and word == "holds"):
        word = UNDECIDED if {word, *found} >= {"holds", "fails"} else word
        return Verdict(word, z, zs, () if exact else (z,))
    return Verdict(settled(word, found), z, zs, zs or (z,))


def weakest(zs: Sequence[float], steps: int = 1) -> float:
    """The least z of comparisons that all have to hold, NaN before any; for certain, of many steps.

    That all hold needs no correction for their number, since each has to be shown (an intersection-union
    test; Berger 1982, Technometrics 24, 295). One of many steps that fails does: Bonferroni's.
    """
    from scipy.special import log_ndtr, ndtri_exp

    least = min(zs, key=lambda z: -inf if isnan(z) else z)
    if steps == 1 or not least < 0.0:
        return least
    return float(ndtri_exp(min(log_ndtr(least) + log(len(zs)), log(0.5))))


def settled(word: str, batches: Sequence[str]) -> str:
    """What all runs say, unless a batch of them says otherwise."""
    if word in _TO_BE_SHOWN_BY_EACH:
        return word if all(b == word for b in batches) else UNDECIDED
    return UNDECIDED if set(batches) & set(_CONTRADICTS.get(word, ())) else word


def _claimed(z: float) -> str:
    return "holds" if z >= SURE else "fails" if z <= -SURE else UNDECIDED


def _difference(number: PublishedNumber, measured: Term) -> tuple[str, float]:
    """A number against the printed one, whose error is the paper's own where it prints a spread."""
    value, printed = measured.value, number.value
    if measured.lost > measured.runs > 0:
        return "differs", inf  # what survives says nothing of the filter
    if not isfinite(value):
        return (NOT_MEASURED, nan) if not measured.lost else ("differs", inf)
    assert not isinstance(printed, str)
    theirs = _of_the_paper(number, measured)
    z = measured.z(printed, theirs)
    reach = max(abs(end - printed) for end in measured.interval(other=theirs))
    room, digits = NEAR * abs(printed), 0.5 * 10.0**-number.digits
    if reach <= digits or (abs(z) <= SURE and reach <= room):
        return "agrees", z
    if isnan(z):  # without an error nothing is told apart
        return UNDECIDED, z
    if abs(z) <= SURE:
        return "compatible", z
    return ("near" if abs(value - printed) <= room else "differs"), z


def _of_the_paper(number: PublishedNumber, measured: Term) -> float:
    """Standard error of the printed number: from its own spread, else from ours."""
    if not number.runs:
        return 0.0
    if number.variance is not None:
        return sqrt(number.variance / number.runs)
    return measured.stderr * sqrt(measured.runs / number.runs)


def _bias(number: PublishedNumber, measured: Term) -> tuple[str, float]:
    """Biased if beyond the margin for certain, unbiased if within it for certain."""
    value, stderr = measured.estimate
    if not isfinite(value):
        return NOT_MEASURED, nan
    z = measured.z()
    if abs(value) - number.margin >= SURE * stderr:
        return "biased", z
    return ("unbiased" if abs(value) + SURE * stderr <= number.margin else UNDECIDED), z
