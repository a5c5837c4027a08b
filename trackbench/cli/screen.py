"""Tables and sentences on a terminal: aligned, colored, wrapped to its width.

A pipe or a file gets Markdown, as does a terminal with `--format markdown`.
"""

import sys
from collections.abc import Iterable, Iterator
from functools import partial

import typer
from rich.box import SIMPLE_HEAD
from rich.cells import cell_len
from rich.console import Console, JustifyMethod
from rich.table import Table as Grid
from rich.text import Text as Styled

from trackbench.report.table import Text, TextTable

_GAP = 2
_BEST = "bold green"
_COLORS = {
    **dict.fromkeys(("equal", "agrees", "holds"), "green"),
    **dict.fromkeys(("differs", "fails"), "red"),
    "inconclusive": "yellow",
}
"""Colors of verdicts by their first word."""


def print_tables(tables: Iterable[TextTable], markdown: bool = False) -> None:
    """Print tables in the form that suits stdout."""
    for table in tables:
        if markdown or not sys.stdout.isatty():
            typer.echo(table.markdown())
        else:
            _show(table, _console())


def print_lines(lines: Iterable[str]) -> None:
    """Print sentences, wrapped between words on a terminal."""
    if not sys.stdout.isatty():
        for line in lines:
            typer.echo(line)
        return
    for line in lines:
        _console().print(Styled(line))


def _console() -> Console:
    return Console(highlight=False)


def _show(table: TextTable, console: Console) -> None:
    """Print a table; columns beyond the width follow below, again with the first columns."""
    if table.title:
        console.print(Styled(table.title, "bold"))
    for part in _parts(table, console.width):
        grid = Grid(box=SIMPLE_HEAD, pad_edge=False, padding=(0, _GAP, 0, 0), show_edge=False)
        for i in part:
            longest = None if i == part[-1] else _width(table, i, console.width)
            justify: JustifyMethod = "right" if _is_numeric(table, i) else "left"
            grid.add_column(Styled(table.heads[i]), justify=justify, max_width=longest)
        for row in table.rows:
            grid.add_row(*(_styled(row[i]) for i in part))
        console.print(grid)
        console.print()
    if any(cell.best for row in table.rows for cell in row):
        console.print(Styled("* best, or not significantly worse", "dim"))
    for note in table.notes:
        console.print(Styled(note, "dim"))


def _styled(cell: Text) -> Styled:
    color = _BEST if cell.best else _COLORS.get(cell.text.partition(",")[0], "")
    return Styled("*" * cell.best + cell.text, color)


def _parts(table: TextTable, room: int) -> Iterator[list[int]]:
    """Yield the columns of each part: the leading columns of words, then as many as fit."""
    columns = range(len(table.heads))
    first = next((i for i in columns if _is_numeric(table, i)), len(columns))
    keys = [*columns[: min(first, _MOST_KEYS)]]
    width = partial(_width, table, room=room)
    part = [*keys]
    for i in columns[len(keys) :]:
        if len(part) > len(keys) and sum(width(j) + _GAP for j in (*part, i)) > room:
            yield part
            part = [*keys]
        part.append(i)
    yield part


_MOST_KEYS = 3
"""Leading columns that each part repeats."""


def _is_numeric(table: TextTable, column: int) -> bool:
    return any(row[column].number is not None for row in table.rows)


def _width(table: TextTable, column: int, room: int) -> int:
    """Return the width of a column; one of words takes a quarter of the room at most."""
    longest = max((cell_len(row[column].text) + row[column].best for row in table.rows), default=0)
    if _is_numeric(table, column):
        words = max(map(cell_len, table.heads[column].split()), default=0)
        return max(longest, words)
    return max(min(max(longest, cell_len(table.heads[column])), room // 4), 8)
