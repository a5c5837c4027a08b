"""Command `cache`: show the size of the cache, or clear it."""

from typing import Annotated

import typer


def cache(
    clear: Annotated[bool, typer.Option("--clear", help="remove all of it")] = False,
    prune: Annotated[
        bool, typer.Option("--prune", help="remove blocks that other versions of the code made")
    ] = False,
) -> None:
    """Show or clear the cache: finished blocks and drawn figures."""
    from trackbench.errors import counted
    from trackbench.execution.cache import cache_folder
    from trackbench.execution.clear_cache import FolderSize, cache_size, clear_cache

    root = cache_folder()
    if clear or prune:  # `--clear` beside `--prune` removes all
        clear_cache(root, old_only=not clear)
    size = cache_size(root)

    def number_and_size(files: FolderSize, noun: str) -> str:
        return f"{counted(files.number, noun)}, {files.bytes / 1e6:.1f} MB"

    typer.echo(f"{root}/: {number_and_size(size.blocks, 'block')}")
    if size.old_blocks.number:
        old_blocks = number_and_size(size.old_blocks, "block")
        typer.echo(f"of other versions of the code: {old_blocks}; remove them with --prune")
    if size.figures.number:
        figures = number_and_size(size.figures, "file")
        typer.echo(f"figures: {figures}; --clear removes them, too")
