"""Typer application: the commands by task, their names, and the exit codes.

Heavy modules are imported when needed.
"""

import sys
from collections.abc import Callable
from contextlib import nullcontext
from io import TextIOWrapper
from typing import TYPE_CHECKING, Annotated

import typer
from typer.core import TyperGroup

from trackbench import __version__
from trackbench.cli.cache import cache
from trackbench.cli.check import check
from trackbench.cli.codecheck import codecheck
from trackbench.cli.compare import compare
from trackbench.cli.describe import describe
from trackbench.cli.errors_and_exit_codes import (
    as_reportable,
    echo_mistakes,
    exit_if_stdout_fails,
    print_error,
    with_eof_as_error,
)
from trackbench.cli.fit import fit
from trackbench.cli.gate import gate
from trackbench.cli.json_objects import stdout_for_objects
from trackbench.cli.list import list_
from trackbench.cli.new import new
from trackbench.cli.options import CommandWithSingleOptions
from trackbench.cli.plot import plot
from trackbench.cli.report import report
from trackbench.cli.run import run
from trackbench.cli.schema import schema
from trackbench.cli.show_and_copy import copy, show
from trackbench.cli.suite import suite
from trackbench.cli.sweep import sweep
from trackbench.cli.tune import tune
from trackbench.cli.verify import verify
from trackbench.core import compiled

if TYPE_CHECKING:
    from typer._click import Context, HelpFormatter

_TASKS: dict[str, tuple[Callable[..., None], ...]] = {
    "Run experiments": (run, suite, sweep, tune, fit),
    "Read results": (codecheck, compare, gate, plot, report, verify),
    "Write configs": (list_, describe, show, copy, check, schema),
    "Write components": (new,),
    "Free disk space": (cache,),
}
"""Commands by task."""


class _Tasks(TyperGroup):
    """Help that groups commands by task, and prints each command's line whole."""

    def format_commands(self, ctx: "Context", formatter: "HelpFormatter") -> None:
        """Write the commands into the help, each with a line, under the task that they are for."""
        for task, commands in _TASKS.items():
            rows = []
            for command in commands:
                name = _command_name(command)
                rows.append((name, self.commands[name].get_short_help_str(_MOST_LETTERS)))
            with formatter.section(task):
                formatter.write_dl(rows)


_MOST_LETTERS = 1000
"""Largest length of a command's line: every line is printed whole."""
app = typer.Typer(
    cls=_Tasks,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    help="Monte Carlo experiments with target-tracking filters, from YAML to tables and figures.\n\n"
    "Start with `trackbench run air-traffic` or `trackbench new experiment`.",
)


def _print_version(is_requested: bool) -> None:
    """Print the version, if it is requested, and exit."""
    if is_requested:
        kernels = "compiled kernels" if compiled.kernels else "numpy alone"
        typer.echo(f"trackbench {__version__}, {kernels}")
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_print_version, is_eager=True, help="print the version"),
    ] = False,
) -> None:
    """Run Monte Carlo experiments with target-tracking filters."""


def _command_name(command: Callable[..., None]) -> str:
    """Return the name on the command line: that of `list_` is ``list``."""
    return command.__name__.removesuffix("_")


for _commands in _TASKS.values():
    for _command in _commands:
        app.command(_command_name(_command), cls=CommandWithSingleOptions)(
            with_eof_as_error(_command)
        )


def main() -> None:
    """Run the command line.

    Exit codes: 0 done, 1 a filter failed or stdout cannot be written, 2 bad input, 130 interrupted.
    """
    if sys.stdout is None:
        sys.exit("error: stdout is closed; redirect it to a file or to /dev/null")
    # A name of a folder that is not UTF-8 is printed with escapes.
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")
    # With --json nothing but objects goes to stdout.
    output = stdout_for_objects() if "--json" in sys.argv else nullcontext()
    with exit_if_stdout_fails(), output:
        try:
            app()
        except Exception as error:
            sys.exit(print_error(as_reportable(error)))
        except SystemExit as end:
            # An unknown option or a missing argument: typer has printed the reason on stderr.
            format_message = getattr(end.__context__, "format_message", None)
            if format_message is not None:
                echo_mistakes([format_message()])
            # Typer exits without a message after Ctrl-C.
            if isinstance(getattr(end.__context__, "__cause__", None), KeyboardInterrupt):
                typer.echo("\ninterrupted", err=True)
            raise
