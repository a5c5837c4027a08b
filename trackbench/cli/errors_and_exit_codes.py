"""Errors of a command: their messages on stderr, the mistakes as JSON, and the exit code."""

import os
import shlex
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import wraps
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from trackbench.errors import Problem, RunError, UserError

from collections.abc import Callable

from trackbench.cli.json_objects import STDOUT, echo_line, is_real_stdout
from trackbench.errors import mistake_as_data


@contextmanager
def exit_if_stdout_fails() -> Iterator[None]:
    """Exit after the block, with its exit code, or with one line and 1 if stdout cannot be written.

    A disk may be full. If the reader of a pipe has ended, that is no error.
    """
    # As an argument of `sys.exit`, None is success, and a text is printed on stderr.
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
    if is_real_stdout(sys.stdout):
        with suppress(OSError):
            sys.stdout.flush()
            sys.exit(code)
        # What could not be flushed is written again as Python ends, which must not fail.
        os.dup2(os.open(os.devnull, os.O_WRONLY), STDOUT)
    sys.exit(code)


def as_reportable(error: Exception) -> "UserError | RunError":
    """Return the error as one with a printable message; raise it again if it is a bug of the package.

    Errors of the user, of a plugin's code and of writing to stdout have such a message.
    """
    from trackbench.errors import RunError, UserError, reason

    if isinstance(error, UserError | RunError):
        return error
    from trackbench.plugins.plugin_errors import foreign_line

    line = foreign_line(error)  # None if no plugin code raised it
    # An OSError of a file has the file's name, and an error of writing a file is a WriteError.
    if line is None and isinstance(error, OSError) and error.filename is None:
        line = f"stdout: {reason(error)}"
    if line is None:
        raise error
    return RunError(line)


def print_error(error: "UserError | RunError") -> int:
    """Print an error and return the exit code: 2 for mistakes of the user, 1 for a failed run."""
    from trackbench.errors import UserError

    if isinstance(error, UserError):
        echo_mistakes(error.problems)
        typer.echo(str(error), err=True)
        return 2
    if "--json" in sys.argv:
        echo_line({"good": False, "error": str(error)})
    typer.echo(f"error: {error}", err=True)
    # Commands that compute blocks: repeated, they go on from the blocks that are finished.
    if len(sys.argv) > 1 and sys.argv[1] in ("run", "sweep", "suite", "tune", "fit"):
        typer.echo(way_to_go_on(), err=True)
    return 1


def echo_mistakes(problems: "Iterable[Problem | str]") -> None:
    """Print the mistakes of an input as a JSON object, if the command line has ``--json``."""
    if "--json" in sys.argv:
        mistakes = [mistake_as_data(problem) for problem in problems]
        echo_line({"good": False, "mistakes": mistakes})


def way_to_go_on() -> str:
    """Write the command that goes on after an interruption, or begins again if no block is finished.

    A command that goes on has no ``--fresh``, which would compute all anew.
    """
    # If the module of the cache is not even imported, no block is finished.
    cache = sys.modules.get("trackbench.execution.cache")
    if cache is None or not cache.has_new_blocks():
        return f"to begin again: {shlex.join(['trackbench', *sys.argv[1:]])}"
    words = [word for word in sys.argv[1:] if word != "--fresh"]
    return f"finished blocks are kept, to go on: {shlex.join(['trackbench', *words])}"


def with_eof_as_error(command: Callable[..., None]) -> Callable[..., None]:
    """Return the command with its EOFErrors changed, as typer takes them for Ctrl-D at a prompt.

    For an EOFError typer prints "Aborted!" in place of the error.
    """

    @wraps(command)
    def run_command(*words: Any, **options: Any) -> None:
        """Run the command; raise RuntimeError in place of an EOFError."""
        try:
            command(*words, **options)
        except EOFError as error:
            raise RuntimeError(f"EOFError: {error}") from error

    return run_command
