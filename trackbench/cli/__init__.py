"""Command line: options in, messages out, no logic. Heavy modules are imported when needed."""

import sys
from collections.abc import Callable
from contextlib import nullcontext
from functools import wraps
from io import TextIOWrapper
from typing import Annotated, Any

import typer

from trackbench import __version__
from trackbench.cli.check import cache, check
from trackbench.cli.compare import gate, history
from trackbench.cli.info import copy, describe, list_, new, schema, show
from trackbench.cli.output import as_reportable, objects_alone, print_error
from trackbench.cli.results import compare, plot, report, verify
from trackbench.cli.run import run, sweep, tune
from trackbench.core import compiled

app = typer.Typer(
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    help="Monte Carlo experiments with target-tracking filters, from YAML to tables and figures.",
)
_COMMANDS: tuple[Callable[..., None], ...] = (
    *(run, compare, gate, history, plot, report, verify, sweep, tune),
    *(cache, check, list_, describe, show, copy, new, schema),
)


def _version(wanted: bool) -> None:
    if wanted:
        kernels = "compiled kernels" if compiled.kernels else "numpy alone"
        typer.echo(f"trackbench {__version__}, {kernels}")
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="say the version")
    ] = False,
) -> None:
    """Run Monte Carlo experiments with target-tracking filters."""


def _not_aborted(command: Callable[..., None]) -> Callable[..., None]:
    """Hide an EOFError of a command from click, which would print "Aborted!" as after Ctrl-D."""

    @wraps(command)
    def called(*words: Any, **options: Any) -> None:
        try:
            command(*words, **options)
        except EOFError as error:
            raise RuntimeError(f"EOFError: {error}") from error

    return called


for _command in _COMMANDS:
    app.command(_command.__name__.removesuffix("_"))(_not_aborted(_command))


def main() -> None:
    """Run the command line; exit codes: 0 done, 1 a filter failed, 2 bad input, 130 interrupted."""
    if isinstance(sys.stdout, TextIOWrapper):  # a folder's name need not be UTF-8, as stderr knows
        sys.stdout.reconfigure(errors="backslashreplace")
    with objects_alone() if "--json" in sys.argv else nullcontext():
        try:
            app()
        except Exception as error:
            sys.exit(print_error(as_reportable(error)))
