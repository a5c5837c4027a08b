"""HTML of results in a notebook: title, lines, picture, and tables cut to so many rows."""

import base64
from collections.abc import Iterable, Sequence
from html import escape

from trackbench.errors import counted
from trackbench.report.markdown_table import Text, TextTable

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
        notes.insert(0, f"and {counted(hidden_rows, 'more row')}")
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
