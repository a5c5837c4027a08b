"""Find the results folders in a folder, for a page over several results."""

import os
from pathlib import Path

from trackbench.errors import UserError


def find_results_folders(folder: Path) -> list[Path]:
    """Return the folders in ``folder`` with a config.yaml, sorted by name.

    Raises UserError if there is no such folder, or if no results folder is in it.
    """
    if not os.path.isdir(folder):
        raise UserError(f"{folder}: there is no such folder")
    results_folders = sorted(path.parent for path in folder.glob("*/config.yaml"))
    if not results_folders:
        raise UserError(f"{folder}: has neither a config.yaml nor results folders in it")
    return results_folders
