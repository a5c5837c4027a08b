"""The commands that look before a run: at a config, a filter of one's own, and the kept blocks."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from trackbench.cli.options import AllowPlugins, Only, Set, api_options

if TYPE_CHECKING:
    from trackbench.api import Options


def check(
    config: Annotated[Path | None, typer.Argument(help="experiment file (YAML)")] = None,
    set_: Set = None,
    only: Only = None,
    allow_plugins: AllowPlugins = False,
    contract: Annotated[
        Path | None, typer.Option(metavar="FILE", help="hold the filters of a Python file to it")
    ] = None,
) -> None:
    """Validate a config and run nothing, or hold a filter of one's own against the contract."""
    if config is None and contract is None:
        raise typer.BadParameter("name a config, or a Python file with --contract")
    if config is not None:
        _check_config(config, api_options(locals()))
    if contract is not None:
        _check_contract(contract)


def cache(
    clear: Annotated[bool, typer.Option("--clear", help="remove every block")] = False,
    prune: Annotated[
        bool, typer.Option("--prune", help="remove blocks that other versions of the code made")
    ] = False,
) -> None:
    """Show or clear the finished blocks that are kept for the next run."""
    from trackbench.experiment.computing.cache import cache_folder, cache_size, clear_cache
    from trackbench.experiment.problems import counted

    root = cache_folder()
    if clear or prune:
        clear_cache(root, old_only=not clear)
    size = cache_size(root)
    typer.echo(f"{root}/: {counted(size.blocks, 'block')}, {size.bytes / 1e6:.1f} MB")
    if size.old_blocks:
        old = f"{counted(size.old_blocks, 'block')}, {size.old_bytes / 1e6:.1f} MB"
        typer.echo(f"of other versions of the code: {old}; remove them with --prune")


def _check_config(config: Path, options: "Options") -> None:
    from trackbench import api
    from trackbench.experiment.planning.plan import check_memory
    from trackbench.experiment.problems import counted

    experiment = api.prepare(config, options)
    check_memory(experiment, workers=1)
    points = len(experiment.points)
    grid = f" at {points} points" if points > 1 else ""
    filters = counted(len(experiment.points[0].filters), "filter")
    typer.echo(f"{config}: good, {filters}{grid}")


def _check_contract(path: Path) -> None:
    from trackbench.contract import check_file, report

    found = check_file(path)
    for line in report(found):
        typer.echo(line)
    if any(finding.verdict == "bad" for findings in found.values() for finding in findings):
        raise typer.Exit(1)
