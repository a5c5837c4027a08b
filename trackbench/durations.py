"""Durations in words, as of a filter's run or of a computation to come; times of a clock as text."""

_UNITS_OF_RUN = ((1.0, "s"), (1e3, "ms"), (1e6, "µs"))
"""Units of time, the largest first, with how many of each are a second."""
_FEWEST_HOURS = 2
_FEWEST_MINUTES = 2
_MOST_SECONDS = 100
_LARGE_TIME = 1000.0
"""Time from which on nine digits would be coarser than a microsecond"""


def cpu_time_in_words(seconds: float) -> str:
    """Write the CPU time of a run in the largest unit of which there is at least one: ``1.2 ms``."""
    units = [(number, unit) for number, unit in _UNITS_OF_RUN if seconds * number >= 1.0]
    units_per_second, unit = next(iter(units), _UNITS_OF_RUN[-1])
    return f"{two_digits(seconds * units_per_second)} {unit}"


def expected_time_in_words(seconds: float) -> str:
    """Write the time that a computation will take: two digits of hours, minutes or at least a second.

    Parameters
    ----------
    seconds
        expected time in s

    Returns
    -------
    str
        ``2.5 h`` from two hours on, ``12 min`` from two minutes on, else such as ``30 s``, at least ``1
        s``
    """
    hours = seconds / 3600
    minutes = seconds / 60
    if hours >= _FEWEST_HOURS:
        return f"{two_digits(hours)} h"
    if minutes >= _FEWEST_MINUTES:
        return f"{two_digits(minutes)} min"
    return f"{two_digits(max(seconds, 1.0))} s"


def listed_time_in_words(seconds: float | None) -> str:
    """Write the time in a list of experiments: whole seconds or minutes.

    Parameters
    ----------
    seconds
        time in s; None if it is unknown

    Returns
    -------
    str
        ``45 s`` below 100 s, else such as ``12 min``; empty if the time is unknown
    """
    if seconds is None:
        return ""
    if seconds < _MOST_SECONDS:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min"


def time_text(time: float) -> str:
    """Write a time or step of a recording to the microsecond: 1718023412.337 and never 1.718e+09."""
    if abs(time) < _LARGE_TIME:
        return f"{time:.9g}"
    return f"{time:.6f}".rstrip("0").rstrip(".")


def two_digits(number: float) -> str:
    """Round to two digits, and write a larger number without an exponent."""
    return f"{float(f'{number:.2g}'):g}"
