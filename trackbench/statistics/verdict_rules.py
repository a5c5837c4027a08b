"""Rules of verdicts on what papers print: numbers, words on a bias, and claims.

A printed number differs, or a claim holds or fails (`decided`), if all runs show it beyond `DECIDED`
standard errors, and the runs without any one batch beyond `SURE`. An agreement is an equivalence: all
runs show it beyond `SURE`, and no part contradicts it. docs/statistics.md has error rates and power.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import copysign, floor, inf, isfinite, isnan, log, log10, nan, sqrt
from typing import Literal, NamedTuple

from trackbench.field_types import Count, Finite, Natural, NonNegative, Positive
from trackbench.statistics.estimates import RunEstimate
from trackbench.statistics.significance_rules import NEAR

DECIDED = 5.0
"""Standard errors of all runs from which a difference is decided."""
SURE = 3.0
"""Standard errors from which the runs without a batch show it, and all runs an agreement."""
ANOTHER_SEED = 1.6449 * sqrt(2.0)
"""Standard errors within which nine in ten numbers of another seed lie."""
NO_SIGN = 0.5
"""Standard errors below which a measured difference says nothing about its size."""
UNDECIDED = "inconclusive"
TOO_FEW_RUNS = "too few runs"
NOT_MEASURED = "not measured"


class Verdict(NamedTuple):
    """A verdict on a number or claim, with the z that it is from."""

    word: str
    """a key of `verdict_meanings.MEANINGS`"""
    z: float
    """over all runs"""
    parts: tuple[float, ...] = ()
    """z without each batch of runs in turn"""
    fragile: bool = False
    """whether another seed, one run less or three more runs could well change the word"""
    needed: float = DECIDED
    """standard errors of all runs that decide; NaN of a bias, which is compared with a margin"""

    @property
    def is_short(self) -> bool:
        """True if z over all runs is below what a decision needs."""
        return abs(self.z) < self.needed

    @property
    def has_sign(self) -> bool:
        """True if z is large enough that the size of the measured difference means anything."""
        return abs(self.z) >= NO_SIGN

    @property
    def weak_part(self) -> float | None:
        """Least z without a batch of runs, if it does not confirm the z of all runs; None if it does.

        It does not if its size is below `SURE` or it has the other sign. If there are no batches, it is
        the z of all runs.
        """
        least = min(self.parts, key=abs, default=self.z)
        if abs(least) < SURE or least * self.z < 0.0:
            return least
        return None


def decided(z: float, parts: Sequence[float] = (), exact: bool = False) -> int:
    """Return the sign of a difference if it is significant, else 0.

    ``z`` is that of all runs and must exceed `DECIDED`. ``parts`` are the z without each batch of runs,
    which must all exceed `SURE`. The z of an ``exact`` test must exceed only `SURE`, and no part may
    contradict it beyond `SURE`.
    """
    sign = int(copysign(1.0, z))
    if exact:
        shown = abs(z) >= SURE and not any(sign * part <= -SURE for part in parts)
    else:
        shown = abs(z) >= DECIDED and all(sign * part >= SURE for part in parts)
    if not shown:
        return 0
    return sign


def difference_sign(term: RunEstimate, batches: int) -> int:
    """Return the sign of a measured difference if it is significant, else 0."""
    return decided(term.z(), [part.z() for part in term.parts(batches)], term.is_exact)


@dataclass(frozen=True, kw_only=True)
class Printed:
    """A number in a paper, or a word on a bias, as far as the verdict depends on it."""

    value: Finite | Literal["biased", "unbiased"]
    """the number; a word where the paper prints a word"""
    digits: Natural = 0
    """decimals that are printed; default: those of the ``value`` as written, so 2 of 0.20"""
    runs: Count | None = None
    """the paper's Monte Carlo runs"""
    variance: Positive | None = None
    """variance over the paper's runs, where it prints one; so its own standard error is known"""
    margin: NonNegative = 0.0
    """how far from zero a value may be and still count as unbiased"""
    chosen: str = ""
    """what the paper leaves out and was chosen so that this number comes out: it decides nothing"""

    @property
    def significant_digits(self) -> int:
        """Number of digits from the first that is not zero to the last that is printed; 0 of a word."""
        if isinstance(self.value, str):
            return 0
        # Digits before the decimal point; 0 or less for zeros after it: -1 of 0.02.
        digits_before_point = 0
        if self.value:
            digits_before_point = floor(log10(abs(self.value))) + 1
        return max(digits_before_point + self.digits, 0)


def number_verdict(
    number: Printed,
    whole: RunEstimate,
    parts: Sequence[RunEstimate],
) -> Verdict:
    """Return the verdict on a published number.

    ``whole`` is the measured number of all runs, ``parts`` are those without each batch of runs.
    """
    if isinstance(number.value, str):  # "biased" or "unbiased"
        judge = _judge_bias
        needed = nan  # the value is compared with a margin, and not its z with a limit
    else:
        judge = _judge_difference
        needed = DECIDED
    word_of_all, z = judge(number, whole, DECIDED)
    words_of_parts = []
    zs_of_parts = []
    for part in parts:
        word_of_part, z_of_part = judge(number, part, SURE)
        words_of_parts.append(word_of_part)
        zs_of_parts.append(z_of_part)
    # The verdict is fragile if numbers that other runs could well have measured change its word.
    words_of_others = {judge(number, other, DECIDED)[0] for other in _other_measurements(whole)}
    turns = not words_of_others <= {word_of_all}
    # Batches that do not show the word, or contradict it, make it inconclusive.
    word = combine_batches(word_of_all, words_of_parts)
    # The measured bias has the paper's word or not.
    if word in ("biased", "unbiased"):
        word = "agrees" if word == number.value else "differs"
    if number.chosen:
        word = UNDECIDED  # a value that was chosen for the number shows nothing
    return Verdict(
        word=word,
        z=z,
        parts=tuple(zs_of_parts),
        fragile=turns and word != UNDECIDED,
        needed=needed,
    )


def _other_measurements(whole: RunEstimate) -> Iterator[RunEstimate]:
    """Generate numbers that other runs could have measured: few runs changed, or another seed."""
    yield from whole.stressed()
    change = ANOTHER_SEED * whole.stderr
    if isfinite(change):
        yield whole._replace(value=whole.value - change)
        yield whole._replace(value=whole.value + change)


def claim_verdict(
    z: float,
    parts: Sequence[float] = (),
    stressed: Sequence[float] = (),
    equal: bool = False,
    exact: bool = False,
) -> Verdict:
    """Return the verdict on a claim from the z in its favor.

    ``z`` is that of all runs. ``parts`` are those without each batch of runs, ``stressed`` those with
    few runs changed (`RunEstimate.stressed`). An ``equal`` claim is one of an equality. If it holds, and
    for an ``exact`` test, z of all runs must exceed only `SURE`, and the parts may not contradict it.
    """

    def is_shown_beyond_sure(z: float) -> bool:
        return exact or (equal and z > 0.0)

    # Compare the sign with those that another seed, or few runs changed, could well have shown.
    sign_of_all = decided(z, (), is_shown_beyond_sure(z))
    turns = False
    for other in (z - ANOTHER_SEED, z + ANOTHER_SEED, *stressed):
        if decided(other, (), is_shown_beyond_sure(other)) != sign_of_all:
            turns = True
    sign = decided(z, parts, is_shown_beyond_sure(z))
    word = {1: "holds", -1: "fails", 0: UNDECIDED}[sign]
    return Verdict(
        word=word,
        z=z,
        parts=tuple(parts),
        fragile=turns and word != UNDECIDED,
        needed=SURE if is_shown_beyond_sure(z) else DECIDED,
    )


def weakest(zs: Sequence[float]) -> float:
    """Return the least z of comparisons that must all hold; NaN if one of them is NaN.

    ``zs`` are in favor of a claim, one for each step and filter that it is about. A claim that holds
    needs no correction for their number, since each has to be shown (an intersection-union test; Berger
    1982, Technometrics 24, 295). A claim fails if one of them fails, which happens by chance the more
    often the more there are. So a negative z has Bonferroni's correction.
    """
    from scipy.special import log_ndtr, ndtri_exp

    least = min(zs, key=lambda z: -inf if isnan(z) else z)
    if len(zs) == 1 or not least < 0.0:
        return least
    # Bonferroni: the least tail probability times the number of comparisons, 1/2 at most, back to z.
    return float(ndtri_exp(min(log_ndtr(least) + log(len(zs)), log(0.5))))


def combine_batches(word: str, parts: Sequence[str]) -> str:
    """Return the word of all runs, or inconclusive if the batches do not confirm it.

    ``parts`` are the words without each batch. All of them must be "differs" or "biased" for such a
    word. For any other word none may be its opposite.
    """
    if word in _OPPOSITE.values():
        is_shown = all(part == word for part in parts)
    else:
        is_shown = _OPPOSITE.get(word) not in parts
    return word if is_shown else UNDECIDED


_OPPOSITE = {"agrees": "differs", "compatible": "differs", "unbiased": "biased"}


def _judge_difference(number: Printed, measured: RunEstimate, least: float) -> tuple[str, float]:
    """Compare a measured number with the printed one; return the word and z of their difference.

    The word is "agrees", "compatible", "differs" or `UNDECIDED`. ``least`` is the z from which the
    numbers differ. z is infinite if lost runs decide, and NaN without a finite number or its error.
    """
    value = measured.value
    printed = number.value
    # If most runs are lost, the few others do not represent the filter.
    if measured.lost > measured.runs > 0:
        return "differs", inf
    if not isfinite(value):
        if measured.lost:
            return "differs", inf
        return UNDECIDED, nan
    assert not isinstance(printed, str)  # a word on a bias has another judge, `_judge_bias`
    stderr_of_paper = _stderr_of_paper(number, measured)
    nearest = _nearest(number, value)
    z = measured.z(nearest, stderr_of_paper)
    if value == nearest and not isnan(measured.stderr):
        z = 0.0  # the value rounds to the printed number
    # Agreement: no difference, and an interval within 10 % or within the printed digits.
    if abs(z) <= SURE:
        farthest_end = max(abs(end - printed) for end in measured.interval(other=stderr_of_paper))
        if farthest_end <= max(NEAR * abs(printed), _rounding(number)):
            return "agrees", z
        return "compatible", z
    # Otherwise z decides whether the numbers differ. z may be too small, or NaN without an error.
    if abs(z) >= least:
        return "differs", z
    return UNDECIDED, z


def difference(number: Printed, value: float) -> float:
    """Return the difference of a value from the nearest number that rounds to the printed one.

    A printed 0.12 stands for 0.115 to 0.125, within which the difference is zero.
    """
    return value - _nearest(number, value)


def _nearest(number: Printed, value: float) -> float:
    """Return the number that is nearest to ``value`` among those that round to the printed one."""
    assert not isinstance(number.value, str)
    half = _rounding(number)
    return min(max(value, number.value - half), number.value + half)


def _rounding(number: Printed) -> float:
    """Return the largest rounding error of the printed number: half a unit of its last digit."""
    return 0.5 * 10.0**-number.digits


def _stderr_of_paper(number: Printed, measured: RunEstimate) -> float:
    """Return the standard error of the printed number, from the paper's variance or else from ours.

    It is 0 if the number of runs of the paper is unknown.
    """
    if not number.runs:
        return 0.0
    if number.variance is not None:
        return sqrt(number.variance / number.runs)
    # Our standard error, scaled to the paper's number of runs.
    return measured.stderr * sqrt(measured.runs / number.runs)


def _judge_bias(number: Printed, measured: RunEstimate, least: float) -> tuple[str, float]:
    """Compare a measured bias with its margin; return the word and z of the bias from zero.

    The word is "biased" if the value is beyond the margin by ``least`` standard errors. It is "unbiased"
    if the value plus `SURE` standard errors is within the margin. Otherwise it is `UNDECIDED`.
    """
    value, stderr = measured.estimate
    if not isfinite(value):
        return UNDECIDED, nan
    z = measured.z()
    if abs(value) - number.margin >= least * stderr:
        return "biased", z
    if abs(value) + SURE * stderr <= number.margin:
        return "unbiased", z
    return UNDECIDED, z
