"""First rows of a table as text and numbers, from which a guess at it is made."""

from collections import Counter
from collections.abc import Collection, Iterator
from dataclasses import replace
from itertools import dropwhile, islice

import numpy as np

from trackbench.core.arrays import Array
from trackbench.errors import counted
from trackbench.field_types import DataError, Place, decimals
from trackbench.scenarios.recordings.csv_layout_and_rows import TextFormat, layout_of, table_rows
from trackbench.scenarios.recordings.guess_record import ColumnByQuantity
from trackbench.scenarios.recordings.hemispheres import HEMISPHERES
from trackbench.scenarios.recordings.naming_of_columns import Naming
from trackbench.scenarios.recordings.parquet_files import is_parquet
from trackbench.scenarios.recordings.parse_numbers import (
    number,
    parse_cells,
    without_thousands,
)
from trackbench.scenarios.recordings.parse_tables import first_rows, numbered_rows, read_table
from trackbench.scenarios.recordings.recognize_column_names import other_unit_in_line, words_of
from trackbench.scenarios.recordings.unit_names_and_sizes import unit_in

_SAMPLE = 10_000  # rows
_MOST_OF_WORD = 1000
"""further rows that are kept of a word which the first rows lack"""
_MOST_WORDS = 1000
"""words beyond which a column names no sensors, so that the rest of the file is not read"""


class TableSample:
    """First rows of a table, as text."""

    def __init__(
        self,
        path: str,
        names: list[str],
        text_format: TextFormat,
        rows: list[tuple[int, list[str]]] | None = None,
    ) -> None:
        """Read the first rows of a file with columns ``names``, and the lines that may have units.

        With ``rows``, pairs of line number and cells, these are the sample in place of the first rows.
        """
        self.path = path
        self.names = names
        self._text_format = text_format
        if rows is None:
            rows = list(numbered_rows(path, text_format, _SAMPLE))
        self._rows = [cells for _, cells in rows]
        self.lines = [line for line, _ in rows]
        """line of each row; blank lines, comments and rows of a wrong width are no rows"""
        self._further: dict[tuple[str, frozenset[str]], TableSample] = {}
        """later rows whose words the first rows lack, by their column and the measured columns"""
        self._thousands = text_format.thousands
        self._units: list[list[str]] = []
        """lines between the names and the first row, which may have units"""
        if text_format.skip:
            self._units = first_rows(path, replace(text_format, skip=0), text_format.skip)

    def __len__(self) -> int:
        return len(self._rows)

    @property
    def first_line(self) -> int:
        """Line of the first row of the sample; 1 without rows."""
        return self.lines[0] if self.lines else 1

    def line_of(self, column: str, words: Collection[str]) -> int:
        """Return the line of the first row that has one of the ``words`` in a column.

        It is that of the first row if no row has one.
        """
        for line, cell in zip(self.lines, self.cells(column), strict=False):
            if cell in words:
                return line
        return self.first_line

    @property
    def may_lack_rows(self) -> bool:
        """True if there may be rows after those of the sample, some of which may be left out."""
        return len(self) >= _SAMPLE // 2

    @property
    def _has_lines(self) -> bool:
        """True if there are lines below the names, which may have too few or too many cells."""
        if is_parquet(self.path):
            return False
        return any(True for _ in table_rows(self.path, layout_of(self.path, self._text_format)))

    def require_two_times(self, column: str) -> None:
        """Raise DataError if all rows have the same time, in the ``column`` of the times."""
        times = self.words(column)
        if len(times) != 1:
            return
        # Rows with a wrong number of cells, which are not in the sample, are reported first.
        read_table(self.path, {column: "label"}, text_format=self._text_format)
        rows = counted(len(self), "row")
        message = f"{column} is {times[0]} in {rows}: a recording needs rows of two times"
        remedy = (
            "take a longer recording, or say which column has the times, --set 'columns.time=NAME'"
        )
        line = self.line_of(column, times)
        raise DataError(Place(self.path, line, 1, f"{message}: {remedy}"))

    def require_rows(self) -> None:
        """Raise DataError for a table without rows, or whose rows all have a wrong number of cells."""
        if not self._rows:
            if self._has_lines:
                read_table(
                    self.path, {self.names[0]: "label"}, text_format=self._text_format
                )  # which says why
            names = ", ".join(self.names)[:200]
            message = f"has no rows below the names {names}: is it the right file, and complete?"
            raise DataError(Place(self.path, 1, 1, message))

    def cells(self, column: str) -> list[str]:
        """List the cells of a column; empty cells for the name "", no cells for an unknown name."""
        if not column and column not in self.names:
            return [""] * len(self)
        if column not in self.names:
            return []
        index = self.names.index(column)
        return [cells[index] for cells in self._rows]

    def words(self, column: str) -> list[str]:
        """List the different cells of a column, without the empty one, in order of their appearance."""
        return [word for word in dict.fromkeys(self.cells(column)) if word]

    def from_first_number(self, measured: Collection[str]) -> "TableSample":
        """Return the sample that begins at the first row with a number in a ``measured`` column.

        It is this sample if it has such a row, if no row of the file is one, or if the sample has all
        rows of the file (`may_lack_rows` is False).
        """
        indices = [self.names.index(column) for column in measured if column in self.names]
        if not indices or not self.may_lack_rows:
            return self
        if any(self._has_number(cells, indices) for cells in self._rows):
            return self
        rows = dropwhile(lambda row: not self._has_number(row[1], indices), self._later_rows())
        later = list(islice(rows, _SAMPLE))
        if not later:
            return self
        return TableSample(self.path, self.names, self._text_format, later)

    def _later_rows(self) -> Iterator[tuple[int, list[str]]]:
        """Yield line number and cells of the rows after those of the sample."""
        last = self.lines[-1]
        for line, cells in numbered_rows(self.path, self._text_format):
            if line > last:
                yield line, cells

    def _has_number(self, cells: list[str], indices: Collection[int]) -> bool:
        """Test whether a row has a number in one of the columns with these ``indices``."""
        texts = [self._number_text(cells[index]) for index in indices]
        values, _ = parse_cells(number, texts)
        return bool(np.isfinite(values).any())

    def further(self, column: str, measured: Collection[str]) -> "TableSample":
        """Return the later rows whose words in a column the first rows lack, as a sample of their own.

        A word whose first rows have no number in a ``measured`` column counts as lacking, and its later
        rows with such a number are returned. The sample has up to a thousand rows of each word, and none
        if the first rows are the whole file. It is read once for each column and each set of
        ``measured`` columns.
        """
        key = (column, frozenset(measured))
        if key not in self._further:
            rows: list[tuple[int, list[str]]] = []
            if column in self.names and self.may_lack_rows:
                rows = self._rows_of_other_words(column, measured)
            self._further[key] = TableSample(self.path, self.names, self._text_format, rows)
        return self._further[key]

    def _rows_of_other_words(
        self, column: str, measured: Collection[str]
    ) -> list[tuple[int, list[str]]]:
        """Read later rows for the sample `further`, as pairs of line number and cells.

        They are the rows whose word in the ``column`` the first rows lack. Of a word whose first rows
        have no number in a ``measured`` column, they are those with such a number.
        """
        index = self.names.index(column)
        indices = [self.names.index(name) for name in measured if name in self.names]
        first_words = {*self.cells(column), ""}
        # Words whose first rows all measure nothing.
        idle_words = first_words - {*self.measuring_words(column, measured), ""}
        # So many rows of a word show what its sensor measures, and so many words name no sensors.
        counts: Counter[str] = Counter()
        rows = []
        for line, cells in self._later_rows():
            word = cells[index]
            if counts[word] >= _MOST_OF_WORD or (word in first_words and word not in idle_words):
                continue
            if word in idle_words and not self._has_number(cells, indices):
                continue
            counts[word] += 1
            rows.append((line, cells))
            if len(counts) > _MOST_WORDS:
                break
        return rows

    def measuring_words(self, column: str, measured: Collection[str]) -> list[str]:
        """List the words of a column in rows with a number in a ``measured`` column."""
        has_number = np.zeros(len(self), dtype=np.bool_)
        for name in measured:
            if name in self.names:
                has_number |= np.isfinite(self.numbers(name))
        cells = self.cells(column)
        return list(dict.fromkeys(cells[row] for row in np.flatnonzero(has_number).tolist()))

    def numbers(self, column: str) -> Array:
        """Parse the cells of a column as numbers (R,), NaN for cells that are none."""
        values, _ = parse_cells(number, self._number_texts(column))
        return values

    def decimals(self, column: str) -> int:
        """Return the largest number of digits behind a decimal point in a column; 0 without numbers."""
        cells = self._number_texts(column)
        values, _ = parse_cells(number, cells)
        digits = [decimals(cells[i]) for i in np.flatnonzero(np.isfinite(values))]
        digits += [sample.decimals(column) for sample in self._further.values()]
        return max(digits, default=0)

    def _number_texts(self, column: str) -> list[str]:
        """List the cells of a column with a decimal point, and without marks between thousands."""
        return [self._number_text(cell) for cell in self.cells(column)]

    def _number_text(self, cell: str) -> str:
        """Return a cell with a decimal point, and without marks between thousands."""
        if self._thousands:
            cell = without_thousands(cell, self._thousands)
        return cell.replace(",", ".")

    def unit(self, column: str, quantity: str) -> str | None:
        """Return the unit of a quantity that a line of units has below the column; None without one."""
        if column not in self.names:
            return None
        index = self.names.index(column)
        # There may be several lines between the names and the rows. In parentheses a cell is read as the
        # unit in a name is, as in range (0.1 m).
        for row in self._units:
            unit = unit_in(words_of(f"({row[index]})"), quantity)
            if unit:
                return unit
        return None

    def other_unit(self, column: str) -> str | None:
        """Return a unit from the lines of units that trackbench cannot convert; None without one."""
        index = self.names.index(column)
        for row in self._units:
            unit = other_unit_in_line(row[index])
            if unit:
                return unit
        return None


def numbers_of(
    sample: TableSample, columns: ColumnByQuantity, with_missing: Naming, name: str
) -> Array:
    """Parse the numbers (R,) of the quantity ``name``, NaN where they are missing.

    Coordinates have the signs of their hemispheres.
    """
    values = sample.numbers(columns[name])
    values[np.isin(values, with_missing.missing_numbers(name))] = np.nan
    key, _, negative = HEMISPHERES.get(name, ("", (), ()))
    if columns.get(key):
        words = sample.cells(columns[key])
        is_negative = np.array([word.lower() in negative for word in words], dtype=np.bool_)
        values[is_negative] = -np.abs(values[is_negative])
    return values
