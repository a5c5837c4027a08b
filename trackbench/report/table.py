"""A table of numbers with standard errors, and its text: Markdown or aligned columns."""

import base64
import re
import unicodedata
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from html import escape
from itertools import chain
from math import floor, isfinite, isinf, log10
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.errors import counted
from trackbench.statistics.estimates import COLLAPSED_NOTE, RunEstimate, Share, in_words
from trackbench.statistics.over_runs import Estimate, paired_difference

if TYPE_CHECKING:
    import pandas as pd


class Text(NamedTuple):
    """Shown text of a cell, and the number it sorts by; words sort alphabetically."""

    text: str
    number: float | None = None
    tex: str | None = None
    """how LaTeX writes it, if not as it is"""
    best: bool = False
    """whether it is the best of its column"""


@dataclass
class TextTable:
    """A table ready to be shown."""

    title: str
    heads: list[str]
    rows: list[list[Text]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def markdown(self) -> str:
        """Return a Markdown table with a bold caption."""
        lines = [_line(list(map(_escaped, self.heads))), _line(["---"] * len(self.heads))]
        for row in self.rows:
            lines.append(_line([_escaped(cell.text) for cell in row]))
        caption = f"**{_escaped(self.title)}**\n\n" if self.title else ""
        notes = "".join(f"\n{_escaped(note)}\n" for note in self.notes)
        return caption + "\n".join(lines) + "\n" + notes

    def aligned(self) -> str:
        """Return the table for a terminal: numbers to the right, words to the left."""
        lines = [self.heads]
        for row in self.rows:
            lines.append([cell.text for cell in row])
        widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
        lines.insert(1, ["-" * width for width in widths])
        sides = ["<" if self._words(i) else ">" for i in range(len(widths))]
        rows = ("  ".join(map("{:{}{}}".format, line, sides, widths)).rstrip() for line in lines)
        return "\n".join([*filter(None, [self.title]), *(rows if self.rows else ()), *self.notes])

    def tex(self, name: str = "") -> str:
        """Return a LaTeX table for booktabs, graphicx and siunitx (3); ``name`` is its label."""
        columns = "".join("l" if self._words(i) else "r" for i in range(len(self.heads)))
        rows = []
        for row in self.rows:
            rows.append(" & ".join(cell.tex or _tex(cell.text) for cell in row) + r" \\")
        notes = [f"\n{_tex(note)}\\par" for note in self.notes]
        return "\n".join(
            [
                r"\begin{table}",
                r"\sisetup{separate-uncertainty=true, mode=match, reset-text-series=false}",
                r"\centering",
                rf"\caption{{{_tex(_NUMBERED.sub('', self.title))}}}",
                *([rf"\label{{tab:{name}}}"] if name else []),
                _AS_WIDE_AS_THERE_IS_ROOM,
                rf"\begin{{tabular}}{{{columns}}}",
                r"\toprule",
                " & ".join(map(_head_tex, self.heads)) + r" \\",
                r"\midrule",
                *rows,
                r"\bottomrule",
                r"\end{tabular}}",
                *notes,
                r"\end{table}",
                "",
            ]
        )

    def _words(self, column: int) -> bool:
        return all(row[column].number is None for row in self.rows)


def _line(cells: list[str]) -> str:
    return "| " + " | ".join(cells) + " |"


_AS_WIDE_AS_THERE_IS_ROOM = r"\resizebox{\ifdim\width>\linewidth\linewidth\else\width\fi}{!}{%"
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
    "²": r"\textsuperscript{2}",
    "³": r"\textsuperscript{3}",
}


_FORMULA = re.compile(r"(\$[^$\s](?:[^$]*[^$\s])?\$)")


def _tex(text: str) -> str:
    return "".join(_TEX.get(c) or _greek(c) for c in text)


def _head_tex(text: str) -> str:
    """Write a column's head for LaTeX, formulas between $ as they are."""
    parts = enumerate(_FORMULA.split(text))
    return "".join(part if i % 2 else _tex(part) for i, part in parts)


def _greek(c: str) -> str:
    """Write a small Greek letter as a formula, since pdflatex has it in no font of text."""
    head, _, letter = unicodedata.name(c, "").partition("GREEK SMALL LETTER ")
    return rf"$\{letter.lower().replace('lamda', 'lambda')}$" if letter and not head else c


def _escaped(text: str) -> str:
    return text.replace("\\", "\\\\").replace("|", "\\|").replace("<", "&lt;")


_MOST_ROWS = 60
"""Longer tables are cut; the files have them whole."""
_NUMBER = ' style="text-align: right; white-space: nowrap"'


def table_html(table: TextTable) -> str:
    """Write a table; numbers stand to the right."""
    heads = "".join(f"<th>{escape(head)}</th>" for head in table.heads)
    rows = "".join(f"<tr>{''.join(map(_cell, row))}</tr>" for row in table.rows[:_MOST_ROWS])
    more = len(table.rows) - _MOST_ROWS
    notes = [*([f"and {more} more rows"] if more > 0 else []), *table.notes]
    caption = f"<p><b>{escape(table.title)}</b></p>" if table.title else ""
    body = f"<table><thead><tr>{heads}</tr></thead><tbody>{rows}</tbody></table>"
    return caption + body + "".join(f"<p>{escape(note)}</p>" for note in notes)


def results_html(
    title: str, lines: Sequence[str], tables: Iterable[TextTable], picture: bytes | None
) -> str:
    """Join title, lines, a figure as PNG and tables for a notebook."""
    parts = [f"<h4>{escape(title)}</h4>", *(f"<div>{escape(line)}</div>" for line in lines)]
    if picture:
        data = base64.b64encode(picture).decode()
        width = "width: 100%; max-width: 720px"
        parts.append(f'<img alt="" style="{width}" src="data:image/png;base64,{data}">')
    return "\n".join([*parts, *map(table_html, tables)])


def _cell(cell: Text) -> str:
    return f"<td{_NUMBER if cell.number is not None else ''}>{escape(cell.text)}</td>"


class Cell(NamedTuple):
    """An estimate over so many runs, with the number of runs that were lost beside them."""

    estimate: Estimate
    runs: int
    lost: int
    words: str = ""
    """in place of the number"""
    suffix: str = ""
    """after the number"""

    @classmethod
    def of(cls, term: RunEstimate, words: str = "") -> "Cell":
        """Return a measured number; of an event that all runs or none of them had, how sure that is."""
        if isinstance(term, Share) and term.value in (0.0, 1.0):
            words = in_words(round(term.value * term.runs), term.runs, what="")
        return cls(term.estimate, term.runs, term.lost, words)

    @classmethod
    def difference(cls, a: Array | None, b: Array | None) -> "Cell":
        """Return the mean of ``a - b`` over the runs (M,) that both have."""
        if a is None or b is None:
            return cls.missing()
        both = np.isfinite(a) & np.isfinite(b)
        return cls(paired_difference(a[both], b[both]), int(both.sum()), int((~both).sum()))

    @classmethod
    def missing(cls) -> "Cell":
        """Return a cell without a number: the filter failed, was left out, or has no such metric."""
        return cls(Estimate(float("nan"), float("nan")), 0, 0)


@dataclass(repr=False)
class Table:
    """Rows of keys and cells."""

    title: str
    key_headers: list[str]
    value_headers: list[str]
    digits: int
    keys: list[list[str]] = field(default_factory=list)
    cells: list[list[Cell]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    units: dict[str, str] = field(default_factory=dict)
    """units of key headers that do not name theirs, which the files in CSV leave out"""
    linked: dict[str, int] = field(default_factory=dict)
    """key headers of linked paths, and how many these are"""
    best: set[tuple[int, int]] = field(default_factory=set)
    """row and column of the best values, and of those without a significant difference from them"""

    def __repr__(self) -> str:
        return f"<Table {self.title!r}: {counted(len(self.keys), 'row')}>"

    def _repr_html_(self) -> str:
        return table_html(self.texts())

    @property
    def frame(self) -> "pd.DataFrame":
        """Keys, then value and standard error of each column, then the runs lost."""
        import pandas as pd

        return pd.DataFrame(self.csv_rows(), columns=self.csv_header)

    def add(self, keys: list[str], cells: list[Cell]) -> None:
        """Append a row."""
        self.keys.append(keys)
        self.cells.append(cells)
        if COLLAPSED_NOTE not in self.notes and any(c.words.startswith("collapsed") for c in cells):
            self.notes.append(COLLAPSED_NOTE)

    @property
    def csv_header(self) -> list[str]:
        """Keys, then value and standard error of each column, then the runs lost."""
        header = [*self.key_headers]
        for head in self.value_headers:
            header += [head, f"{head} stderr"]
        return [*header, "lost"]

    def csv_rows(self) -> list[list[object]]:
        """Return one row per row, numbers in full."""
        rows = []
        for keys, cells in zip(self.keys, self.cells, strict=True):
            values = chain.from_iterable(cell.estimate for cell in cells)
            rows.append([*keys, *values, max(c.lost for c in cells)])
        return rows

    def texts(self) -> TextTable:
        """Return ``value ± stderr`` in every cell; lost runs are named in a last column.

        Linked paths of equal values, [100, 100], have the one value.
        """
        lost = any(cell.lost for cell in chain.from_iterable(self.cells))
        keys = [f"{h} ({self.units[h]})" if h in self.units else h for h in self.key_headers]
        heads = [*keys, *self.value_headers, *(["Lost runs"] if lost else [])]
        table = TextTable(self.title, heads, notes=self.notes)
        for r, (values, cells) in enumerate(zip(self.keys, self.cells, strict=True)):
            row = []
            for head, key in zip(self.key_headers, values, strict=True):
                parts = key.strip("[]").split(", ")
                is_one = len(parts) == self.linked.get(head) and len({*parts}) == 1
                row.append(Text(parts[0] if is_one else key))
            for i, c in enumerate(cells):
                bold, tex = r"\bfseries " if (r, i) in self.best else "", None
                if isfinite(c.estimate.value) and not c.words:
                    tex = bold + in_tex(*c.estimate, self.digits) + c.suffix
                row.append(Text(self.text(c), c.estimate.value, tex, (r, i) in self.best))
            if lost:
                most = max(cells, key=lambda c: (c.lost, c.runs))
                runs = most.lost + most.runs  # a bound has none
                row.append(Text(in_words(most.lost, runs, what="") if runs else "–", most.lost))
            table.rows.append(row)
        return table

    def markdown(self) -> str:
        """Return a Markdown table, whose keys are those of the CSV file."""
        return replace(self, linked={}).texts().markdown()

    def text(self, cell: Cell) -> str:
        """Return ``0.3164 ± 0.0080``; in words where there is no number, or no error of it."""
        value, stderr = cell.estimate
        if cell.words:
            return cell.words
        if isinf(value):
            return "infinite"
        if not isfinite(value):
            return "all runs lost" if cell.lost and not cell.runs else "–"
        return rounded(value, stderr, self.digits) + cell.suffix


_STORED = 0.5e-7
"""Share of a value below which its error is rounding: a tenth of what seven digits leave open."""


_USUAL_DIGITS = 4


def rounded(value: float, stderr: float, digits: int) -> str:
    """Round the value and standard error to the same decimal place, the error to one digit or two."""
    if not isfinite(value):
        return "infinite" if isinf(value) else "–"
    decimals = digits - 1 - _exponent(value)
    if isfinite(stderr) and stderr > _STORED * abs(value):
        place = -_exponent(stderr)  # of the error's first digit, which is never cut to a zero
        decimals = min(max(decimals, place), place + 1) if value else place + 1
    decimals = max(decimals, 0)
    if decimals > max(7, digits + 3) or abs(value) >= 1e6:
        if not isfinite(stderr):
            return f"{value:.{_exact_places(digits)}e}"
        return f"{value:.{_places(value, stderr, digits)}e} ± {stderr:.1e}"
    if not isfinite(stderr):
        return f"{value:.{decimals}f}"
    return f"{value:.{decimals}f} ± {stderr:.{decimals}f}"


def _places(value: float, stderr: float, digits: int) -> int:
    """Count the places of a value down to its error's second digit, at most six or the digits."""
    exact = _exact_places(digits)
    if not stderr > 0.0:
        return exact
    return min(max(2, _exponent(value) - _exponent(stderr) + 1), max(6, exact))


def _exact_places(digits: int) -> int:
    """Count the places of a number with an exponent and no error: three digits, or more than four."""
    return digits - 1 if digits > _USUAL_DIGITS else 2


def in_tex(value: float, stderr: float, digits: int) -> str:
    """Return value and error for LaTeX's siunitx: ``\\num{5.96 +- 0.99 e-6}``, one exponent for both."""
    text = rounded(value, stderr, digits).replace("±", "+-")
    if "e" not in text:
        return rf"\num{{{text}}}"
    exponent = _exponent(max(abs(value), stderr if isfinite(stderr) else 0.0))
    scaled, error = value / 10.0**exponent, stderr / 10.0**exponent
    if not isfinite(stderr):
        return rf"\num{{{scaled:.{_exact_places(digits)}f} e{exponent}}}"
    places = max(1 - _exponent(error), 0) if error else _exact_places(digits)
    return rf"\num{{{scaled:.{places}f} +- {error:.{places}f} e{exponent}}}"


def _exponent(x: float) -> int:
    return floor(log10(abs(x))) if x else 0
