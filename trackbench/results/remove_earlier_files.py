"""Files of earlier runs in a results folder, which the next run removes; files of the user stay."""

import json
import re
from collections.abc import Collection, Iterator
from contextlib import suppress
from itertools import product
from pathlib import Path, PurePosixPath

from trackbench.atomic_files import remove
from trackbench.errors import UserError
from trackbench.readable_files import require_regular_file
from trackbench.results.file_names import (
    DEFAULT,
    DERIVED_FILES,
    FIGURE_FORMS,
    MACHINE,
    MANIFEST,
    RUN_FILES,
    TABLE_FORMS,
)
from trackbench.yaml_source import read

_OLD_FILES = ("timing.csv", "time_verdicts.csv", *(f"{name}.xz" for name in RUN_FILES))
"""Files of older versions, which a run removes."""
_NAMED = {"tables": TABLE_FORMS, "figures": FIGURE_FORMS}
"""Folders of files that the config names, and their formats."""
_FORMS_BY_FOLDER = {
    "tables": TABLE_FORMS,
    "figures": FIGURE_FORMS,
    "run/tables": TABLE_FORMS,
    "run/figures": FIGURE_FORMS,
    "published": ("csv",),
}
"""Formats of the files in each folder."""
_PARTIAL = re.compile(r"\.(.+)\.[0-9]+\.part")
"""Name of a file that is being written: that of the whole file, and the process id."""


def remove_outputs(folder: Path, keep: Collection[str]) -> None:
    """Remove the files that earlier runs wrote, the manifest last; files of the user stay.

    The manifest names the files of a complete run. The config names tables and figures of an interrupted
    run, whose manifest has only the data or is missing. ``keep`` are names of files that the next run
    reads.
    """
    names = {*RUN_FILES, *DERIVED_FILES, *_OLD_FILES, MACHINE}
    names.update(_named_by_manifests(folder))
    names.update(_named_by_config(folder))
    paths = [folder / name for name in names.difference(keep)]
    # Half-written files of a killed process, in the folder and its inner folders. No process writes any
    # now, as the caller has locked the folder.
    for inner in ("", "run", *_FORMS_BY_FOLDER):
        for path in (folder / inner).glob(".*.part"):
            whole = _PARTIAL.fullmatch(path.name)
            if whole and _is_output(PurePosixPath(inner, whole[1])):
                paths.append(path)
    for path in (*paths, folder / MANIFEST):
        # A link inside the folder may lead to files of the user. The last parent is the folder itself.
        inner_folders = path.relative_to(folder).parents[:-1]
        if path.is_file() and not any((folder / inner).is_symlink() for inner in inner_folders):
            remove(path)


def _is_output(path: PurePosixPath) -> bool:
    """Test whether any version writes files of this name into a results folder."""
    known = (*RUN_FILES, *DERIVED_FILES, *_OLD_FILES, "config.yaml", MANIFEST, MACHINE)
    forms = _FORMS_BY_FOLDER.get(path.parent.as_posix(), ())
    return str(path) in known or path.suffix.removeprefix(".") in forms


def _named_by_manifests(folder: Path) -> Iterator[str]:
    """Yield the names in the manifests that a run can have written.

    Other names are left out, as anybody may have edited a manifest.
    """
    for manifest in (MANIFEST, MACHINE):
        with suppress(OSError, ValueError, LookupError, TypeError, RecursionError):
            for name in json.loads(require_regular_file(folder / manifest).read_bytes())["files"]:
                if _is_output(PurePosixPath(name)):
                    yield name


def _named_by_config(folder: Path) -> Iterator[str]:
    """Yield names of the tables and figures that the config asks for."""
    with suppress(UserError):  # a missing or unreadable config names nothing
        config = read(folder / "config.yaml").data
        if not isinstance(config, dict):
            return
        for group, forms in _NAMED.items():
            exhibits = config.get(group)
            if not isinstance(exhibits, dict):
                continue
            # A name with a slash could lead out of the folder. Without tables or figures in the config a
            # run writes one with the name `DEFAULT`.
            safe = [name for name in (*exhibits, DEFAULT) if "/" not in str(name)]
            # Files of formats that an option asks for are in `run/`.
            for place, name, form in product(("", "run/"), safe, forms):
                yield f"{place}{group}/{name}.{form}"
