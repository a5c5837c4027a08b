"""Messages on two files whose clocks share no time axis, or are more than a day apart."""

from datetime import timedelta
from typing import NamedTuple

from trackbench.errors import Answer
from trackbench.scenarios.recordings.clock_kinds import ABSOLUTE, EPOCH, FileClock

_DAY = 86400.0


class Mismatch(NamedTuple):
    """Message on two clocks, and the key that it proposes."""

    message: str
    answer: Answer | None = None


def reason_against(first: FileClock, other: FileClock) -> Mismatch:
    """Return the message on two files whose clocks share no time axis, and what to write.

    ``first`` is the clock of the first file, and ``other`` that of the file in which the error is
    raised.
    """
    message = f"its column {other.column} has {other.in_words}, and that of {first.path}"
    message += f" {first.in_words}"
    kinds = {first.kind, other.kind}
    if "date" in kinds and kinds & {*ABSOLUTE}:
        dates = first if first.kind == "date" else other
        message += f": which zone have the dates in {dates.column} of {dates.path}?"
        answer = Answer("zone", "UTC", dates.path)
        offset = 'or their offset from UTC, such as `zone: "+02:00"`'
        return Mismatch(f"{message} Say {answer.in_yaml}, {offset}", answer)
    if "gps" in kinds and kinds & {*ABSOLUTE}:
        gps = first if first.kind == "gps" else other
        message += ": GPS is ahead of UTC by leap seconds, 18 s since 2017"
        if gps.counts_weeks:
            # Weeks of GPS cannot count from 1970.
            return Mismatch(f"{message}: write UNIX times into the file {gps.path}")
        answer = Answer("zone", "UTC", gps.path)
        message += ";"
        message += f" if {gps.column} of {gps.path} counts from 1970 in UTC, say {answer.in_yaml},"
        return Mismatch(f"{message} or else write UNIX times into the file", answer)
    if "number" in kinds and len(kinds) == 2:
        remedy = "use one kind; dates with a zone and UNIX times, seconds since 1970, go together"
        return Mismatch(f"{message}: {remedy}")
    return Mismatch(f"{message}: use one kind")


def reason_against_spans(first: FileClock, other: FileClock) -> Mismatch | None:
    """Return the message on UNIX times and dates more than a day apart; None if they are not.

    It is raised in the file of ``other``, which "its column" means.
    """
    if first.kind == other.kind or "unix" not in (first.kind, other.kind):
        return None
    if not (first.is_absolute and other.is_absolute):
        return None
    is_near = other.span[0] <= first.span[1] + _DAY and first.span[0] <= other.span[1] + _DAY
    if is_near:
        return None
    unix = first if first.kind == "unix" else other
    message = f"its column {other.column} has {other.in_words} {_span_in_words(other)}, and that of"
    message += f" {first.path} {first.in_words} {_span_in_words(first)}"
    remedy = f"correct the unit of {unix.column} (`units: {{time: ms}}`), or write dates if it"
    return Mismatch(f"{message}, more than a day apart: {remedy} does not count from 1970")


def _span_in_words(clock: FileClock) -> str:
    """Return words for the first and the last time of a clock that counts from 1970.

    They are as in "from 2024-05-14 09:31 to 2024-05-14 09:46".
    """
    first, last = (
        (EPOCH + timedelta(seconds=time)).strftime("%Y-%m-%d %H:%M") for time in clock.span
    )
    return f"from {first} to {last}"
