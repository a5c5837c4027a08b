"""Output: JSON objects on stdout for programs, messages and errors for people."""

import json
import os
import shlex
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, redirect_stdout, suppress
from contextvars import ContextVar
from math import isfinite, isnan
from typing import TYPE_CHECKING, Any, TextIO

import typer

if TYPE_CHECKING:
    from trackbench.api import Report
    from trackbench.errors import Problem, RunError, UserError
    from trackbench.report.table import Table, TextTable


_STDOUT = 1
_STDERR = 2
_OBJECTS: ContextVar[TextIO | None] = ContextVar("objects", default=None)
"""Stream that JSON objects are written to, if not stdout."""


def echo_line(line: dict[str, Any]) -> None:
    """Print a JSON object. NaN becomes null, infinity a word."""
    text = json.dumps(_as_json(line), ensure_ascii=False, allow_nan=False)
    typer.echo(text, file=_OBJECTS.get())


@contextmanager
def exit_if_stdout_fails() -> Iterator[None]:
    """End with one line and exit code 1 if stdout cannot be written, such as on a full disk."""
    code: str | int | None = None
    try:
        try:
            yield
        except SystemExit as end:
            code = end.code
        sys.stdout.flush()
    except BrokenPipeError:  # the reader has ended
        pass
    except OSError as error:
        from trackbench.errors import reason

        if error.filename is not None:  # it is of a file, and not of stdout
            raise
        code = f"error: stdout: {reason(error)}"
    if _is_real_stdout(sys.stdout):
        with suppress(OSError):
            sys.stdout.flush()
            sys.exit(code)
        # What could not be flushed is written again as Python ends, which must not fail.
        os.dup2(os.open(os.devnull, os.O_WRONLY), _STDOUT)
    sys.exit(code)


@contextmanager
def stdout_for_objects() -> Iterator[None]:
    """Reserve stdout for JSON: prints of plugins go to stderr, those of workers too."""
    with _duplicated_stdout() as objects, redirect_stdout(sys.stderr):
        token = _OBJECTS.set(objects)
        try:
            yield
        finally:
            _OBJECTS.reset(token)


@contextmanager
def _duplicated_stdout() -> Iterator[TextIO]:
    """Duplicate stdout for JSON, and let stdout and new processes write to stderr."""
    if not _is_real_stdout(sys.stdout):
        yield sys.stdout
        return
    sys.stdout.flush()
    duplicate = os.dup(_STDOUT)
    os.dup2(_STDERR, _STDOUT)
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
            os.dup2(duplicate, _STDOUT)
            os.close(duplicate)


def _is_real_stdout(stream: TextIO) -> bool:
    """Distinguish the real stdout from a caller's replacement."""
    try:
        return stream.fileno() == _STDOUT
    except (OSError, ValueError):
        return False


def as_reportable(error: Exception) -> "UserError | RunError":
    """Return the error as one with a printable message; raise it again if it is a bug of the package."""
    from trackbench.errors import RunError, UserError, reason

    if isinstance(error, UserError | RunError):
        return error
    from trackbench.plugins.errors import foreign_line

    line = foreign_line(error)
    if line is None and isinstance(error, OSError) and error.filename is None:
        line = f"stdout: {reason(error)}"  # files have names, and errors of writing have a class
    if line is None:
        raise error
    return RunError(line)


def print_error(error: "UserError | RunError") -> int:
    """Print an error and return the exit code."""
    from trackbench.errors import UserError

    if isinstance(error, UserError):
        echo_mistakes(error.problems)
        typer.echo(str(error), err=True)
        return 2
    if "--json" in sys.argv:
        echo_line({"good": False, "error": str(error)})
    typer.echo(f"error: {error}", err=True)
    if len(sys.argv) > 1 and sys.argv[1] in ("run", "sweep", "tune", "fit"):
        typer.echo(way_to_go_on(), err=True)
    return 1


def echo_mistakes(problems: "Iterable[Problem | str]") -> None:
    """Print the mistakes of an input as an object, if the command line has ``--json``."""
    if "--json" in sys.argv:
        mistakes = [_mistake_as_data(problem) for problem in problems]
        echo_line({"good": False, "mistakes": mistakes})


def way_to_go_on() -> str:
    """Write the command that goes on after an interruption, or begins again if no block is finished.

    A command that goes on has no ``--fresh``, which would compute all anew.
    """
    cache = sys.modules.get("trackbench.execution.cache")
    if cache is None or not cache.has_new_blocks():
        return f"to begin again: {shlex.join(['trackbench', *sys.argv[1:]])}"
    words = [word for word in sys.argv[1:] if word != "--fresh"]
    return f"finished blocks are kept, to go on: {shlex.join(['trackbench', *words])}"


def report_as_data(report: "Report") -> dict[str, Any]:
    """Describe a run's files, tables and notes as data."""
    from trackbench.report.verdicts.comparison_files import claim_rows, number_rows

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


def _mistake_as_data(problem: "Problem | str") -> dict[str, Any]:
    """Describe a mistake by its position, path and text."""
    if isinstance(problem, str):
        return {"file": "", "line": 0, "column": 0, "path": "", "what": problem}
    return {**vars(problem.mark), "path": problem.path, "what": problem.what}


def table_rows(table: "Table") -> dict[str, Any]:
    """Describe a table's title, rows and notes as data."""
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
    """Convert a value to one that JSON has: no numpy numbers, NaN and infinity."""
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
