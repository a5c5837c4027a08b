"""Checks of a results folder before a run writes to it: foreign files, permissions, earlier runs."""

import json
import os
import stat
from collections.abc import Collection
from contextlib import suppress
from pathlib import Path

from trackbench.config.resolved_config import as_yaml
from trackbench.errors import Mark, Problem, UserError, reason
from trackbench.results.folder_contents import DERIVED_FILES, RUN_FILES
from trackbench.yaml_source import read


def check_out(folder: Path, data: Collection[str]) -> None:
    """Raise UserError if a run cannot write into the results folder, or would replace foreign files.

    ``data`` names the data files that the run writes.
    """
    for path in (folder, *folder.parents):
        message = ""
        try:
            if not stat.S_ISDIR(path.stat().st_mode):
                message = f"{path} is a file, not a folder"
        except (FileNotFoundError, NotADirectoryError):
            if path.is_symlink():
                message = f"{path} is a link to nothing"
        except OSError as error:
            message = f"{path}: {reason(error)}"
        if message:
            raise UserError(Problem(Mark(f"--out {folder}"), "", message))
    foreign_file = _foreign_file(folder, data)
    if foreign_file is not None:
        message = "no run wrote this file, and this run would replace it; choose another --out"
        raise UserError(Problem(Mark(str(foreign_file)), "", message))
    if not may_write(folder):
        message = "may not be written in; another folder: --out DIR"
        raise UserError(Problem(Mark(f"{folder}/"), "", message))


def stored_runs(folder: Path) -> int:
    """Read the number of runs of the results in a folder; 0 without results."""
    with suppress(OSError, ValueError, LookupError, TypeError):
        return int(json.loads((folder / "manifest.json").read_bytes())["runs"])
    return 0


def _foreign_file(folder: Path, data: Collection[str]) -> Path | None:
    """Find a file that a run would replace although no run wrote it; None if there is none.

    ``data`` names the data files that the run writes. A config.yaml as runs write it may be replaced.
    """
    # Every file in a folder of a run, even of a killed one, may be replaced. It has one of these files.
    if any((folder / name).exists() for name in ("manifest.json", "points.json")):
        return None
    for name in ("config.yaml", *data, *RUN_FILES, *DERIVED_FILES):
        path = folder / name
        if not path.is_file():
            continue
        is_config_of_run = name == "config.yaml" and _is_written_by_run(path)
        if not is_config_of_run:
            return path
    return None


def _is_written_by_run(config: Path) -> bool:
    """Test whether a config has the form in which runs write theirs; False if it cannot be read.

    A run writes the YAML that `as_yaml` makes of the data.
    """
    with suppress(OSError, UserError, ValueError, LookupError):
        text = config.read_text(encoding="utf-8")
        return as_yaml(read(config).data) == text
    return False


def may_write(folder: Path) -> bool:
    """Test whether the folder, or its first existing parent, is writable."""
    first_existing = folder
    for path in (folder, *folder.absolute().parents):
        if path.exists():
            first_existing = path
            break
    return os.access(first_existing, os.W_OK | os.X_OK)
