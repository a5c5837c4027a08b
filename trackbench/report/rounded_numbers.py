"""Numbers as text: a value and its standard error, rounded to the same decimal place; also for LaTeX."""

import re
from math import ceil, floor, inf, isfinite, isinf, isnan, log10

from trackbench.report.findings import phrases

_SIGNED_ZERO = re.compile(r"(?<![\w.])[-+](0(\.0+)?)(?![\w.])")
_BELOW_TEN = 9.95
"""Ratio up to which a decimal does not round it to ten."""


def unsigned_zeros(text: str) -> str:
    """Return the text with its zeros, which were rounded, without a sign: ``0.0`` for ``-0.0``."""
    return _SIGNED_ZERO.sub(r"\1", text)


_ROUNDING = 0.5e-7
"""Share of a value below which its error is rounding: a tenth of what seven digits leave open."""
_USUAL_DIGITS = 4
"""Significant digits of most tables."""


def rounded(value: float, stderr: float, digits: int) -> str:
    """Write a value and its standard error, rounded to the same decimal place.

    The place is that of the error's first or second digit.

    Parameters
    ----------
    value, stderr
        number and its standard error; NaN if it has none
    digits
        significant digits of the value, if its error does not decide them

    Returns
    -------
    str
        text such as ``0.3164 ± 0.0080``, of very small and large numbers with exponents.
    """
    if not isfinite(value):
        return "infinite" if isinf(value) else "–"
    has_error = isfinite(stderr)
    # Decimals down to the last of so many digits, as far as the error's first two digits allow. An error
    # below the share `_ROUNDING` of the value is only that of rounding, and decides nothing.
    decimals = digits - 1 - _exponent(value)
    if has_error and stderr > _ROUNDING * abs(value):
        first_place = -_exponent(stderr)  # of the error's first digit, which is never cut to a zero
        second_place = first_place + 1
        decimals = min(max(decimals, first_place), second_place)
        if not value:  # zero has no digits of its own
            decimals = second_place
    decimals = max(decimals, 0)
    # A number with more decimals would be hard to read.
    needs_exponent = decimals > max(7, digits + 3) or abs(value) >= 1e6
    if needs_exponent and not has_error:
        return f"{value:.{_exact_places(digits)}e}"
    if needs_exponent:
        return f"{value:.{_places(value, stderr, digits)}e} ± {stderr:.1e}"
    # The format's z writes no minus before a zero.
    if not has_error:
        return f"{value:z.{decimals}f}"
    return f"{value:z.{decimals}f} ± {stderr:.{decimals}f}"


def _places(value: float, stderr: float, digits: int) -> int:
    """Count the decimals of a value that is written with an exponent, down to its error's second digit.

    There are at least two and at most six, or more if ``digits`` are more.
    """
    exact_places = _exact_places(digits)
    if not stderr > 0.0:
        return exact_places
    places_of_error = _exponent(value) - _exponent(stderr) + 1
    return min(max(2, places_of_error), max(6, exact_places))


def _exact_places(digits: int) -> int:
    """Count the decimals of a number that is written with an exponent and has no error.

    It has three significant digits, hence two decimals: ``3.16e-09``. It has ``digits`` significant
    digits if these are more than the usual four.
    """
    if digits > _USUAL_DIGITS:
        return digits - 1
    return 2


def in_tex(value: float, stderr: float, digits: int) -> str:
    """Return value and error for LaTeX's siunitx: ``5.96 +- 0.99 e-6``, one exponent for both.

    A value without an error has ``digits`` significant digits. One with an error goes down to the
    error's first or second digit, as in `rounded`. It may then have more digits, but no more than
    ``digits``, or four if ``digits`` is less. An error below half of the last digit is left out.
    """
    text = rounded(value, stderr, digits)
    most_digits = max(digits, _USUAL_DIGITS)
    # A number without an error: the text as it is, with a space before its exponent.
    if not isfinite(stderr):
        if "e" not in text:
            return text
        exponent = _exponent(value)
        return f"{value / 10.0**exponent:.{_exact_places(digits)}f} e{exponent}"
    # Step 1: the exponent of both.
    larger = float(f"{max(abs(value), stderr):.{most_digits - 1}e}")  # 9999.8 is 10000
    exponent = 0
    if "e" in text or larger >= 10.0**most_digits:
        exponent = _exponent(larger)
    mantissa = value / 10.0**exponent
    error = stderr / 10.0**exponent
    # Step 2: places as in `rounded`: those of the digits, or at most those down to the error's second
    # digit. An error below the share `_ROUNDING` of the value is that of rounding, and decides nothing.
    places = digits - 1 - _exponent(mantissa)
    if error > _ROUNDING * abs(mantissa):
        first_place = -_exponent(error)
        second_place = first_place + 1
        places = min(max(places, first_place), second_place)
        if not value:
            places = second_place
    first_digit = _exponent(larger) - exponent
    places = max(min(places, most_digits - 1 - first_digit), 0)
    # Step 3: the text.
    number = f"{mantissa:z.{places}f}"
    error_text = f"{error:.{places}f}"
    if float(error_text):
        number += f" +- {error_text}"
    if not exponent:
        return number
    return f"{number} e{exponent}"


def _exponent(x: float) -> int:
    """Return the exponent of the first digit: 2 of 316.4; 0 of zero."""
    if not x:
        return 0
    return floor(log10(abs(x)))


def multiple(ratio: float, width: float) -> str:
    """Write a ratio with the digits that its interval allows, three decimals at most: ``3.2``.

    ``width`` is that of the interval; if it is unknown or infinite, the ratio has three digits. Only a
    ratio that these would round to 1 has three decimals, as ``1`` would mean equal errors. With an
    interval a ratio below ten has a decimal in any case, as 2 in place of 1.5 would contradict the
    errors beside it. A ratio of a million or more has two digits and an exponent.
    """
    if abs(ratio) >= 1e6:
        return f"{ratio:.1e}"
    if not 0.0 < width < inf:
        text = phrases.rounded(ratio, 3)
        if text == "1" and ratio != 1.0:
            return f"{ratio:.3f}"
        return text
    # The interval is at least three units of the last decimal wide.
    decimals = ceil(log10(3.0 / width))
    fewest = 1 if abs(ratio) < _BELOW_TEN else 0
    return f"{ratio:.{min(3, max(fewest, decimals))}f}"


def range_in_words(low: float, high: float) -> str:
    """Write ``0.8 to 1.2``, ``< 2`` from zero, ``> 2`` to infinity; a dash if nothing is measured."""
    if isnan(low) and isnan(high):
        return number_or_dash(low)
    if low == high:
        return number_or_dash(low)
    if low == 0.0:
        return f"< {number_or_dash(high)}"
    if high == inf:
        return f"> {number_or_dash(low)}"
    return f"{number_or_dash(low)} to {number_or_dash(high)}"


def number_or_dash(value: float) -> str:
    """Write a number with three digits; a dash for NaN."""
    return "–" if isnan(value) else f"{value:.3g}"
