"""A table of numbers with standard errors, and its text: Markdown or aligned columns."""

import base64
import re
import unicodedata
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from html import escape
from itertools import chain
from math import floor, isfinite, isinf, log10
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.errors import counted
from trackbench.statistics.collapsed_runs import COLLAPSED_NOTE
from trackbench.statistics.comparison import paired_difference
from trackbench.statistics.estimates import RunEstimate, Share
from trackbench.statistics.indefinite_covariances import INDEFINITE_NOTE, NOT_DEFINITE
from trackbench.statistics.sample_statistics import Estimate
from trackbench.statistics.share_of_runs import share_in_words

if TYPE_CHECKING:
    import pandas as pd


class Text(NamedTuple):
    """Shown text of a cell, and the number it sorts by; words sort alphabetically."""

    text: str
    number: float | None = None
    tex: str | None = None
    """how a column of LaTeX's siunitx writes it, if not as it is"""
    best: bool = False
    """whether it is the best of its column"""


@dataclass
class TextTable:
    """A table ready to be shown, its numbers written as text."""

    title: str
    heads: list[str]
    rows: list[list[Text]] = field(default_factory=list)
    """one text for each of the heads"""
    notes: list[str] = field(default_factory=list)
    """sentences below the table"""

    def markdown(self) -> str:
        """Return a Markdown table with a bold caption."""
        lines = [
            _line([markdown_text(head) for head in self.heads]),
            _line(["---"] * len(self.heads)),
        ]
        for row in self.rows:
            lines.append(_line([markdown_text(cell.text) for cell in row]))
        caption = f"**{markdown_text(self.title)}**\n\n" if self.title else ""
        notes = "".join(f"\n{markdown_text(note)}\n" for note in self.notes)
        return caption + "\n".join(lines) + "\n" + notes

    def aligned(self) -> str:
        """Return the table for a terminal: numbers to the right, words to the left."""
        lines = [self.heads]
        for row in self.rows:
            lines.append([cell.text for cell in row])
        widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
        lines.insert(1, ["-" * width for width in widths])  # below the heads
        sides = ["<" if self._has_words_only(i) else ">" for i in range(len(widths))]
        shown = [self.title] if self.title else []
        if self.rows:
            for line in lines:
                padded = map("{:{}{}}".format, line, sides, widths)  # such as "{:>12}"
                shown.append("  ".join(padded).rstrip())
        return "\n".join([*shown, *self.notes])

    def tex(self, label: str = "") -> str:
        """Return a LaTeX table for booktabs and siunitx (3), which also compiles alone.

        ``label`` is its name in the paper, after ``tab:``.
        """
        # Step 1: the columns. Those of numbers, of type S, are aligned at the decimal marker; siunitx
        # takes any text in braces as it is.
        formats = [self._column_format(i) for i in range(len(self.heads))]
        heads = [_head_tex(head) for head in self.heads]
        rows = [[_cell_tex(cell) for cell in row] for row in self.rows]
        for i, column_format in enumerate(formats):
            if column_format.startswith("S"):
                heads[i] = f"{{{heads[i]}}}"
                for row in rows:
                    is_number = _SIUNITX.fullmatch(row[i].removeprefix(_BOLD))
                    if not is_number and not row[i].startswith("{"):
                        row[i] = f"{{{row[i]}}}"
        # Step 2: the notes.
        notes = [_tex(note) for note in self.notes]
        cells = [cell for row in self.rows for cell in row if cell.tex]
        # `in_tex` leaves out an error below half of the last digit, which the cell's text has.
        if any("±" in cell.text and "+-" not in (cell.tex or "") for cell in cells):
            notes.append("A number without a standard error has one below half of its last digit.")
        # Step 3: the lines. LaTeX numbers the captions by itself. The first and the last lines make the
        # file a document of its own, unless a document includes it.
        lines = [
            _ALONE,
            r"\begin{table}",
            r"\sisetup{separate-uncertainty=true, group-digits=none}",
            r"\sisetup{mode=match, reset-text-series=false}  % bold numbers",
            r"\centering",
            rf"\caption{{{_tex(_NUMBERED.sub('', self.title))}}}",
        ]
        if label:
            lines.append(rf"\label{{tab:{label}}}")
        lines += [
            rf"\begin{{tabular}}{{{' '.join(formats)}}}",
            r"\toprule",
            " & ".join(heads) + r" \\",
            r"\midrule",
            *(" & ".join(row) + r" \\" for row in rows),
            r"\bottomrule",
            r"\end{tabular}",
        ]
        lines += [rf"\par\smallskip{{\footnotesize {note}\par}}" for note in notes]
        return "\n".join([*lines, r"\end{table}", _ALONE_END, ""])

    def _column_format(self, column: int) -> str:
        """Return a column's type in LaTeX: ``l`` for words, ``r`` for other texts, ``S`` for numbers.

        An ``S`` has the largest numbers of digits in the column, so that siunitx aligns them. For
        example, ``S[table-format=-2.3(2)e-9]`` has a sign, two digits and three decimals, two digits of
        the error, and an exponent of one digit with a sign.
        """
        numbers = []
        for row in self.rows:
            number = _SIUNITX.fullmatch(row[column].tex or "")
            if number:
                numbers.append(number)
        if not numbers:
            return "l" if self._has_words_only(column) else "r"

        def longest(group: str) -> int:
            return max(len(number[group] or "") for number in numbers)

        sign = "-" if longest("sign") else ""
        room = f"{sign}{longest('whole')}.{longest('places')}"
        # Digits of an error count from its first that is not zero: two of 0.0080.
        error_digits = max(len((n["error"] or "").replace(".", "").lstrip("0")) for n in numbers)
        if error_digits:
            room += f"({error_digits})"
        if longest("exponent"):
            exponents = [number["exponent"] or "" for number in numbers]
            digits = max(len(exponent.lstrip("-")) for exponent in exponents)
            exponent_sign = "-" if any(exponent.startswith("-") for exponent in exponents) else ""
            room += f"e{exponent_sign}{'9' * digits}"
        return f"S[table-format={room}]"

    def _has_words_only(self, column: int) -> bool:
        """Test whether no cell of a column has a number."""
        return all(row[column].number is None for row in self.rows)


def _line(cells: list[str]) -> str:
    return "| " + " | ".join(cells) + " |"


_ALONE = r"""% In a paper: \usepackage{booktabs, siunitx}, siunitx of version 3, and \input of this file.
% Alone: the next lines make it a document, as \begin{document} has not been read.
\expandafter\ifx\csname @nodocument\endcsname\relax\else
  \documentclass{article}
  \usepackage[a4paper, landscape, margin=1cm]{geometry}
  \usepackage{booktabs, siunitx}
  \pagestyle{empty}
  \begin{document}
  \def\trackbenchalone{\end{document}}
\fi"""
"""Lines that compile a table alone: LaTeX forgets ``\\@nodocument`` at the begin of a document."""
_ALONE_END = r"\csname trackbenchalone\endcsname"
_BOLD = r"\bfseries "
"""What LaTeX has before the text of a bold cell."""
_SIUNITX = re.compile(
    r"(?P<sign>-?)(?P<whole>\d+)(\.(?P<places>\d+))?( \+- (?P<error>[\d.]+))?( e(?P<exponent>-?\d+))?"
)
"""A number as `in_tex` writes it."""
_NUMBERED = re.compile(r"^Table \w+[.:]\s*(?=\S)")
"""What LaTeX writes before a caption by itself."""
_TEX = {
    **{c: f"\\{c}" for c in "&%$#_{}"},
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "±": r"$\pm$",
    "–": "--",
    "µ": r"$\mu$",
    "≤": r"$\leq$",
    "≥": r"$\geq$",
    "×": r"$\times$",
    "·": r"$\cdot$",
    "→": r"$\to$",
    "≈": r"$\approx$",
    "∞": r"$\infty$",
    "−": "$-$",
    "²": r"\textsuperscript{2}",
    "³": r"\textsuperscript{3}",
    "⁴": r"\textsuperscript{4}",
}


_FORMULA = re.compile(r"(\$[^$\s](?:[^$]*[^$\s])?\$)")
"""A formula between dollars, within a column's head."""


def _tex(text: str) -> str:
    return "".join(_TEX.get(c) or _greek(c) for c in text)


def _cell_tex(cell: Text) -> str:
    """Write a cell for LaTeX, in bold if it is among the best."""
    text = cell.tex or _tex(cell.text)
    if not cell.best:
        return text
    if text.startswith("{"):  # braces around a text that is no number: the command is within them
        return f"{{{_BOLD}{text[1:]}"
    return f"{_BOLD}{text}"


def _head_tex(text: str) -> str:
    """Write a column's head for LaTeX, formulas between $ as they are."""
    parts = []
    # Text and formulas in turns, beginning with a text.
    for i, part in enumerate(_FORMULA.split(text)):
        is_formula = i % 2 == 1
        parts.append(part if is_formula else _tex(part))
    return "".join(parts)


def _greek(c: str) -> str:
    """Write a small Greek letter as a formula, ``$\\mu$``, since pdflatex has it in no font of text.

    Any other character stays as it is.
    """
    before, _, letter = unicodedata.name(c, "").partition("GREEK SMALL LETTER ")
    if before or not letter:
        return c
    return rf"$\{letter.lower().replace('lamda', 'lambda')}$"  # Unicode writes it "lamda"


def markdown_text(text: str) -> str:
    """Write a text so that Markdown shows it as it is: no cell ends in it, and no tag or link begins."""
    text = text.replace("\\", "\\\\").replace("|", "\\|").replace("<", "&lt;")
    return text.replace("](", "]\\(")


_MOST_ROWS = 60
"""Longer tables are cut; the files have them whole."""
_NUMBER_STYLE = ' style="text-align: right; white-space: nowrap"'


def table_html(table: TextTable) -> str:
    """Write a table as HTML, cut to `_MOST_ROWS` rows; numbers stand to the right."""
    heads = "".join(f"<th>{escape(head)}</th>" for head in table.heads)
    rows = []
    for row in table.rows[:_MOST_ROWS]:
        rows.append(f"<tr>{''.join(map(_cell_html, row))}</tr>")
    notes = [*table.notes]
    hidden_rows = len(table.rows) - _MOST_ROWS
    if hidden_rows > 0:
        notes.insert(0, f"and {hidden_rows} more rows")
    caption = f"<p><b>{escape(table.title)}</b></p>" if table.title else ""
    body = f"<table><thead><tr>{heads}</tr></thead><tbody>{''.join(rows)}</tbody></table>"
    return caption + body + "".join(f"<p>{escape(note)}</p>" for note in notes)


def results_html(
    title: str, lines: Sequence[str], tables: Iterable[TextTable], picture: bytes | None
) -> str:
    """Join title, lines, a figure as PNG and tables into HTML for a notebook."""
    parts = [f"<h4>{escape(title)}</h4>", *(f"<div>{escape(line)}</div>" for line in lines)]
    if picture:
        data = base64.b64encode(picture).decode()
        width = "width: 100%; max-width: 720px"
        parts.append(f'<img alt="" style="{width}" src="data:image/png;base64,{data}">')
    return "\n".join([*parts, *map(table_html, tables)])


def _cell_html(cell: Text) -> str:
    style = "" if cell.number is None else _NUMBER_STYLE
    return f"<td{style}>{escape(cell.text)}</td>"


class Cell(NamedTuple):
    """Cell of a table: an estimate over some runs, and how many runs were lost beside them."""

    estimate: Estimate
    """value and standard error, NaN where there is none"""
    runs: int
    """number of runs that the estimate is over"""
    lost: int
    """number of runs that were lost"""
    words: str = ""
    """in place of the number"""
    suffix: str = ""
    """after the number"""

    @classmethod
    def of(cls, term: RunEstimate, words: str = "") -> "Cell":
        """Return the cell of a measured number.

        The share of an event that no run or every run had is written as counts, with the limits of its
        probability.

        Parameters
        ----------
        term : number, as ``Evaluator.term`` returns it
        words : text in place of the number; default: the number
        """
        if isinstance(term, Share) and term.value in (0.0, 1.0):
            words = share_in_words(round(term.value * term.runs), term.runs, noun="")
        return cls(estimate=term.estimate, runs=term.runs, lost=term.lost, words=words)

    @classmethod
    def difference(cls, a: Array | None, b: Array | None) -> "Cell":
        """Return the cell of the mean of ``a - b`` over the runs (M,) that both have.

        Without ``a`` or ``b`` it is the cell of a missing number.
        """
        if a is None or b is None:
            return cls.missing()
        both = np.isfinite(a) & np.isfinite(b)
        return cls(
            estimate=paired_difference(a[both], b[both]),
            runs=int(both.sum()),
            lost=int((~both).sum()),
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
        keys : one text for each of the table's ``key_headers``
        cells : one cell for each of its ``value_headers``
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
        """Write the keys of a row; those of linked paths by the keys that differ."""
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
                tex = rf"{{\num{{{tex}}}{_tex(cell.suffix)}}}"
        return Text(text=self.text(cell), number=cell.estimate.value, tex=tex, best=best)

    def markdown(self) -> str:
        """Return a Markdown table."""
        return self.texts().markdown()

    def text(self, cell: Cell) -> str:
        """Write a cell: ``0.3164 ± 0.0080``, its words if it has any, or a dash without a number."""
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
    runs = most.lost + most.runs
    if not runs:  # a bound has none
        return Text("–", number=most.lost)
    return Text(share_in_words(most.lost, runs, noun=""), number=most.lost)


_SIGNED_ZERO = re.compile(r"(?<![\w.])[-+](0(\.0+)?)(?![\w.])")


def one_zero(text: str) -> str:
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
    value, stderr : number and its standard error; NaN if it has none
    digits : significant digits of the value, if its error does not decide them

    Returns
    -------
    Text such as ``0.3164 ± 0.0080``, of very small and large numbers with exponents.
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

    A value with an error has at most ``digits`` significant digits, or four if ``digits`` is less. An
    error below half of the last digit is left out.
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
    # Step 2: places down to the error's second digit, as many as the digits allow; as in `rounded`.
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
