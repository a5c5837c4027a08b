"""What is said: JSON on stdout, an object a line, for programs, and what went wrong for people."""

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
    from trackbench.report.table import Table


_STDOUT, _STDERR = 1, 2
_OBJECTS: ContextVar[TextIO | None] = ContextVar("objects", default=None)
"""Where objects go, if not to stdout."""


def echo_line(line: dict[str, Any]) -> None:
    """Print an object. What is no number is null; infinite is a word, since JSON has no such number."""
    text = json.dumps(_plain(line), ensure_ascii=False, allow_nan=False)
    typer.echo(text, file=_OBJECTS.get())


@contextmanager
def objects_alone() -> Iterator[None]:
    """Keep stdout for objects: what code of one's own prints goes to stderr, also that of workers."""
    with _stdout_apart() as objects, redirect_stdout(sys.stderr):
        token = _OBJECTS.set(objects)
        try:
            yield
        finally:
            _OBJECTS.reset(token)


@contextmanager
def _stdout_apart() -> Iterator[TextIO]:
    """What stdout was, while the processes that are begun from here take stderr for it."""
    if not _is_the_systems(sys.stdout):
        yield sys.stdout
        return
    sys.stdout.flush()
    copy = os.dup(_STDOUT)
    os.dup2(_STDERR, _STDOUT)
    coding = sys.stdout.encoding
    objects = open(copy, "w", encoding=coding, errors="backslashreplace", closefd=False)  # noqa: SIM115
    try:
        yield objects
    finally:
        with suppress(BrokenPipeError):  # nobody reads them any more
            objects.close()
        os.dup2(copy, _STDOUT)
        os.close(copy)


def _is_the_systems(stream: TextIO) -> bool:
    """Whether a stream is stdout itself, and not what a caller has put in its place."""
    try:
        return stream.fileno() == _STDOUT
    except (OSError, ValueError):
        return False


def as_reportable(error: Exception) -> "UserError | RunError":
    """What can be said of an error in a line, plugins' as well; a bug of our own is raised again."""
    from trackbench.errors import RunError, UserError

    if isinstance(error, UserError | RunError):
        return error
    from trackbench.plugins.errors import foreign_line

    line = foreign_line(error)
    if line is None:
        raise error
    return RunError(line)


def print_error(error: "UserError | RunError") -> int:
    """Say what went wrong; the exit code."""
    from trackbench.errors import UserError

    if isinstance(error, UserError):
        if "--json" in sys.argv:
            echo_line(mistakes(error.problems))
        typer.echo(str(error), err=True)
        return 2
    typer.echo(f"error: {error}", err=True)
    if sys.argv[1:2] and sys.argv[1] in ("run", "sweep", "tune"):
        typer.echo(f"finished blocks are kept; to go on: {this_command()}", err=True)
    return 1


def this_command() -> str:
    """The command line as it may be typed again."""
    return shlex.join(["trackbench", *sys.argv[1:]])


def mistakes(problems: "Iterable[Problem | str]") -> dict[str, Any]:
    """Bad input: where each mistake stands, and what it is."""
    return {"good": False, "mistakes": [_mistake(problem) for problem in problems]}


def reported(report: "Report") -> dict[str, Any]:
    """What a run wrote, and what is to be known of it."""
    from trackbench.report.verdicts.files import claim_rows, number_rows

    return {
        "experiment": report.results.config["name"],
        "folder": str(report.folder),
        "tables": {name: _table(table) for name, table in report.tables.items()},
        "numbers": number_rows(report.comparison),
        "claims": claim_rows(report.comparison),
        "best": [best._asdict() for best in report.best],
        "answer": report.answer,
        "notes": report.notes,
        "failed": report.failed,
    }


def _mistake(problem: "Problem | str") -> dict[str, Any]:
    if isinstance(problem, str):
        return {"file": "", "line": 0, "column": 0, "path": "", "what": problem}
    return {**vars(problem.mark), "path": problem.path, "what": problem.what}


def _table(table: "Table") -> dict[str, Any]:
    header = table.csv_header
    rows = [dict(zip(header, row, strict=True)) for row in table.csv_rows()]
    return {"title": table.title, "rows": rows, "notes": table.notes}


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _plain(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(inner) for inner in value]
    value = value.item() if hasattr(value, "item") else value
    if not isinstance(value, float) or isfinite(value):
        return value
    return None if isnan(value) else str(value)
