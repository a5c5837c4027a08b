"""Tables and sentences on a screen: aligned, colored on a terminal, wrapped to its width.

Into a pipe or a file they are as wide as a page. `--format markdown` prints Markdown.
"""

import re
import sys
from collections.abc import Iterable, Iterator, Mapping

import typer
from rich.box import SIMPLE_HEAD
from rich.cells import cell_len
from rich.console import Console, JustifyMethod
from rich.table import Table as Grid
from rich.text import Text as Styled

from trackbench.report.markdown_table import Text, TextTable

_GAP = 2
"""Spaces between two columns."""
_PAGE_WIDTH = 100
"""Width where stdout is no terminal."""
_BEST_STYLE = "bold green"
_NOTE_ON_BEST = (
    "* the best, and what is not significantly worse and with 95 % confidence near it: an error at most "
    "twice as large, a log score at most 0.69 nats lower. Where no * stands, the runs decide nothing."
)
_COLORS = {
    "equal": "green",
    "agrees": "green",
    "holds": "green",
    "calibrated": "green",
    "differs": "red",
    "fails": "red",
    "collapsed": "red",
    "not": "red",  # not positive definite
    "unranked": "red",
    "inconclusive": "yellow",
    "undecided": "yellow",
    "overconfident": "yellow",
    "underconfident": "yellow",
}
"""Colors of verdicts, and of words on consistency, by their first word."""


def print_tables(tables: Iterable[TextTable], markdown: bool = False) -> None:
    """Print tables aligned, or as Markdown."""
    for table in tables:
        if markdown:
            typer.echo(table.markdown())
        else:
            _print_table(table, _console())


def print_lines(lines: Iterable[str]) -> None:
    """Print sentences, wrapped between words on a terminal."""
    for line in lines:
        if sys.stdout.isatty():
            _console().print(Styled(line))
        else:
            typer.echo(line)


def _console() -> Console:
    """Return a console of the terminal's width, or of a page's."""
    width = None if sys.stdout.isatty() else _PAGE_WIDTH
    return Console(highlight=False, width=width)


def _print_table(table: TextTable, console: Console) -> None:
    """Print a table; if it is too wide, in parts below each other that repeat the first columns."""
    if table.title:
        console.print(Styled(table.title, "bold"))
    widths = _column_widths(table, console.width)
    for columns in _columns_of_parts(table, widths, console.width):
        # The box itself has a space between two columns. Padding is above, right, below and left.
        padding = (0, _GAP - 1, 0, 0)
        grid = Grid(box=SIMPLE_HEAD, pad_edge=False, padding=padding, show_edge=False)
        for i in columns:
            justify: JustifyMethod = "right" if _is_numeric(table, i) else "left"
            head = table.heads[i]
            # A heading that is a path of keys, and too long, is broken at its points.
            if _longest(head.split()) > widths[i]:
                head = head.replace(".", ".\n")
            grid.add_column(Styled(head), justify=justify, max_width=widths[i], overflow="fold")
        for row in table.rows:
            grid.add_row(*(_styled_cell(row[i]) for i in columns))
        console.print(grid)
        console.print()
    notes = list(table.notes)
    if any(_has_best(row) for row in table.rows):
        notes.insert(0, _NOTE_ON_BEST)
    for note in notes:
        console.print(Styled(note, "dim"))
    if notes:
        console.print()


def _has_best(row: Iterable[Text]) -> bool:
    return any(cell.best for cell in row)


def _styled_cell(cell: Text) -> Styled:
    """Mark a best value, and color a verdict by its first word."""
    if cell.best:
        return Styled(_marked_text(cell), _BEST_STYLE)
    first_word = re.split(r"\W", cell.text, maxsplit=1)[0]
    return Styled(_marked_text(cell), _COLORS.get(first_word, ""))


def _marked_text(cell: Text) -> str:
    """Return a cell's text, with a star before a best value."""
    return f"*{cell.text}" if cell.best else cell.text


_MOST_LEADING_COLUMNS = 3
"""Leading columns that each part repeats."""


def _columns_of_parts(
    table: TextTable, widths: Mapping[int, int], room: int
) -> Iterator[list[int]]:
    """Yield the numbers of the columns of each part into which a wide table is cut.

    Each part repeats the leading columns of words, and has as many of the others as fit. ``widths`` are
    those of the columns by number, and ``room`` is the width of the screen, in characters.
    """
    columns = range(len(table.heads))
    first_numeric = next((i for i in columns if _is_numeric(table, i)), len(columns))
    leading = list(columns[: min(first_numeric, _MOST_LEADING_COLUMNS)])
    part = list(leading)
    for i in columns[len(leading) :]:
        width_with_column = sum(widths[j] + _GAP for j in (*part, i)) - _GAP
        # A part has at least one column beside the leading ones, even if it is too wide.
        if len(part) > len(leading) and width_with_column > room:
            yield part
            part = list(leading)
        part.append(i)
    yield part


def _is_numeric(table: TextTable, column: int) -> bool:
    return any(row[column].number is not None for row in table.rows)


_NARROWEST = 8
"""Characters that a column of words may have even if they are more than a quarter of the screen."""


def _column_widths(table: TextTable, room: int) -> dict[int, int]:
    """Return the width of each column by its number, so that all columns fit into ``room`` if possible.

    Widths are in characters, and ``room`` is that of the screen. Headings are wrapped first, then cells
    with words, and last cells that begin with a digit. A table that is still too wide is printed in
    parts, each with some of the columns, one part below the other.
    """
    columns = range(len(table.heads))
    gaps = _GAP * (len(columns) - 1)
    # Step 1: whole cells, below headings that are whole, or wrapped between words.
    cells = {i: [_marked_text(row[i]) for row in table.rows] for i in columns}
    widths = {i: _longest([table.heads[i], *cells[i]]) for i in columns}
    if sum(widths.values()) + gaps > room:
        widths = {i: _longest([*table.heads[i].split(), *cells[i]]) for i in columns}
    # Step 2: cells that are wrapped between words, the widest columns first. The first pattern matches
    # cells that begin with no digit, the second any cell.
    for pattern in (r"(?!\d)", ""):
        least_widths = {i: _least_width(table, i, pattern) for i in columns}
        if sum(least_widths.values()) + gaps <= room:
            while sum(widths.values()) + gaps > room:
                wrappable = [i for i in columns if widths[i] > least_widths[i]]
                widest = max(wrappable, key=widths.__getitem__)
                widths[widest] -= 1
            return widths
    # Step 3: in parts, by the least widths of the second pattern. A column of words takes a quarter of
    # the room at most, but may have `_NARROWEST` characters on any screen.
    for i in columns:
        if _is_numeric(table, i):
            widths[i] = least_widths[i]
        else:
            widths[i] = max(_NARROWEST, min(widths[i], room // 4))
    return widths


def _least_width(table: TextTable, column: int, wrapped_pattern: str) -> int:
    """Return the least width of a column, in characters: that of its longest unbroken text.

    A heading breaks between words, and so do the cells of a column of words. Cells of numbers do not
    break, nor do those of a column with a cell that does not match ``wrapped_pattern``.
    """
    cells = [_marked_text(row[column]) for row in table.rows]
    is_text = not _is_numeric(table, column)
    if is_text and all(re.match(wrapped_pattern, cell) for cell in cells):
        cells = " ".join(cells).split()
    return _longest([*table.heads[column].split(), *cells])


def _longest(texts: Iterable[str]) -> int:
    """Return the width of the longest text on the screen; 0 without texts."""
    return max((cell_len(text) for text in texts), default=0)
