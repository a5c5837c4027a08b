"""Command line: options in, messages out, no logic. Heavy modules are imported when needed."""

import sys
from collections.abc import Callable
from contextlib import nullcontext
from functools import wraps
from io import TextIOWrapper
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from trackbench import __version__
from trackbench.cli.check import cache, check
from trackbench.cli.compare import gate, history
from trackbench.cli.info import copy, describe, list_, new, schema, show
from trackbench.cli.output import as_reportable, objects_alone, print_error, written_stdout
from trackbench.cli.results import codecheck, compare, plot, report, verify
from trackbench.cli.run import fit, run, suite, sweep, tune
from trackbench.core import compiled

if TYPE_CHECKING:
    from typer._click import Context, HelpFormatter

_TASKS: dict[str, tuple[Callable[..., None], ...]] = {
    "Run experiments": (run, suite, sweep, tune, fit),
    "Read results": (codecheck, compare, gate, history, plot, report, verify),
    "Write configs": (list_, describe, show, copy, check, schema),
    "Write components": (new,),
    "Free disk space": (cache,),
}
"""Commands by task."""


class _Tasks(TyperGroup):
    """Help that groups commands by task, and prints each command's line whole."""

    def format_commands(self, ctx: "Context", formatter: "HelpFormatter") -> None:
        for task, commands in _TASKS.items():
            names = [_name(command) for command in commands]
            with formatter.section(task):
                texts = [self.commands[name].get_short_help_str(_WHOLE) for name in names]
                formatter.write_dl([*zip(names, texts, strict=True)])


_WHOLE = 1000
"""Letters of a command's line at most."""
app = typer.Typer(
    cls=_Tasks,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    help="Monte Carlo experiments with target-tracking filters, from YAML to tables and figures.\n\n"
    "Start with `trackbench run air-traffic` or `trackbench new experiment`.",
)


def _version(wanted: bool) -> None:
    if wanted:
        kernels = "compiled kernels" if compiled.kernels else "numpy alone"
        typer.echo(f"trackbench {__version__}, {kernels}")
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="print the version")
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


def _name(command: Callable[..., None]) -> str:
    return command.__name__.removesuffix("_")


for _commands in _TASKS.values():
    for _command in _commands:
        app.command(_name(_command))(_not_aborted(_command))


def main() -> None:
    """Run the command line.

    Exit codes: 0 done, 1 a filter failed or stdout cannot be written, 2 bad input, 130 interrupted.
    """
    if sys.stdout is None:
        sys.exit("error: stdout is closed; redirect it to a file or to /dev/null")
    if isinstance(sys.stdout, TextIOWrapper):  # a folder's name need not be UTF-8, as stderr knows
        sys.stdout.reconfigure(errors="backslashreplace")
    with written_stdout(), objects_alone() if "--json" in sys.argv else nullcontext():
        try:
            app()
        except Exception as error:
            sys.exit(print_error(as_reportable(error)))
        except SystemExit as end:
            # Typer exits without a word after Ctrl-C.
            if isinstance(getattr(end.__context__, "__cause__", None), KeyboardInterrupt):
                typer.echo("\ninterrupted", err=True)
            raise
