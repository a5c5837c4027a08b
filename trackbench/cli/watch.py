"""Option `--watch`: wait until a file of a config is saved, and run again."""

import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from trackbench.cli.changed_files import stamps_of, wait_for_changes
from trackbench.cli.errors_and_exit_codes import as_reportable, print_error

if TYPE_CHECKING:
    from trackbench.api import Options


def run_after_changes(
    config: Path, run_config: Callable[[], None], others: Iterable[Path] = ()
) -> None:
    """Call ``run_config`` now and after each change, until an exception such as Ctrl-C.

    ``others`` are files that are watched beside the config and those that it names.
    """
    from trackbench.errors import counted

    files = {config, *others}
    while True:
        files |= _files_of_config(config, files)
        # Stamps from before the run also show a change during the run.
        before = stamps_of(files, known={})  # no stamps are known, so that every file is read
        run_config()
        existing = sum(stamp is not None for stamp in before.values())
        typer.echo(f"watching {counted(existing, 'file')}, until Ctrl-C: {config}", err=True)
        for file in wait_for_changes(before):
            typer.echo(f"{time.strftime('%H:%M:%S')} {file} was saved", err=True)


def _files_of_config(config: Path, known: Iterable[Path]) -> set[Path]:
    """List the config and the files that it names; the ``known`` files if it cannot be read."""
    from trackbench.config.file_paths import with_parts
    from trackbench.errors import UserError

    try:
        return set(with_parts(config))
    except UserError:
        return set(known)


def watch_config(
    configs: list[Path], options: "Options", run_config: Callable[[Path], object]
) -> None:
    """Call ``run_config`` for one config now and after each change of a file.

    Ctrl-C between runs exits with 0. An error is printed, and the next change is waited for.
    """
    from trackbench.commands.run_options import say
    from trackbench.config.shipped_experiments import located
    from trackbench.errors import Mark, Problem, UserError

    if len(configs) > 1 or str(configs[0]) == "-":
        raise UserError(Problem(Mark("--watch"), "", "watches one config, and that a file"))
    config = located(configs[0], lambda line: say(line, options))

    def run_once() -> None:
        """Run the config, and print an error."""
        try:
            run_config(config)
        except Exception as error:
            print_error(as_reportable(error))

    with suppress(KeyboardInterrupt):
        run_after_changes(config, run_once, [Path(file) for file in options.filters])
