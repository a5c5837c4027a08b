"""Layout of a text table, from its first lines: encoding, separator, header; its lines as cells."""

import codecs
import csv
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from itertools import islice, pairwise
from typing import Literal, NamedTuple, TextIO

from trackbench.errors import reason
from trackbench.field_types import DataError, InvalidKeyError, Natural, Place
from trackbench.readable_files import require_regular_file
from trackbench.scenarios.recordings.header_line import (
    BEFORE_NAMES,
    find_header,
    names_beside_week,
    split_cells,
    split_names,
)
from trackbench.scenarios.recordings.refused_gpx_json_nmea_and_mixed_logs import (
    check_first_line,
    check_kinds_of_rows,
    explain_no_text,
)

_LONGEST_LINE = 1_000_000  # characters: a file without line breaks is not read into memory
_MOST_COMMENTS = 10_000  # lines
_LOOKED_AT = 200  # lines that are not comments
_COMMENTS = ("#", "%", "//")
_SEPARATORS = (";", "\t", "|", ",", " ")
_WORDS = {"tab": "\t", "space": " "}
_DATE = re.compile(r"\d{1,4}([-/.])\d{1,2}\1\d{1,4}")
_ALIKE = 0.9
"""share of the lines that must have the same number of cells"""


def _decode_windows(error: UnicodeError) -> tuple[str, int]:
    """Decode bytes that are not UTF-8 as Windows-1252, or as Latin-1 where that has no letter.

    This is a handler of decoding errors (`codecs.register_error`). Return the text of the wrong bytes,
    and the position at which decoding goes on.
    """
    if not isinstance(error, UnicodeDecodeError):
        raise error
    wrong = error.object[error.start : error.end]
    try:
        return wrong.decode("cp1252"), error.end
    except UnicodeDecodeError:
        return wrong.decode("latin-1"), error.end


codecs.register_error("trackbench.windows", _decode_windows)


@dataclass(frozen=True, kw_only=True)
class TextFormat:
    """Format of a text table; the first lines decide on keys that are unset."""

    separator: str = ""
    """character between cells, or `tab`, or `space` for any white space"""
    decimal: Literal[".", ","] | None = None
    """decimal sign; default: a comma if cells of numbers have one"""
    thousands: Literal["", ".", ",", "'"] = ""
    """mark between groups of three digits: "." of 1.234.567"""
    encoding: str = ""
    """name of an encoding; default: UTF-8, or UTF-16, and other bytes as Windows-1252"""
    header: Natural = 0
    """number of the line with the columns' names, from 1 on"""
    names: tuple[str, ...] = ()
    """names of the columns, where no line has them"""
    skip: Natural = 0
    """number of lines between the names and the data, such as a line of units"""

    def __post_init__(self) -> None:
        """Raise InvalidKeyError for a key that is impossible or contradicts another one."""
        if len(_WORDS.get(self.separator, self.separator)) > 1:
            raise InvalidKeyError("is one character, `tab` or `space`", "separator")
        if self.thousands and self.thousands == self.decimal:
            message = f"is {self.thousands!r}, as the decimal sign is; leave one out"
            raise InvalidKeyError(message, "thousands")
        if self.header and self.names:
            raise InvalidKeyError("names replace the line of the header: leave one out", "names")
        if self.encoding:
            try:
                codecs.lookup(self.encoding)
            except LookupError:
                raise InvalidKeyError("is no encoding that Python knows", "encoding") from None


class Layout(NamedTuple):
    """Format of a text file, in which nothing is left open."""

    encoding: str
    separator: str
    names: list[str]
    """names of the columns"""
    header: int
    """line of the names, 0 if there is none"""
    before: int
    """number of lines before the data, those of the header and of units included"""
    joined: int | None
    """index of a cell with a date that white space separates from its time of day in the next cell:
    both become one cell; None without such cells"""
    is_comment: bool = False
    """True if the line of the names is a comment"""


def layout_of(path: str, text_format: TextFormat | None = None) -> Layout:
    """Detect the format that ``text_format`` leaves open from a file's first lines. Raises DataError.

    Without a ``text_format`` everything is open.
    """
    text_format = text_format or TextFormat()
    with _opened(path, text_format.encoding) as text:
        try:
            return _layout(path, text, text_format)
        except csv.Error as error:
            raise DataError(Place(path, 1, 1, f"not a CSV: {error}")) from None


def _encoding(path: str) -> str:
    """Detect the encoding of a text file from its first bytes: UTF-8 or UTF-16."""
    with require_regular_file(path).open("rb") as file:
        head = file.read(256)
    if head[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE):
        return "utf-16"
    # UTF-16 without a byte order mark: plain letters have a zero in every second byte.
    for first, encoding in ((1, "utf-16-le"), (0, "utf-16-be")):
        if len(head) > 2 and not any(head[first::2]) and all(head[1 - first :: 2]):
            return encoding
    return "utf-8-sig"


@contextmanager
def _opened(path: str, encoding: str) -> Iterator[TextIO]:
    """Open a text file within a ``with`` block; an empty ``encoding`` is detected.

    Raises DataError if the file, or a line that the block reads, is no text.
    """
    try:
        encoding = encoding or _encoding(path)
        file = require_regular_file(path)
        # The handler of errors is `_decode_windows`.
        with file.open(newline="", encoding=encoding, errors="trackbench.windows") as text:
            yield text
    except OSError as error:
        raise DataError(Place(path, 1, 1, reason(error))) from None
    except UnicodeError:
        raise DataError(Place(path, 1, 1, explain_no_text(path))) from None


def _layout(path: str, text: TextIO, text_format: TextFormat) -> Layout:
    """Detect what ``text_format`` leaves open of an open file's format; DataError if it is no table."""
    # Step 1: take the first lines, comments and others.
    separator = _WORDS.get(text_format.separator, text_format.separator)
    comments: dict[int, str] = {}
    lines: dict[int, str] = {}
    for number, line in enumerate(iter(lambda: text.readline(_LONGEST_LINE), ""), 1):
        # Lines above the header that the config names are skipped; it is 0 if the config names none.
        if number < text_format.header or not line.strip():
            continue
        # Spreadsheets may write the separator into the first line: sep=;
        if not lines and line.lower().startswith("sep=") and len(line) > len("sep="):
            separator = separator or line[len("sep=")]
        elif line.startswith(_COMMENTS) and number != text_format.header:
            comments[number] = line.lstrip("#%/ \t")
        else:
            lines[number] = line
        if len(lines) >= _LOOKED_AT or len(comments) >= _MOST_COMMENTS:
            break
    if not lines:
        message = "has no rows" if comments else "is empty"
        raise DataError(Place(path, 1, 1, message))
    first = next(iter(lines))
    check_first_line(path, first, lines[first])
    # Step 2: find the separator, the usual number of cells, and a date and a time of day that white
    # space separates.
    separator = separator or _guess_separator([*lines.values()])
    cells = {number: split_cells(line, separator) for number, line in lines.items()}
    width, _ = _usual_width(cells.values())
    rows = [row for row in cells.values() if len(row) == width]
    # The last row shows it: the first ones may be names or units.
    joined = None
    for i, (cell, next_cell) in enumerate(pairwise(rows[-1])):
        if _is_date_and_time(cell, next_cell):
            joined = i
            break
    # Step 3: find the header: the last comment above numbers, or the fullest line of words.
    start = next(number for number, row in cells.items() if len(row) == width)
    check_kinds_of_rows(path, cells, separator)
    if text_format.names:
        return Layout(
            encoding=text.encoding,
            separator=separator,
            names=list(text_format.names),
            header=0,
            before=start - 1 + text_format.skip,
            joined=None,
        )
    # A log of RTKLIB has its names in a comment, in which one name stands for two columns: the GPS week
    # and the seconds in it.
    names = names_beside_week(comments, rows)
    if names:
        header = max(number for number in comments if number < start)
        return Layout(
            encoding=text.encoding,
            separator=separator,
            names=names,
            header=header,
            before=header + text_format.skip,
            joined=None,
            is_comment=True,
        )
    widths = [width]
    if joined is not None:
        widths.append(width - 1)
    header = first
    if not text_format.header:
        header = find_header(cells, comments, separator, widths)
    if separator == " " and header not in comments:
        cells[header] = split_names(lines[header], (separator, BEFORE_NAMES), widths)
    names = [name.strip() for name in cells[header]]
    names[0] = names[0].lstrip("#% ")
    # A table of pandas has an index without a name.
    names = [name or f"column {number}" for number, name in enumerate(names, 1)]
    # A date and its time of day are two cells below one name only if there is a name too few.
    if not (separator == " " and len(names) == width - 1):
        joined = None
    return Layout(
        encoding=text.encoding,
        separator=separator,
        names=names,
        header=header,
        before=header + text_format.skip,
        joined=joined,
        is_comment=header in comments,
    )


def _is_date_and_time(cell: str, after: str) -> bool:
    """Test whether two neighboring cells are a date and a time of day."""
    return _DATE.fullmatch(cell) is not None and re.match(r"\d{1,2}:\d\d", after) is not None


def _usual_width(rows: Iterable[list[str]]) -> tuple[int, int]:
    """Return the most frequent number of cells in a row, and how many rows have it."""
    return Counter(map(len, rows)).most_common(1)[0]


def _guess_separator(lines: Sequence[str]) -> str:
    """Return the separator by which nearly all lines in the second half have the same number of cells.

    A separator by which the first line has this number, too, is preferred. If there is none, it is the
    most frequent one in the first line.
    """
    without_first_line = ""
    below = lines[len(lines) // 2 :]  # the first lines may be titles
    for separator in _SEPARATORS:
        width, number = _usual_width(split_cells(line, separator) for line in below)
        if width > 1 and number >= _ALIKE * len(below):
            if len(split_cells(lines[0], separator)) == width:
                return separator
            without_first_line = without_first_line or separator
    if without_first_line:
        return without_first_line
    unquoted = re.sub('"[^"]*"', "", lines[0].strip())
    other_than_space = _SEPARATORS[:-1]
    most_frequent = max(other_than_space, key=unquoted.count)
    return most_frequent if most_frequent in unquoted else " "


def table_rows(path: str, layout: Layout) -> Iterator[tuple[int, list[str]]]:
    """Yield the line number and cells of every row below the header; skip empty lines and comments.

    Raises DataError for a file that is no table, and for a line that repeats the names of the columns.
    """
    with _opened(path, layout.encoding) as text:
        yield from _numbered_rows(path, text, layout)


def _numbered_rows(path: str, text: TextIO, layout: Layout) -> Iterator[tuple[int, list[str]]]:
    """Yield the line number and cells of every row below the header of an open file.

    Comments and lines without any cell that is filled are skipped. Spreadsheets write such lines of
    separators alone. Raises DataError for a file that is no table, and for a line that repeats the names
    of the columns.
    """
    width = len(layout.names)
    first_name = layout.names[0] if layout.header else None
    separator = layout.separator
    # `before` counts all lines above the data, the header included.
    data_lines = islice(iter(partial(text.readline, _LONGEST_LINE), ""), layout.before, None)
    # A comment becomes an empty line, so that the reader counts it.
    lines = ("\n" if line.startswith(_COMMENTS) else line for line in data_lines)
    if separator == " ":  # any white space, which the reader of CSV does not know
        separator = "\t"
        # A date and its time of day become one cell, if the layout has the index of the date.
        lines = (_with_tabs(line, layout.joined) for line in lines)
    reader = csv.reader(lines, delimiter=separator)
    line = layout.before
    try:
        for row in reader:
            end = layout.before + reader.line_num
            if end > line + 1 and _holds_rows(row, separator, width):
                message = (
                    f"a quote that opens in this line closes in line {end}, after further rows"
                )
                raise DataError(Place(path, line + 1, 1, f"{message}: close it, or leave it out"))
            line = end
            # A separator at the end of a row gives an empty cell too many.
            if len(row) == width + 1 and not row[-1].strip():
                row.pop()
            # The first cell is compared first, as it decides for nearly all rows.
            if row and row[0] == first_name and [*map(str.strip, row)] == layout.names:
                message = (
                    "repeats the names of the columns: leave such lines out; if another recording"
                )
                remedy = (
                    "begins here, write it into a file of its own, or number them in a column run"
                )
                raise DataError(Place(path, line, 1, f"{message} {remedy}"))
            if any(row):
                yield line, row
    except csv.Error as error:
        message = f"not a CSV: {error}; is a quote in this line not closed?"
        raise DataError(Place(path, line + 1, 1, message)) from None


def _with_tabs(line: str, joined: int | None) -> str:
    """Return a line with tabs in place of white space; a date and its time of day become one cell.

    ``joined`` is the index of the date, None without one.
    """
    cells = line.split()
    if joined is not None:
        cells[joined : joined + 2] = [" ".join(cells[joined : joined + 2])]
    return "\t".join(cells) + "\n"


def _holds_rows(cells: list[str], separator: str, width: int) -> bool:
    """Test whether a row over several lines has whole rows in it, as a quote that is not closed causes.

    ``cells`` are those of the row, and ``width`` is the number of cells of a row.
    """
    further_lines = separator.join(cells).splitlines()[1:]
    return any(line.count(separator) >= width - 1 for line in further_lines)
