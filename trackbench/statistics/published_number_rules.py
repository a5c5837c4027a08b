"""Rules of verdicts on numbers that a paper prints, and on its words on a bias."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import floor, inf, isfinite, isnan, log10, nan, sqrt
from typing import Literal

from trackbench.field_types import Count, Finite, Natural, NonNegative, Positive
from trackbench.statistics.estimates import RunEstimate
from trackbench.statistics.influential_runs import with_few_runs_changed
from trackbench.statistics.significance_rules import NEAR
from trackbench.statistics.verdict_rules import ANOTHER_SEED, DECIDED, SURE, UNDECIDED, Verdict


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

    Parameters
    ----------
    number
        number as the paper prints it, or its word on a bias
    whole
        measured number of all runs
    parts
        measured numbers without each batch of runs

    Returns
    -------
    Verdict
        word, z of the difference, and whether other runs could change the word
    """
    if isinstance(number.value, str):  # "biased" or "unbiased"
        judge = _judge_bias
        needed = nan  # the value is compared with a margin, and not its z with a limit
    else:
        judge = _judge_difference
        needed = DECIDED
    # `DECIDED`, 5 standard errors, decides with all runs. Without one batch of them, 3 (`SURE`) confirm
    # or contradict the word.
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
    yield from with_few_runs_changed(whole)
    change = ANOTHER_SEED * whole.stderr
    if isfinite(change):
        yield whole._replace(value=whole.value - change)
        yield whole._replace(value=whole.value + change)


def combine_batches(word: str, parts: Sequence[str]) -> str:
    """Return the word of all runs, or inconclusive if the batches do not confirm it.

    All batches must have the word "differs" or "biased" for such a word. For any other word none may
    have its opposite.

    Parameters
    ----------
    word
        word of all runs
    parts
        words without each batch

    Returns
    -------
    str
        ``word``, or `UNDECIDED`
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
    # If most runs are lost, the few others (`runs`, without the lost ones) do not represent the filter.
    if measured.lost > measured.runs > 0:
        return "differs", inf
    # All runs are lost, or the number cannot be computed.
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
