"""Tables and sentences on a screen: aligned, colored on a terminal, wrapped to its width.

Into a pipe or a file they are as wide as a page. `--format markdown` prints Markdown.
"""

import re
import sys
from collections.abc import Iterable, Iterator, Mapping
from itertools import chain

import typer
from rich.box import SIMPLE_HEAD
from rich.cells import cell_len
from rich.console import Console, JustifyMethod
from rich.table import Table as Grid
from rich.text import Text as Styled

from trackbench.report.table import Text, TextTable

_GAP = 2
_PAGE = 100
"""Columns where stdout is no terminal."""
_BEST = "bold green"
_MARKED = (
    "* best, or not significantly worse and at most twice as large, of a log score 0.69 nats below "
    "(95 %); none if undecided"
)
_COLORS = {
    **dict.fromkeys(("equal", "agrees", "holds", "calibrated"), "green"),
    **dict.fromkeys(("differs", "fails", "collapsed", "unranked"), "red"),
    **dict.fromkeys(("inconclusive", "undecided", "overconfident", "underconfident"), "yellow"),
}
"""Colors of verdicts, and of words on consistency, by their first word."""


def print_tables(tables: Iterable[TextTable], markdown: bool = False) -> None:
    """Print tables aligned, or as Markdown."""
    for table in tables:
        if markdown:
            typer.echo(table.markdown())
        else:
            _show(table, _console())


def print_lines(lines: Iterable[str]) -> None:
    """Print sentences, wrapped between words on a terminal."""
    for line in lines:
        if sys.stdout.isatty():
            _console().print(Styled(line))
        else:
            typer.echo(line)


def _console() -> Console:
    return Console(highlight=False, width=None if sys.stdout.isatty() else _PAGE)


def _show(table: TextTable, console: Console) -> None:
    """Print a table; columns beyond the width follow below, again with the first columns."""
    if table.title:
        console.print(Styled(table.title, "bold"))
    widths = _widths(table, console.width)
    for part in _parts(table, widths, console.width):
        grid = Grid(box=SIMPLE_HEAD, pad_edge=False, padding=(0, _GAP - 1, 0, 0), show_edge=False)
        for i in part:
            justify: JustifyMethod = "right" if _is_numeric(table, i) else "left"
            head = table.heads[i]
            if max(map(cell_len, head.split()), default=0) > widths[i]:
                head = head.replace(".", ".\n")  # a path of keys
            grid.add_column(Styled(head), justify=justify, max_width=widths[i], overflow="fold")
        for row in table.rows:
            grid.add_row(*(_styled(row[i]) for i in part))
        console.print(grid)
        console.print()
    marked = any(cell.best for cell in chain.from_iterable(table.rows))
    notes = [_MARKED] * marked + table.notes
    for note in notes:
        console.print(Styled(note, "dim"))
    if notes:
        console.print()


def _styled(cell: Text) -> Styled:
    color = _BEST if cell.best else _COLORS.get(re.split(r"\W", cell.text, maxsplit=1)[0], "")
    return Styled("*" * cell.best + cell.text, color)


def _parts(table: TextTable, widths: Mapping[int, int], room: int) -> Iterator[list[int]]:
    """Yield the columns of each part: the leading columns of words, then as many as fit."""
    columns = range(len(table.heads))
    first = next((i for i in columns if _is_numeric(table, i)), len(columns))
    keys = [*columns[: min(first, _MOST_KEYS)]]
    part = [*keys]
    for i in columns[len(keys) :]:
        if len(part) > len(keys) and sum(widths[j] + _GAP for j in (*part, i)) > room + _GAP:
            yield part
            part = [*keys]
        part.append(i)
    yield part


_MOST_KEYS = 3
"""Leading columns that each part repeats."""


def _is_numeric(table: TextTable, column: int) -> bool:
    return any(row[column].number is not None for row in table.rows)


def _widths(table: TextTable, room: int) -> dict[int, int]:
    """Fit the width of each column so that all stand side by side, if they can.

    Headings are wrapped first, then words, and those that begin with a digit last.
    """
    columns = range(len(table.heads))
    gaps = _GAP * (len(columns) - 1)
    texts = {i: _texts(table, i) for i in columns}
    most = {i: max(map(cell_len, texts[i])) for i in columns}
    if sum(most.values()) + gaps > room:
        most = {i: max(map(cell_len, [*texts[i][0].split(), *texts[i][1:], ""])) for i in columns}
    for wrapped in (r"(?!\d)", ""):
        least = {i: _least(table, i, wrapped) for i in columns}
        if sum(least.values()) + gaps <= room:
            while sum(most.values()) + gaps > room:
                widest = max((i for i in columns if most[i] > least[i]), key=most.__getitem__)
                most[widest] -= 1
            return most
    # In parts: a column of words takes a quarter of the room at most.
    parts = {i: max(8, min(most[i], room // 4)) for i in columns}
    return {i: least[i] if _is_numeric(table, i) else parts[i] for i in columns}


def _least(table: TextTable, column: int, wrapped: str) -> int:
    """Measure the longest word; of numbers, and cells that do not match, the whole cell."""
    head, *cells = _texts(table, column)
    is_wrapped = not _is_numeric(table, column) and all(re.match(wrapped, c) for c in cells)
    return max(
        map(cell_len, [*head.split(), *(" ".join(cells).split() if is_wrapped else cells), ""])
    )


def _texts(table: TextTable, column: int) -> list[str]:
    """List the heading of a column, then its cells."""
    cells = [row[column] for row in table.rows]
    return [table.heads[column], *("*" * cell.best + cell.text for cell in cells)]
