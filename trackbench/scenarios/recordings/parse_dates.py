"""Dates and times of day from cells, and the formats that are known."""

import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from itertools import product

import numpy as np

from trackbench.core.arrays import Array
from trackbench.errors import Answer
from trackbench.field_types import DataError, Place

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_NO_DATE = datetime(1900, 1, 1)  # as strptime has it
_UTC = re.compile(r" ?(UTC|GMT)$")
_OFFSET = re.compile(r" ([-+]\d\d:?\d\d)( [A-Z]{2,5}| [-+]\d+)?( m=[-+][0-9.]+)?$")
"""Offset behind a space, perhaps with the zone's name and a monotonic clock, as Go prints it."""
_DAY_OF_YEAR = re.compile(r"(\d{4})-(\d{3})(?=[T ]|$)|(\d{4})(\d{3})(?=T)")
"""Year and day of the year at the beginning of a date in ISO 8601: 2024-123, or 2024123 before a T."""
_DECIMAL_COMMA = re.compile(r",(\d+)$")
_NANOSECONDS = re.compile(r"([.,:]\d{6})\d+")
_ELAPSED = re.compile(r"(\d+):([0-5]\d(?:\.\d{1,6})?)")
"""Minutes, of which there may be more than 59, and seconds."""
_ELAPSED_HOURS = re.compile(r"(\d+):([0-5]\d):([0-5]\d(?:\.\d{1,6})?)")
"""Hours, of which there may be more than 23, minutes and seconds."""
_ELAPSED_DAYS = re.compile(r"(\d+) days? \+?(\d{1,2}:[0-5]\d:[0-5]\d(?:\.\d+)?)")
"""Days, hours, minutes and seconds, as pandas writes a difference of times."""
_NAMED_ZONE = re.compile(
    r"(?P<moment>\d{4}-\d\d-\d\d[T ]\d\d:\d\d(:\d\d)?(?P<fraction>\.\d+)?)"
    r"(?P<space> ?)(?P<zone>[A-Z]{2,5})"
)
"""Date in ISO 8601 before the name of a zone, such as CEST."""
_LEAP_SECOND = re.compile(r":\d\d:60(?!\d)")
"""Second that a day has which is longer than others: 23:59:60."""
_DIGITS_OF_CLOCKS = {"%H%M": 4, "%M%S": 4, "%M%S.%f": 4, "%H%M%S": 6, "%H%M%S.%f": 6}
"""Digits before the point of a time of day in one number, which may lack zeros at its beginning."""
_DIGITS_OF_DAYS = {"%d%m%y": 6, "%m%d%y": 6, "%y%m%d": 6, "%d%m%Y": 8, "%m%d%Y": 8}
"""Digits of a day in one number, which may lack a zero at its beginning: 30524 is 3 May 2024."""
_HALVES_OF_DAY = re.compile(r"\b([ap])\. ?m\.", re.IGNORECASE)
_MICROSECOND = timedelta(microseconds=1)
_MANY = 1000  # rows, from which on pandas is faster than strptime

_DAY_FORMATS = (
    "%d/%m/%Y", "%m/%d/%Y", "%d.%m.%Y", "%d-%m-%Y", "%m-%d-%Y", "%Y/%m/%d", "%Y.%m.%d",
    "%Y%m%d", "%d/%m/%y", "%m/%d/%y", "%d.%m.%y", "%d-%b-%Y", "%d-%b-%y", "%d %b %Y",
    "%b %d %Y", "%b %d, %Y", "%d %B %Y", "%B %d, %Y", "%Y:%m:%d", "%Y-%m-%d",
    "%d%m%y", "%y%m%d", "%m%d%y", "%d%m%Y", "%m%d%Y", "%Y%j", "%Y-%j", "%Y/%j",
)  # fmt: skip
"""Formats of a day, for strptime; %j is the day of the year."""
_TIME_FORMATS = (
    "%H:%M:%S", "%H:%M:%S.%f", "%H:%M:%S,%f", "%I:%M:%S %p", "%I:%M:%S.%f %p", "%I:%M:%S%p", "%H:%M",
    "%I:%M %p", "%I:%M%p", "%H%M%S", "%H%M%S.%f", "%H:%M:%S:%f", "%H.%M.%S", "%H%M",
)  # fmt: skip
"""Formats of a time of day."""
STAMP_FORMATS = (
    "%Y%m%d%H%M%S", "%Y%m%d%H%M%S%f", "%Y%m%d%H%M%S.%f", "%Y%m%d%H%M", "%y%m%d%H%M%S",
    "%d%m%y%H%M%S", "%d%m%Y%H%M%S", "%Y%m%d_%H%M%S", "%Y%j%H%M%S", "%Y%j%H%M%S.%f", "%y%j%H%M%S",
    "%Y%m%d%H",
)  # fmt: skip
"""Formats of a day and a time of day in one number."""
_WORDED_FORMATS = (
    "%a %b %d %H:%M:%S %Y", "%a %b %d %H:%M:%S %Z %Y", "%a %b %d %H:%M:%S GMT%z %Y",
    "%a, %d %b %Y %H:%M:%S %z", "%a, %d %b %Y %H:%M:%S %Z", "%d/%b/%Y:%H:%M:%S",
    "%d/%b/%Y:%H:%M:%S %z", "%Y:%j:%H:%M:%S", "%Y:%j:%H:%M:%S.%f", "%j/%H:%M:%S", "%j/%H:%M:%S.%f",
    "%j:%H:%M:%S", "%j:%H:%M:%S.%f",
)  # fmt: skip
"""Formats of a day and a time of day in mails, in logs and in telemetry."""
_MINUTE_FORMATS = ("%M:%S", "%M:%S.%f")
KNOWN_FORMATS = (
    *_TIME_FORMATS,
    *_MINUTE_FORMATS,
    *_DAY_FORMATS,
    *STAMP_FORMATS,
    *_WORDED_FORMATS,
    *map(" ".join, product(_DAY_FORMATS, _TIME_FORMATS)),
    *map("T".join, product(_DAY_FORMATS, _TIME_FORMATS[:3])),
)
"""Formats of dates and times that are detected without a format in the config."""

_DAY_BETWEEN_SEPARATORS = re.compile(r"(?<![\d.,])\d{3}(?!\d)")
"""Day of the year between separators."""
_DIGITS_ALONE = re.compile(r"(%[YyjmdHMS])+(\.?%f)?")
YEARS = (1950, 2100)
"""Least and largest year of a date in digits alone."""


def moment(cell: str, date_format: str = "") -> datetime:
    """Parse a date in ISO 8601, or in the ``date_format`` of strptime.

    Some cells that strptime rejects are read, too, such as nanoseconds. So are elapsed times with more
    than 59 minutes; like all times of day without a date they count from 1900-01-01, as strptime has
    it. Raises ValueError with words for what the cell should be.
    """
    try:
        if date_format.endswith(".%f"):
            # In tables with a decimal comma it stands before the fraction of a second, too.
            cell = _DECIMAL_COMMA.sub(r".\1", cell)
        if "%f" in date_format:
            # There may be nine digits of a second in place of six: the last three are left out.
            cell = _NANOSECONDS.sub(r"\1", cell)
        if "%p" in date_format:
            # Spreadsheets of some countries write a.m. or a. m. in place of AM.
            cell = _HALVES_OF_DAY.sub(r"\1m", cell.replace("\u00a0", " "))
        day_format, _, _ = date_format.partition(" ")
        if day_format in _DIGITS_OF_DAYS:
            # Without the zero strptime would take 30524 for 30 May.
            day, space, rest = cell.partition(" ")
            if day.isdigit() and len(day) == _DIGITS_OF_DAYS[day_format] - 1:
                cell = f"0{day}{space}{rest}"
        clock_format = date_format.rpartition(" ")[2]
        if clock_format in _DIGITS_OF_CLOCKS:
            cell = _with_zeros(cell, _DIGITS_OF_CLOCKS[clock_format])
        separator = date_format[-3:-2]  # between the seconds and %f
        has_digits = cell.count(separator) >= date_format.count(separator)
        if date_format.endswith("%f") and separator in {".", ",", ":"} and not has_digits:
            # A whole second may have no digits behind it: 12:00:05 in place of 12:00:05.0.
            cell += f"{separator}0"
        # Elapsed minutes may be more than 59, and elapsed hours more than 23. A format without %f allows
        # no decimals, so that a cell with a point is left to strptime, which rejects it.
        if date_format.startswith("%M:%S") and ("%f" in date_format or "." not in cell):
            elapsed = _ELAPSED.fullmatch(cell)
            if elapsed:
                seconds = 60 * int(elapsed[1]) + float(elapsed[2])
                return _NO_DATE + timedelta(microseconds=round(1e6 * seconds))
        if date_format.startswith("%H:%M:%S") and ("%f" in date_format or "." not in cell):
            elapsed = _ELAPSED_HOURS.fullmatch(cell)
            if elapsed:
                minutes = 60 * int(elapsed[1]) + int(elapsed[2])
                seconds = 60 * minutes + float(elapsed[3])
                return _NO_DATE + timedelta(microseconds=round(1e6 * seconds))
        if date_format:
            return _by_strptime(cell, date_format)
        elapsed = _ELAPSED_DAYS.fullmatch(cell)
        if elapsed:
            time_of_day = datetime.fromisoformat(f"1900-01-01 {elapsed[2].zfill(8)}")
            return time_of_day + timedelta(days=int(elapsed[1]))
        # fromisoformat takes an offset only without the space before it: 10:00:59 +0200 CEST becomes
        # 10:00:59+0200, and 10:00:59 UTC becomes 10:00:59+00:00.
        cell = _OFFSET.sub(r"\1", cell)
        day_of_year = _DAY_OF_YEAR.match(cell)
        if day_of_year is not None:
            cell = _with_month(cell, day_of_year)
        return datetime.fromisoformat(_UTC.sub("+00:00", cell))
    except ValueError:
        expected = "a time in ISO 8601"
        if date_format:
            expected = f"a time as {date_format}"
        if _LEAP_SECOND.search(cell):
            expected += " without leap seconds: leave the row out, or write times in seconds"
        raise ValueError(expected) from None


def _with_month(cell: str, day_of_year: re.Match[str]) -> str:
    """Return a date that begins with a match of `_DAY_OF_YEAR` with its month: 2024-05-02 for 2024-123.

    Raises ValueError for a day that the year lacks.
    """
    year, day, year_in_digits, day_in_digits = day_of_year.groups()
    date_format = "%Y-%m-%d" if year else "%Y%m%d"
    text = f"{year or year_in_digits} {day or day_in_digits}"
    return _by_strptime(text, "%Y %j").strftime(date_format) + cell[day_of_year.end() :]


def _by_strptime(cell: str, date_format: str) -> datetime:
    """Parse a date by strptime; raises ValueError for a day of the year that the year lacks, too.

    strptime takes day 366 of 2023 for the first day of 2024.
    """
    date = datetime.strptime(cell, date_format)
    if "%j" in date_format and date.strftime("%j").lstrip("0") not in cell:
        raise ValueError
    return date


def has_day(date_format: str) -> bool:
    """Test whether a format of dates has a day: that of the month, %d, or that of the year, %j."""
    return "%d" in date_format or "%j" in date_format


def may_lack_zero(day_format: str) -> bool:
    """Test whether a format of a day is a single number that begins with two digits, such as %d%m%y."""
    return day_format in _DIGITS_OF_DAYS


def _with_zeros(cell: str, digits: int) -> str:
    """Return a cell whose last part is a time of day in one number, filled with zeros: 000005 of 5.

    ``digits`` is the number of digits before the point.
    """
    date, space, clock = cell.rpartition(" ")
    whole, point, rest = clock.partition(".")
    return f"{date}{space}{whole.zfill(digits)}{point}{rest}"


def instant(cell: str, zoned: bool | None = None, date_format: str = "") -> float:
    """Return a date as microseconds since 1970, exactly; a date without a zone is in UTC.

    ``zoned`` says whether the date must have a zone or must have none; None allows both. ``date_format``
    is that of strptime, empty for ISO 8601. Raises ValueError with a text that says what is expected.
    """
    date = moment(cell, date_format)
    if zoned is not None and zoned != (date.tzinfo is not None):
        preposition = "with" if zoned else "without"
        raise ValueError(f"a time {preposition} a zone, as that of the first row is")
    if not date.tzinfo:
        date = date.replace(tzinfo=UTC)
    return float((date - _EPOCH) // _MICROSECOND)


def is_instant(cell: str) -> bool:
    """Test whether a cell with a time is a date in ISO 8601, and no number."""
    try:
        instant(cell.strip())
    except ValueError:
        return False
    return not cell.strip().replace(".", "").isdigit()  # 20160112 may be a number of seconds


def type_of_clock(
    cell: str, parse_number: Callable[[str], float], date_format: str, first: Place
) -> str:
    """Return the type of a column of times: "date", "date with a zone", or empty for numbers.

    ``cell`` is the first time, ``parse_number`` parses numbers, and ``date_format`` is that of strptime,
    empty for ISO 8601. ``first`` is the place of the cell, and its message is the column's name. Raises
    DataError if the cell is no time.
    """
    if date_format or is_instant(cell):
        with suppress(ValueError):
            return "date with a zone" if moment(cell, date_format).tzinfo else "date"
    if cell and not date_format:
        with suppress(ValueError):
            parse_number(cell)
            return ""
    message = f"{first.message}: {cell[:40]!r} is no number of seconds and no date in ISO 8601"
    if date_format:
        message = f"{first.message}: {cell[:40]!r} is not a time as {date_format}"
    remedy = 'say how it is written, `time_format: "%d/%m/%Y %H:%M:%S"` (or %m/%d/%Y, %H:%M:%S.%f)'
    answer: Answer | None = Answer("time_format", '"%d/%m/%Y %H:%M:%S"')
    named_zone = _NAMED_ZONE.fullmatch(cell)
    if named_zone and not date_format:
        value = _format_of_named_zone(named_zone)
        answer = Answer("time_format", value)
        message += f", as it ends with {named_zone['zone']}"
        remedy = f"if all times are in this zone, say `time_format: {value}`"
        remedy += ", and `zone` beside other files"
    if cell and not any(map(str.isdigit, cell)):
        answer = None
        remedy = "say `format: {skip: 1}` if the line holds units, or correct it"
    raise DataError(first._replace(message=f"{message}: {remedy}", answer=answer))


def _format_of_named_zone(date: re.Match[str]) -> str:
    """Return the format, as YAML, of dates such as a match of `_NAMED_ZONE`, whose zone is a text."""
    moment_in_cell = date["moment"]
    date_format = f"%Y-%m-%d{moment_in_cell[10]}%H:%M"
    if moment_in_cell.count(":") == 2:
        date_format += ":%S"
    if date["fraction"]:
        date_format += ".%f"
    return f'"{date_format}{date["space"]}{date["zone"]}"'


def dates_quickly(cells: Sequence[str], date_format: str) -> Array | None:
    """Return R dates as microseconds (R,) since 1970 by pandas, which is faster than cell by cell.

    Return None for few cells, for a format with a zone, and if a cell is no date of this format. Return
    None also for a format of minutes and seconds, as there may be more than 59 minutes, and if a day in
    one number lacks a zero at its beginning.
    """
    if len(cells) < _MANY or "%z" in date_format or date_format.startswith("%M"):
        return None
    digits = _DIGITS_OF_DAYS.get(date_format.partition(" ")[0], 0)
    if digits and any(len(cell.strip().partition(" ")[0]) < digits for cell in cells):
        return None
    import pandas as pd

    dates = pd.to_datetime(pd.Series(cells).str.strip(), format=date_format, errors="coerce")
    if dates.isna().any():
        return None
    return dates.to_numpy().astype("datetime64[us]").astype(np.int64).astype(np.float64)


def has_digits_of(date_format: str, cell: str) -> bool:
    """Test whether the parts of a cell that are digits alone have as many digits as the format.

    Without this test strptime reads 090324 by "%Y%m%d" as the 4th of February 903, and the month of
    2024-05 by "%Y-%j" as a day.
    """
    if "%j" in date_format and not _DIGITS_ALONE.fullmatch(date_format.partition(" ")[0]):
        return _DAY_BETWEEN_SEPARATORS.search(cell) is not None
    for format_part, cell_part in zip(date_format.split(" "), cell.split(" "), strict=False):
        if not _DIGITS_ALONE.fullmatch(format_part) or len(format_part) == 2:
            continue  # a part with separators, such as %H:%M, or one number of any length, such as %Y
        digits = len(re.match(r"\d*", cell_part)[0])  # type: ignore[index]
        wanted = format_part.count("%Y") * 4 + format_part.count("%j") * 3
        wanted += 2 * len(re.findall("%[ymdHMS]", format_part))
        least = wanted
        most = wanted
        if format_part.startswith("%H"):
            least = 1  # 93000 is 9:30:00, and 5 is 0:00:05
        elif may_lack_zero(format_part):
            least = wanted - 1  # 30524 is the 3rd of May 2024
        elif format_part.endswith("S%f"):  # one to six digits of a second without a point
            least = wanted + 1
            most = wanted + 6
        if not least <= digits <= most:
            return False
        if "%Y" in format_part:
            # Each number before the year has two digits, but for a zero that the first one may lack: the
            # year of 3052024 by %d%m%Y begins after three digits.
            place = re.sub("%Y.*", "", format_part).count("%") * 2
            place -= wanted - digits if least < wanted else 0
            if not YEARS[0] <= int(cell_part[place : place + 4]) <= YEARS[1]:
                return False
    return True
