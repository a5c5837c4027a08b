"""Copy a shipped experiment with its parts, to edit it: `trackbench copy`."""

import os
from pathlib import Path
from typing import NamedTuple

from trackbench.atomic_files import ensure_folder, write_bytes
from trackbench.config.file_paths import with_parts
from trackbench.config.shipped_experiments import find_shipped
from trackbench.errors import Mark, Problem, UserError


class Copied(NamedTuple):
    """A shipped experiment in a folder of the user's."""

    config: Path
    """the copy of the experiment's file"""
    written: list[Path]
    """files that were not there before"""


def copy_experiment(name: str, target: Path) -> Copied:
    """Copy a shipped experiment and its parts into a folder.

    The copies keep their relative paths. The experiment's file is written to ``target`` itself, or one
    folder deeper if it has parts outside of its own folder, such as recorded data. An existing file with
    the same content is left alone. Raises UserError, before anything is written, for every existing file
    with another content.
    """
    experiment_file = find_shipped(name)
    parts = sorted(part for part in with_parts(experiment_file) if part.is_file())
    paths = [Path(os.path.normpath(part)) for part in parts]
    root = os.path.commonpath([path.parent for path in paths])
    content = {target / path.relative_to(root): path.read_bytes() for path in paths}
    # Step 1: reject changed files before anything is written.
    existing = {path for path in content if path.exists()}
    problems = []
    for path in sorted(existing):
        if not path.is_file() or path.read_bytes() != content[path]:
            message = "exists with another content; copy to another folder, or remove this file"
            problems.append(Problem(Mark(f"copy {name}"), str(path), message))
    if problems:
        raise UserError(*problems)
    # Step 2: write the others.
    new_files = sorted(content.keys() - existing)
    for path in new_files:
        ensure_folder(path.parent)
        write_bytes(path, content[path])
    return Copied(config=target / experiment_file.relative_to(root), written=new_files)
