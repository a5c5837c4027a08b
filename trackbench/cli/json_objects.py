"""JSON objects on stdout for programs: a run's files, tables and notes as data."""

import json
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout, suppress
from contextvars import ContextVar
from math import isfinite, isnan
from typing import TYPE_CHECKING, Any, TextIO

import typer

if TYPE_CHECKING:
    from trackbench.api import Report
    from trackbench.report.markdown_table import TextTable
    from trackbench.report.table import Table


STDOUT = 1
_STDERR = 2
_OBJECTS: ContextVar[TextIO | None] = ContextVar("objects", default=None)
"""Stream that JSON objects are written to, if not stdout."""


def echo_line(line: dict[str, Any]) -> None:
    """Print a JSON object. NaN becomes null, infinity a word."""
    text = json.dumps(_as_json(line), ensure_ascii=False, allow_nan=False)
    typer.echo(text, file=_OBJECTS.get())


@contextmanager
def stdout_for_objects() -> Iterator[None]:
    """Reserve stdout for JSON objects within the block; all else that is printed goes to stderr.

    This includes what plugins and worker processes print. `echo_line` writes objects to `_OBJECTS`.
    """
    with _duplicated_stdout() as objects, redirect_stdout(sys.stderr):
        token = _OBJECTS.set(objects)
        try:
            yield
        finally:
            _OBJECTS.reset(token)


@contextmanager
def _duplicated_stdout() -> Iterator[TextIO]:
    """Yield a duplicate of stdout for JSON; within the block stdout itself writes to stderr.

    So do new processes, which inherit it. A stdout that a caller has replaced is yielded as it is.
    """
    if not is_real_stdout(sys.stdout):
        yield sys.stdout
        return
    sys.stdout.flush()
    duplicate = os.dup(STDOUT)
    os.dup2(_STDERR, STDOUT)
    # JSON is UTF-8 whatever the terminal's encoding is. The name of a file that is no UTF-8 has escapes,
    # which JSON reads.
    objects = open(  # noqa: SIM115
        duplicate, "w", encoding="utf-8", errors="backslashreplace", closefd=False
    )
    try:
        yield objects
    finally:
        try:
            # Closing fails if the reader has ended, or if an object could not be written before.
            with suppress(OSError):
                objects.close()
        finally:
            os.dup2(duplicate, STDOUT)
            os.close(duplicate)


def is_real_stdout(stream: TextIO) -> bool:
    """Test whether a stream is the real stdout, and not a caller's replacement such as StringIO."""
    try:
        return stream.fileno() == STDOUT
    except (OSError, ValueError):
        return False


def report_as_data(report: "Report") -> dict[str, Any]:
    """Describe a run's files, tables and notes as data.

    Its ``answer`` are the conclusions beside the ranking, a sentence each. ``failed`` are the filters
    and the outputs that failed, a line each.
    """
    from trackbench.report.verdicts.verdict_files import claim_rows, number_rows

    return {
        "experiment": report.results.config["name"],
        "folder": str(report.folder),
        "tables": {name: table_rows(table) for name, table in report.tables.items()},
        "numbers": number_rows(report.comparison),
        "claims": claim_rows(report.comparison),
        "best": [best._asdict() for best in report.best],
        "ranking": [_text_table_rows(table) for table in report.ranking()],
        "answer": report.answer,
        "notes": report.notes,
        "failed": report.failed,
    }


def table_rows(table: "Table") -> dict[str, Any]:
    """Describe a table's title, rows and notes as data; a row has the cells of its CSV by column."""
    header = table.csv_header
    rows = [dict(zip(header, row, strict=True)) for row in table.csv_rows()]
    return {"title": table.title, "rows": rows, "notes": table.notes}


def _text_table_rows(table: "TextTable") -> dict[str, Any]:
    """Describe a table as data, with its cells as on the screen."""
    rows = []
    for row in table.rows:
        texts = [cell.text for cell in row]
        rows.append(dict(zip(table.heads, texts, strict=True)))
    return {"title": table.title, "rows": rows, "notes": table.notes}


def _as_json(value: Any) -> Any:
    """Convert a value to one that JSON has: no numpy numbers; NaN is null, infinity a word."""
    if isinstance(value, dict):
        return {str(key): _as_json(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_as_json(inner) for inner in value]
    scalar = value.item() if hasattr(value, "item") else value
    if not isinstance(scalar, float) or isfinite(scalar):
        return scalar
    if isnan(scalar):
        return None
    return str(scalar)
