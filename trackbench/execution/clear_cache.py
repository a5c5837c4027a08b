"""Size of the cache, and its deletion: only files that trackbench wrote."""

import os
import re
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from trackbench.atomic_files import write_text
from trackbench.errors import Mark, Problem, UserError
from trackbench.execution.code_digests import code_digest
from trackbench.readable_files import require_regular_file

CODE_DIGITS = 12
"""Digits of the digest of the code in the name of a folder of blocks."""


class FolderSize(NamedTuple):
    """Number of files and their bytes."""

    number: int
    bytes: int

    @classmethod
    def measure(cls, folders: Iterable[Path]) -> "FolderSize":
        """Count the files in some folders and below them, and add up their bytes."""
        sizes = []
        for folder in folders:
            # Every file that trackbench writes there has an ending.
            for path in folder.rglob("*.*"):
                if path.is_file():
                    sizes.append(path.stat().st_size)
        return cls(number=len(sizes), bytes=sum(sizes))


class CacheSize(NamedTuple):
    """Size of a cache folder."""

    blocks: FolderSize
    """blocks of this version of the code"""
    old_blocks: FolderSize
    """blocks of other versions"""
    figures: FolderSize


def cache_size(root: Path) -> CacheSize:
    """Measure the files that `trackbench cache` reports, and removes with `--prune` and `--clear`."""
    # Blocks are in one folder for each version of the code, by its digest.
    now = code_digest()[:CODE_DIGITS]
    current = [folder for folder in _versions(root) if folder.name == now]
    old = [folder for folder in _versions(root) if folder.name != now]
    return CacheSize(
        blocks=FolderSize.measure(current),
        old_blocks=FolderSize.measure(old),
        figures=FolderSize.measure([root / "figures"]),
    )


_MARKER = ".trackbench-cache"
_MARK = "trackbench wrote this folder as its cache, and may delete its own files in it.\n"
_WRITTEN = re.compile(
    r"blocks/[0-9a-f]{12}/[0-9a-f]{2}/\.?[0-9a-f]{64}\.block(\.\d+\.part)?"
    r"|figures/[0-9a-f]{2}/\.?[0-9a-f]{64}\.(png|svg|pdf)(\.\d+\.part)?"
    r"|times/\.?[0-9a-f]{64}\.json(\.\d+\.part)?"
)
"""Names of the files that are deleted."""
_BESIDE = re.compile(r"\.gitignore|shared-[0-9a-f]{16}")
"""Names of trackbench's other files in a cache: by the second one workers detect that they share it."""


def mark_cache(root: Path) -> bool:
    """Mark a folder as a cache, by a file in it, unless it has files that trackbench did not write.

    Return whether the folder is marked now. Only the files of marked folders are deleted. Raises
    WriteError. trackbench's own files are results (`_WRITTEN`), also half-written ones, and the few
    files that are never deleted (`_BESIDE`).
    """
    marker = root / _MARKER
    with suppress(OSError):  # there is no marker
        return require_regular_file(marker).read_text(encoding="utf-8") == _MARK
    for path in root.rglob("*"):
        name = path.relative_to(root).as_posix()
        is_own = _WRITTEN.fullmatch(name) or _BESIDE.fullmatch(name)
        if not is_own and not path.is_dir():
            return False
    write_text(marker, _MARK)
    return True


def clear_cache(root: Path, old_only: bool = False) -> None:
    """Delete all blocks, cached figures and CPU times in the cache folder ``root``.

    With ``old_only`` the blocks of this version of the code stay. Files that trackbench did not write
    stay, too. Raises UserError for a folder with such files and without the marker of a cache.
    """
    if not root.is_dir():
        return
    if not mark_cache(root):
        message = (
            f"has files that trackbench did not write, and no {_MARKER}; nothing was deleted; set "
            "TRACKBENCH_CACHE to a folder of its own"
        )
        raise UserError(Problem(Mark(f"{root}/"), "", message))
    now = code_digest()[:CODE_DIGITS]
    # Figures and CPU times are not kept by version.
    folders = [root / "figures", root / "times"]
    for version in _versions(root):
        if not (old_only and version.name == now):
            folders.append(version)
    for folder in folders:
        _delete_written(root, folder)


def _delete_written(root: Path, folder: Path) -> None:
    """Delete the files that trackbench wrote to a folder of the cache ``root``, and the empty folders.

    Their names show which files these are.
    """
    for home, _, names in os.walk(folder, topdown=False):
        for path in (Path(home, name) for name in names):
            if _WRITTEN.fullmatch(path.relative_to(root).as_posix()):
                path.unlink(missing_ok=True)
        with suppress(OSError):  # a folder with other files, or a link
            os.rmdir(home)


def _versions(root: Path) -> list[Path]:
    """List the folders of blocks, one for each version of the code."""
    blocks = root / "blocks"
    if not os.path.isdir(blocks):
        return []
    return sorted(folder for folder in blocks.iterdir() if folder.is_dir())
