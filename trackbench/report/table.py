"""A table of numbers with standard errors, which a table kind returns: rows of keys and cells."""

from dataclasses import dataclass, field
from itertools import chain
from math import isfinite, isinf
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.errors import counted
from trackbench.report.latex_table import escaped_for_latex
from trackbench.report.markdown_table import Text, TextTable
from trackbench.report.notebook_html import table_html
from trackbench.report.rounded_numbers import in_tex, rounded
from trackbench.statistics.collapsed_runs import COLLAPSED_NOTE
from trackbench.statistics.comparison import paired_difference
from trackbench.statistics.estimates import RunEstimate, Share
from trackbench.statistics.indefinite_covariances import INDEFINITE_NOTE, NOT_DEFINITE
from trackbench.statistics.sample_statistics import Estimate
from trackbench.statistics.share_of_runs import share_in_words

if TYPE_CHECKING:
    import pandas as pd


class Cell(NamedTuple):
    """Cell of a table: an estimate over some runs, and how many runs were lost beside them."""

    estimate: Estimate
    """value and standard error, NaN where there is none"""
    runs: int
    """number of runs that the estimate is over; of a CPU time all runs of the results"""
    lost: int
    """number of runs that the filter of the row lost"""
    words: str = ""
    """in place of the number"""
    suffix: str = ""
    """after the number"""
    all_runs: int = 0
    """number of runs of which some are lost; 0 for ``runs`` and ``lost`` together. A comparison of two
    filters is over fewer runs, as it leaves out those that the other filter lost, too"""

    @classmethod
    def of(cls, term: RunEstimate, words: str = "", kept_runs: int = 0) -> "Cell":
        """Return the cell of a measured number.

        The share of an event that no run or every run had is written as counts, with the limits of its
        probability.

        Parameters
        ----------
        term
            number, as ``Evaluator.term`` returns it
        words
            text in place of the number, but not of a share that is written as counts; empty means the
            number
        kept_runs
            runs that are not lost; the cell says so if only some of them have a value

        Returns
        -------
        Cell
            number, or ``words``, with the runs that it is over and the lost ones
        """
        if isinstance(term, Share) and term.value in (0.0, 1.0):
            # Counts without the noun "runs": "0 of 800 (0 to 0.46 %)".
            words = share_in_words(round(term.value * term.runs), term.runs, noun="")
        suffix = ""
        if 0 < term.runs < kept_runs:
            suffix = f" ({term.runs} of {kept_runs} runs)"
        return cls(
            estimate=term.estimate, runs=term.runs, lost=term.lost, words=words, suffix=suffix
        )

    @classmethod
    def difference(cls, a: Array | None, b: Array | None, lost: int) -> "Cell":
        """Return the cell of the mean of ``a - b`` over the runs that both have.

        Parameters
        ----------
        a, b
            values (M,) of the runs, NaN where a run is lost; None if there are none
        lost
            number of runs that the filter of ``a`` lost

        Returns
        -------
        Cell
            mean with its standard error. Without ``a`` or ``b`` it is the cell of a missing number
        """
        if a is None or b is None:
            return cls.missing()
        both = np.isfinite(a) & np.isfinite(b)
        return cls(
            estimate=paired_difference(a[both], b[both]),
            runs=int(both.sum()),
            lost=lost,
            all_runs=len(both),
        )

    @classmethod
    def missing(cls) -> "Cell":
        """Return a cell without a number: the filter failed, was left out, or has no such metric."""
        return cls(estimate=Estimate(float("nan"), float("nan")), runs=0, lost=0)


class LinkedTexts(NamedTuple):
    """Texts of a table for the values of paths that vary together, which stand under one key header."""

    head: str
    """names of the keys that differ; empty if one key does, whose header stays"""
    texts: dict[str, str]
    """text of each value, by the value as the CSV file has it"""


@dataclass(repr=False)
class Table:
    """Rows of keys and cells, with a title and notes: what a table kind returns."""

    title: str
    key_headers: list[str]
    """headings of the columns of text, which come first"""
    value_headers: list[str]
    """headings of the columns of numbers"""
    digits: int
    """significant digits of a number, if its error does not decide them"""
    keys: list[list[str]] = field(default_factory=list)
    """texts of each row"""
    cells: list[list[Cell]] = field(default_factory=list)
    """numbers of each row"""
    notes: list[str] = field(default_factory=list)
    """sentences below the table"""
    units: dict[str, str] = field(default_factory=dict)
    """units of key headers that do not name theirs, which the files in CSV leave out"""
    linked: dict[str, LinkedTexts] = field(default_factory=dict)
    """texts of linked paths by key header, which the files in CSV leave out"""
    best: set[tuple[int, int]] = field(default_factory=set)
    """row and column of the best values, and of those without a significant difference from them"""

    def __repr__(self) -> str:
        return f"<Table {self.title!r}: {counted(len(self.keys), 'row')}>"

    def _repr_html_(self) -> str:
        return table_html(self.texts())

    @property
    def frame(self) -> "pd.DataFrame":
        """Table as a pandas data frame: keys, value and standard error of each column, lost runs."""
        import pandas as pd

        return pd.DataFrame(self.csv_rows(), columns=self.csv_header)

    def add(self, keys: list[str], cells: list[Cell]) -> None:
        """Append a row.

        Parameters
        ----------
        keys
            texts, one for each of the table's ``key_headers``
        cells
            cells, one for each of its ``value_headers``
        """
        self.keys.append(keys)
        self.cells.append(cells)
        # A note, once below the table, explains the words of a cell such as "collapsed in 3 of 40 runs".
        for word, note in (("collapsed", COLLAPSED_NOTE), (NOT_DEFINITE, INDEFINITE_NOTE)):
            has_word = any(cell.words.startswith(word) for cell in cells)
            if has_word and note not in self.notes:
                self.notes.append(note)

    @property
    def csv_header(self) -> list[str]:
        """Keys, then value and standard error of each column, then the number of lost runs."""
        header = [*self.key_headers]
        for head in self.value_headers:
            header += [head, f"{head} stderr"]
        return [*header, "lost"]

    def csv_rows(self) -> list[list[object]]:
        """Return the rows of the CSV file, numbers in full."""
        rows: list[list[object]] = []
        for keys, cells in zip(self.keys, self.cells, strict=True):
            row: list[object] = [*keys]
            for cell in cells:
                row += cell.estimate  # value and standard error
            # The cells of a row may lose different runs: the row has the largest number of lost runs.
            row.append(max(cell.lost for cell in cells))
            rows.append(row)
        return rows

    def texts(self) -> TextTable:
        """Return the table with its cells as text, ``value ± stderr``.

        A last column has the lost runs, if any were lost. Unlike the CSV file, the table shows units of
        keys, and of paths that vary together only the keys that differ.
        """
        heads = []
        for head in self.key_headers:
            if head in self.linked and self.linked[head].head:
                heads.append(self.linked[head].head)
            elif head in self.units:
                heads.append(f"{head} ({self.units[head]})")
            else:
                heads.append(head)
        heads += self.value_headers
        names_losses = any(cell.lost for cell in chain.from_iterable(self.cells))
        if names_losses:
            heads.append("Lost runs")
        table = TextTable(self.title, heads, notes=self.notes)
        for i, (keys, cells) in enumerate(zip(self.keys, self.cells, strict=True)):
            row = self._key_texts(keys)
            for j, cell in enumerate(cells):
                row.append(self._cell_text(cell, best=(i, j) in self.best))
            if names_losses:
                row.append(_losses_text(cells))
            table.rows.append(row)
        return table

    def _key_texts(self, keys: list[str]) -> list[Text]:
        """Write the keys of a row.

        Paths of the grid that vary together, linked paths, have one key, whose value is a list such as
        ``[10, 5]``. `linked` has the text in its place, with those items alone that differ between rows.
        """
        texts = []
        for head, key in zip(self.key_headers, keys, strict=True):
            if head in self.linked:
                key = self.linked[head].texts.get(key, key)
            texts.append(Text(key))
        return texts

    def _cell_text(self, cell: Cell, best: bool) -> Text:
        """Write a cell, and its number as LaTeX has it."""
        tex = None
        if isfinite(cell.estimate.value) and not cell.words:
            value, stderr = cell.estimate
            tex = in_tex(value, stderr, self.digits)
            if cell.suffix:  # braces hide a text that is no number from siunitx's column
                tex = rf"{{\num{{{tex}}}{escaped_for_latex(cell.suffix)}}}"
        return Text(text=self.text(cell), number=cell.estimate.value, tex=tex, best=best)

    def markdown(self) -> str:
        """Return a Markdown table."""
        return self.texts().markdown()

    def text(self, cell: Cell) -> str:
        """Write a cell: ``0.3164 ± 0.0080``, its words if it has any, or a dash without a number.

        Parameters
        ----------
        cell
            cell of this table

        Returns
        -------
        str
            number rounded by its standard error, or to the table's ``digits`` if the error does not
            decide them, and the cell's suffix. An infinite number is ``infinite``
        """
        value, stderr = cell.estimate
        if cell.words:
            return cell.words
        if isinf(value):
            return "infinite"
        if not isfinite(value):
            return "all runs lost" if cell.lost and not cell.runs else "–"
        return rounded(value, stderr, self.digits) + cell.suffix


def _losses_text(cells: list[Cell]) -> Text:
    """Write the most lost runs that any cell of a row has: ``3 of 800 (0.077 to 1.1 %)``.

    The limits are those of the probability that a run is lost. A row without any run has a dash.
    """
    most = max(cells, key=lambda cell: (cell.lost, cell.runs))
    # ``runs`` of a cell are those with a value.
    runs = most.all_runs or most.lost + most.runs
    if not runs:  # a bound has none
        return Text("–", number=most.lost)
    return Text(share_in_words(most.lost, runs, noun=""), number=most.lost)
