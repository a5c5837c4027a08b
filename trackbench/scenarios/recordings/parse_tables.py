"""Columns of CSV and Parquet files as arrays, parsed piece by piece, with the line of every mistake."""

import re
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from itertools import chain, islice
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackbench.core.arrays import Index
from trackbench.errors import counted
from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.csv_layout_and_rows import (
    Layout,
    TextFormat,
    layout_of,
    table_rows,
)
from trackbench.scenarios.recordings.header_line import check_header, is_value
from trackbench.scenarios.recordings.parquet_files import is_parquet, read_parquet, texts_of_cells
from trackbench.scenarios.recordings.parse_dates import instant, type_of_clock
from trackbench.scenarios.recordings.parse_numbers import (
    Parse,
    number,
    parse_cells,
    remedy_for_text,
    seconds,
    whole,
    without_thousands,
)

_TIME_OF_DAY = re.compile(r" *[0-9]{1,2}:[0-9]{2}")
_DIGITS_OF_DAY = re.compile(r" *([0-9]{1,6}|[0-9]{1,2}(\.[0-9]{2}){2})(\.|$)")


Content = Literal["number", "time", "date", "step", "label", "word"]
"""What a column's cells are. A label and a word stand for themselves, and a word may be empty."""
_MOST_MISTAKES = 20
_MOST_KINDS = 5
MISSING_LABEL = "is missing"
"""mistake of an empty cell in a column that names the run or the sensor of each row"""
_ROWS_AT_A_TIME = 50_000
Column = NDArray[Any]
WholeNumbers = NDArray[np.integer[Any]]
_PARSERS: dict[Content, Parse] = {"number": number, "time": seconds, "step": whole}


class Table(NamedTuple):
    """R rows of a file."""

    path: str
    columns: dict[str, Column]
    """cells (R,) of each column, by its name: numbers, or codes of words"""
    words: dict[str, list[str]]
    """words that the codes of a column of labels or words stand for"""
    lines: Index
    """line (R,) of each row"""
    dated: str
    """"date" or "date with a zone" if times are dates, as microseconds since 1970; else empty"""

    def at(self, rows: Index) -> "Table":
        """Return the table with the rows of these indices."""
        columns = {name: column[rows] for name, column in self.columns.items()}
        return self._replace(columns=columns, lines=self.lines[rows])


def header(path: str, text_format: TextFormat | None = None) -> list[str]:
    """Read the names of a table's columns. Raises DataError if the line of names has values instead."""
    if is_parquet(path):
        return [str(name) for name in read_parquet(path, None)]
    layout = layout_of(path, text_format)
    # The line of names has the number 0 if the config names the columns.
    if layout.header:
        check_header(path, layout.header, layout.names)
    return layout.names


def read_table(
    path: str,
    contents: Mapping[str, Content],
    time_format: str = "",
    text_format: TextFormat | None = None,
) -> Table:
    """Read columns of a table; raises DataError with up to twenty mistakes and their lines.

    ``contents`` has the columns to be read, and what their cells are. Dates are in ISO 8601, or in the
    format ``time_format`` of strptime. ``text_format`` is that of a text file; what it leaves open is
    detected.
    """
    table_reader = _Reading(path, contents, time_format)
    if is_parquet(path):
        # Parquet: the cells become text, so that both formats have the same parsers.
        frame = read_parquet(path, list(contents))
        # Its rows get the line numbers that they would have in a CSV, from 2 on.
        cells = {name: texts_of_cells(frame[name]) for name in contents}
        table_reader.add(np.arange(2, len(frame) + 2), cells)
        return table_reader.table()
    layout = layout_of(path, text_format)
    # Commas in cells that commas do not separate are decimal signs.
    decimal = None
    if text_format is not None:
        decimal = text_format.decimal
        table_reader.thousands = text_format.thousands
    table_reader.may_have_commas = decimal is None and layout.separator != ","
    table_reader.comma = decimal == ","
    for name in contents:
        if layout.names.count(name) > 1:
            raise DataError(Place(path, max(layout.header, 1), 1, f"two columns {name}"))
    numbered_rows = table_rows(path, layout)
    # Read piece by piece, until there are too many mistakes.
    while len(table_reader.mistakes) < _MOST_MISTAKES:
        piece = list(islice(numbered_rows, _ROWS_AT_A_TIME))
        if not piece:
            break
        full_rows = table_reader.rows_of_full_width(piece, layout)
        if full_rows:
            columns: list[Sequence[str]] = list(
                zip(*(cells for _, cells in full_rows), strict=True)
            )
            cells_by_name = {name: columns[layout.names.index(name)] for name in contents}
            table_reader.add(np.array([line for line, _ in full_rows]), cells_by_name)
    return table_reader.table()


def first_rows(path: str, text_format: TextFormat | None, number: int) -> list[list[str]]:
    """Read those of the first ``number`` rows, as text, that have the right number of cells."""
    return [cells for _, cells in numbered_rows(path, text_format, number)]


def numbered_rows(
    path: str, text_format: TextFormat | None, number: int | None = None
) -> Iterator[tuple[int, list[str]]]:
    """Yield line number and cells, as text, of the first ``number`` rows; by default of all rows.

    Rows with a wrong number of cells are left out, though they count among these ``number`` rows.
    """
    if is_parquet(path):
        frame = read_parquet(path, header(path)).iloc[:number]
        columns = [texts_of_cells(frame[name]) for name in frame]
        # Its rows have the line numbers of a CSV, from 2 on.
        yield from enumerate(map(list, zip(*columns, strict=True)), 2)
        return
    layout = layout_of(path, text_format)
    for line, cells in islice(table_rows(path, layout), number):
        if len(cells) == len(layout.names):
            yield line, [*map(str.strip, cells)]


class _Reading:
    """Conversion of a table's cells to arrays, one piece of its rows after the other."""

    def __init__(self, path: str, contents: Mapping[str, Content], date_format: str) -> None:
        """Begin a table without rows.

        ``contents`` has the columns to be read and what their cells are, ``date_format`` is that of
        dates.
        """
        # A date that stands beside the time is put before it.
        self._date = next((name for name, content in contents.items() if content == "date"), None)
        self.contents = {name: kind for name, kind in contents.items() if kind != "date"}
        self.path = path
        self.date_format = date_format
        self.may_have_commas = False
        """True if the cells decide whether decimals follow a comma: the config does not say it, and
        commas do not separate cells"""
        self.comma = False
        """True if decimals follow a comma: the config says so, or a cell with a comma was read"""
        self.thousands = ""
        """mark between groups of three digits"""
        self.mistakes: list[Place] = []
        self.dated: str | None = None
        """type of the clock as `Table.dated`; None until the first time is read"""
        # Values of each column, and line numbers, of every piece that was added; code of each word.
        self._pieces: dict[str, list[Column]] = {name: [] for name in self.contents}
        self._codes: dict[str, dict[str, int]] = {
            name: {} for name, content in self.contents.items() if content in ("label", "word")
        }
        self._lines: list[Index] = []

    def rows_of_full_width(
        self, rows: Sequence[tuple[int, list[str]]], layout: Layout
    ) -> Sequence[tuple[int, list[str]]]:
        """Return the rows with a cell for each column; add a mistake for each other row.

        ``rows`` are pairs of line number and cells. If many rows have the same wrong number of cells,
        one mistake stands for all of them.
        """
        width = len(layout.names)
        wrong = [(line, len(cells)) for line, cells in rows if len(cells) != width]
        if not wrong:
            return rows
        message = f"under {counted(width, 'column')}"
        numbers = {number for _, number in wrong}
        # Decimal commas between commas cut every number in two.
        is_decimal_comma = layout.separator == "," and numbers == {2 * width}
        # Many rows are more than half as many as the mistakes that a message may list.
        if len(numbers) == 1 and len(wrong) > _MOST_MISTAKES // 2 and not is_decimal_comma:
            # One mistake stands for all rows with this number of cells.
            line, number = wrong[0]
            alike = f" ({len(wrong) - 1} more rows are alike)"
            first_words = {cells[0] for _, cells in rows if cells and not is_value(cells[0])}
            if 1 < len(first_words) <= _MOST_KINDS:
                kinds = ", ".join(sorted(first_words))[:60]  # the message stays short
                alike += f": rows of several kinds ({kinds}) need a file each"
            self.mistakes.append(
                Place(self.path, line, 1, f"{counted(number, 'cell')} {message}{alike}")
            )
            return [row for row in rows if len(row[1]) == width]
        if is_decimal_comma:
            message += ": where decimals follow a comma, cells need another separator"
        mistakes = [(line, f"{counted(number, 'cell')} {message}") for line, number in wrong]
        self._add_mistakes(mistakes, len(rows))
        return [row for row in rows if len(row[1]) == width]

    def _add_mistakes(self, wrong: Sequence[tuple[int, str]], rows: int) -> None:
        """Append mistakes of some ``rows`` rows: only the first one if most have one, or all are equal.

        Each one of ``wrong`` is a line number and a text.
        """
        has_one_message = len({message for _, message in wrong}) == 1
        if len(wrong) > max(_MOST_MISTAKES // 2, rows // 2) or (has_one_message and len(wrong) > 2):
            (line, message), *more = wrong
            wrong = [(line, f"{message} ({len(more)} more rows are alike)")]
        self.mistakes += [Place(self.path, line, 1, message) for line, message in wrong]

    def add(self, lines: Index, cells: Mapping[str, Sequence[str]]) -> None:
        """Parse and append rows: their line numbers ``lines`` (R,), and the R cells of each column."""
        # The first number with a comma shows that decimals follow a comma in the whole file.
        if self.may_have_commas and not self.comma:
            numbers = (
                cells[name] for name, content in self.contents.items() if content == "number"
            )
            self.comma = self.thousands != "," and any(
                "," in cell for cell in chain.from_iterable(numbers)
            )
        for name, content in self.contents.items():
            values: Column
            column = cells[name]
            is_number = content == "number" or (content == "time" and not self.date_format)
            if self.thousands and is_number:
                column = [without_thousands(cell, self.thousands) for cell in column]
            # A time of day gets the date of its own column before it. All times of a column are written
            # in one form, so that the first one shows it; other ones are reported as mistakes.
            if content == "time" and self._date is not None and self._is_time_of_day(column[0]):
                dates_and_times = zip(cells[self._date], column, strict=True)
                column = [f"{date.strip()} {time.strip()}" for date, time in dates_and_times]
            if content in ("label", "word"):
                values, wrong = self._encode_words(name, column)
            else:
                # The parser reads decimals behind a comma if the file has them.
                parser = self._parser(content, column, Place(self.path, int(lines[0]), 1, name))
                values, wrong = parse_cells(parser, column)
            self._pieces[name].append(values)
            mistakes = []
            for i, message in wrong:
                remedy = ""
                if is_number and message.endswith((" a number", " a finite number")):
                    remedy = remedy_for_text(column[i].strip(), is_time=content == "time")
                mistakes.append((int(lines[i]), f"{name}: {message}{remedy}"))
            self._add_mistakes(mistakes, len(column))
        self._lines.append(lines.astype(np.int32))

    def _is_time_of_day(self, cell: str) -> bool:
        """Test whether a cell is a time of day without a date, such as 9:58, 095800 or 09.58.00.

        Digits alone are one only if the format of dates has a day and a time of day.
        """
        has_digits = " " in self.date_format and _DIGITS_OF_DAY.match(cell) is not None
        return has_digits or _TIME_OF_DAY.match(cell) is not None

    def table(self) -> Table:
        """Return all rows that were added. Raises DataError if any has a mistake, or there is none."""
        if not self._lines and not self.mistakes:
            self.mistakes.append(Place(self.path, 1, 1, "has no rows"))
        if self.mistakes:
            places = sorted(self.mistakes, key=lambda place: place.line)
            raise DataError(*places[:_MOST_MISTAKES])
        # The pieces of a column are dropped as it is joined, so that only one column is in memory twice.
        columns = {name: np.concatenate(self._pieces.pop(name)) for name in self.contents}
        words = {name: list(codes) for name, codes in self._codes.items()}
        return Table(
            path=self.path,
            columns=columns,
            words=words,
            lines=np.concatenate(self._lines),
            # "date" or "date with a zone"; empty if times are numbers, or if no times were read (None)
            dated=self.dated or "",
        )

    def _parser(self, content: Content, cells: Sequence[str], first: Place) -> Parse:
        """Return the parser of cells with this ``content``, some of which are ``cells``.

        The first cell of all times decides whether they are dates, dates with a zone, or numbers.
        `dated` is None before it, and then "date", "date with a zone", or empty for numbers. ``first``
        is the place of the first cell, whose message is the name of the column.
        """
        plain = _PARSERS.get(content, seconds)
        if self.comma and plain in (number, seconds):
            plain = partial(plain, comma=True)
        if content != "time":
            return plain
        if self.dated is None:
            self.dated = type_of_clock(cells[0].strip(), plain, self.date_format, first)
        if not self.dated:
            return plain
        return partial(instant, zoned=self.dated != "date", date_format=self.date_format)

    def _encode_words(
        self, name: str, cells: Sequence[str]
    ) -> tuple[Column, list[tuple[int, str]]]:
        """Return the codes (R,) of the words in the column ``name``, and the indices of missing labels.

        Each index has a reason. The same word has the same code in all pieces of the table.
        """
        codes = self._codes[name]
        values = np.array(
            [codes.setdefault(cell.strip(), len(codes)) for cell in cells], dtype=np.int32
        )
        # A word may be empty; a label, such as a target's, may not.
        if "" not in codes or self.contents[name] == "word":
            return values, []
        missing = np.flatnonzero(values == codes[""]).tolist()
        return values, [(i, MISSING_LABEL) for i in missing]
