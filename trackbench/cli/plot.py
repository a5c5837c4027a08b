"""Command `plot`: draw the figures of stored results again."""

from pathlib import Path
from typing import Annotated, Any

import typer

from trackbench.cli.options import AllowPlugins, Folder, formats, one_of
from trackbench.cli.printed_outcome import print_written_files

_DEFAULT_FORMATS = {"screen": "png,svg", "paper": "pdf"}
"""File formats of `trackbench plot` without `--format`, by its `--style`."""


def plot(
    folder: Folder,
    only: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="this figure or kind of figure only")
    ] = None,
    format_: Annotated[
        str | None,
        typer.Option(
            "--format", help="png, svg, pdf, tex (as pdf), with commas [png,svg; for a paper pdf]"
        ),
    ] = None,
    style: Annotated[
        str,
        typer.Option(
            help="screen, or paper: NAME-column and NAME-page, 3.5 and 7.2 in wide, letters of 8 pt"
        ),
    ] = "screen",
    allow_plugins: AllowPlugins = False,
) -> None:
    """Draw the figures of stored results again, without computing runs."""
    from trackbench.commands import read_and_rewrite_stored_results

    chosen_style: Any = one_of("--style", style, ("screen", "paper"))
    if not format_:
        format_ = _DEFAULT_FORMATS[chosen_style]
    figure_formats = formats(format_)

    def draw() -> list[Path]:
        return read_and_rewrite_stored_results.plot(
            folder,
            formats=figure_formats,
            only=tuple(only or ()),
            allow_plugins=allow_plugins,
            style=chosen_style,
        )

    print_written_files(draw)
