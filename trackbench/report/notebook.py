"""Results as a notebook shows them: HTML without a style sheet or script of its own."""

import base64
from collections.abc import Iterable, Sequence
from html import escape

from trackbench.report.text import Text, TextTable

_MOST_ROWS = 60
"""Longer tables are cut; the files have them whole."""
_NUMBER = ' style="text-align: right; white-space: nowrap"'


def table_html(table: TextTable) -> str:
    """Return a table; numbers stand to the right."""
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
    """Return the title, lines, a figure as PNG, tables."""
    parts = [f"<h4>{escape(title)}</h4>", *(f"<div>{escape(line)}</div>" for line in lines)]
    if picture:
        data = base64.b64encode(picture).decode()
        width = "width: 100%; max-width: 720px"
        parts.append(f'<img alt="" style="{width}" src="data:image/png;base64,{data}">')
    return "\n".join([*parts, *map(table_html, tables)])


def _cell(cell: Text) -> str:
    return f"<td{_NUMBER if cell.number is not None else ''}>{escape(cell.text)}</td>"
