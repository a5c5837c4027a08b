"""Digits that a program prints: too few, or those of float32."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.errors import counted

_LEAST_NUMBERS = 10  # from which digits are counted
_FLOAT32_DIGITS = 9  # with which every number of float32 is printed without loss
_LARGE_SPACING = 0.05  # standard deviations: spacing of float32 that adds errors
_TOO_FEW_DIGITS = 6  # fewer than the 7 to 9 that numbers of float32 need
_MOST_DECIMALS = 8
_NEARLY_WHOLE = 1e-6


class Digits(NamedTuple):
    """Digits of estimates."""

    too_few: str = ""
    """how few digits or decimals they have, such as "at most 6 digits"; empty if they have enough"""
    is_float32: bool = False
    """whether they have no more digits than numbers of float32 (7 to 9)"""
    printed: int = 0
    """how many digits they have at most, if these are as many as those of float32; 0 for numbers of
    float32 themselves, and for more digits"""
    advice: str = ""
    """what to do if the last digit is large beside a standard deviation; empty if it is small"""


def digits_of(mean: Array, cov: Array) -> Digits:
    """Test whether a program prints its estimates with too few digits, or with those of float32.

    A number of 17 digits appears to have few by chance with a probability below 1e-5. Equal variances
    count once, as a constant covariance may have few digits. Other entries of a covariance may be the
    mean of two answered numbers, which has more digits.

    Parameters
    ----------
    mean : array (n, ...)
        Means of the estimates, of any steps and runs.
    cov : array (n, n, ...)
        Covariances, of which the variances are tested. A program without covariances has NaN.

    Returns
    -------
    Digits
        Digits of the numbers, without `advice`. Fewer than ten numbers count as numbers of all digits.
    """
    variances = np.einsum("ii...->i...", cov)
    numbers = np.concatenate([mean.ravel(), np.unique(variances)])
    x = numbers[np.isfinite(numbers) & (numbers != 0.0)]
    if len(x) < _LEAST_NUMBERS:
        return Digits()
    with np.errstate(over="ignore", under="ignore"):
        is_float32 = bool(np.array_equal(x, np.float32(x)))
    digits = _most_digits(x)
    if digits <= _TOO_FEW_DIGITS:
        return Digits(too_few=f"at most {counted(digits, 'digit')}")
    # 1000.123 has as many digits as a number of float32, but three decimals.
    for decimals in range(_MOST_DECIMALS + 1):
        whole = x * 10.0**decimals
        # A larger number of float32 has no digits behind this decimal, so that it is always whole.
        is_small = np.abs(whole) < 10.0**_FLOAT32_DIGITS
        is_whole = np.abs(whole - np.rint(whole)) < _NEARLY_WHOLE
        has_few_digits = is_small
        if digits <= _FLOAT32_DIGITS:
            # A number of float32 such as 1.234567 has six decimals by itself. Only numbers with fewer
            # digits than in float32 show that decimals are cut.
            has_few_digits = np.abs(whole) < 10.0**_TOO_FEW_DIGITS
        if has_few_digits.sum() >= _LEAST_NUMBERS and is_whole[is_small].all():
            return Digits(too_few=f"at most {counted(decimals, 'decimal')}")
    if is_float32:
        return Digits(is_float32=True)
    if digits > _FLOAT32_DIGITS:
        return Digits()
    # There are 7 to 9 digits, which are either those of a program that computes in float32, or of one
    # that computes in double and prints so many. Numbers of float32 that are printed with up to nine
    # digits are none of float32 when they are read: compare with what float32 would print.
    with np.errstate(over="ignore", under="ignore"):
        nearest = np.float32(x).astype(float).tolist()
    are_printed_float32 = [float(f"{value:.{digits}g}") for value in nearest] == x.tolist()
    # `printed` is the number of digits of a double, and 0 for numbers of float32.
    return Digits(is_float32=True, printed=0 if are_printed_float32 else digits)


def _most_digits(x: Array) -> int:
    """Return how many significant digits numbers (N,) have at most, none of which is zero.

    It is 10, one more than float32 needs, if they have more.
    """
    exponent = np.floor(np.log10(np.abs(x)))
    for digits in range(1, _FLOAT32_DIGITS + 1):
        # A number with so many digits is whole after its decimal point is moved behind the last one.
        whole = x / 10.0 ** (exponent - digits + 1)
        if (np.abs(whole - np.rint(whole)) < _NEARLY_WHOLE).all():
            return digits
    return _FLOAT32_DIGITS + 1


def float32_advice(mean: Array, cov: Array, components: Sequence[str], printed: int = 0) -> str:
    """Return the spacing of float32 at the largest coordinates, and advice.

    A spacing is large if it exceeds a twentieth of the least standard deviation of a component: rounding
    then adds errors.

    Parameters
    ----------
    mean : array (n, ...)
        Means of the estimates.
    cov : array (n, n, ...)
        Covariances of the estimates.
    components : sequence of str
        Names of the n components.
    printed : int
        Number of digits of the estimates, whose spacing counts; 0 for numbers of float32.

    Returns
    -------
    str
        Advice on the component with the largest spacing in standard deviations; empty if all are small.
    """
    texts = []
    worst_share = _LARGE_SPACING
    for i, name in enumerate(components):
        magnitude = np.nanmax(np.abs(mean[i]), initial=0.0)
        variances = cov[i, i]
        positive = variances[variances > 0.0]
        if not np.isfinite(magnitude) or not positive.size:
            continue
        least_sigma = float(np.sqrt(positive.min()))
        spacing = float(np.spacing(np.float32(magnitude)))
        numbers = "float32 has"
        remedy = "move the origin of the coordinates near to the target, or compute in double; the"
        remedy += " Joseph form does not help"
        if printed:
            # The last of the digits: 0.01 of the 8 digits of 300000.12.
            spacing = 0.0
            if magnitude > 0.0:
                spacing = 10.0 ** (np.floor(np.log10(magnitude)) + 1.0 - printed)
            numbers = f"answers of {counted(printed, 'digit')} have"
            remedy = PRINT_ALL_DIGITS
        if spacing > worst_share * least_sigma:
            # Each text is of a larger share than the one before: the last one is the worst.
            worst_share = spacing / least_sigma
            texts.append(
                f"{numbers} a spacing of {spacing:.2g} at {name} = {magnitude:.3g}, whose standard "
                f"deviation is {least_sigma:.2g}: {remedy}"
            )
    return texts[-1] if texts else ""


PRINT_ALL_DIGITS = "print 17 digits, as by `%.17g`, or in C++ `std::cout.precision(17)`"
FLOAT32_NOTE = (
    "the answers have the digits of float32. They are rounded to 6e-8 of their size, such as 100 km to "
    "4 mm, and over many steps a covariance may lose its symmetry or become indefinite. This is no "
    "mistake if your filter computes in float32"
)
