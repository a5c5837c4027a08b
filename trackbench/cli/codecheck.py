"""Command `codecheck`: write the file codecheck.yml about stored results."""

from pathlib import Path
from typing import Annotated

import typer


def codecheck(
    folders: Annotated[list[Path], typer.Argument(metavar="DIR...", help="results folders")],
    path: Annotated[Path, typer.Option("--out", metavar="FILE", help="file to write")] = Path(
        "codecheck.yml"
    ),
) -> None:
    """Write a codecheck.yml of the tables and figures of stored results."""
    from trackbench.atomic_files import write_text
    from trackbench.commands.codecheck_certificate import codecheck_text
    from trackbench.errors import Mark, Problem, UserError

    if path.exists():
        mistake = "is there already; name another file by --out"
        raise UserError(Problem(Mark(str(path)), "", mistake))
    write_text(path, codecheck_text(folders, path.absolute().parent))
    typer.echo(f"wrote {path}")
