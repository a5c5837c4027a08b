"""Cache of finished blocks on disk.

``$TRACKBENCH_CACHE`` or ``.trackbench/`` in the working directory contains
``blocks/<code>/<key>.block``. Blocks are content-addressed: two runs that write the same block write
the same bytes. They have a checksum: a damaged block is computed again. ``figures/`` beside it
caches
drawn figures, ``times/`` measured CPU times.
"""

import os
import shutil
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from trackbench.atomic_files import ensure_folder, write_bytes, write_text
from trackbench.evaluation.block import BlockResult, BlockTask
from trackbench.execution.block_key import block_key
from trackbench.execution.code_digest import code_digest
from trackbench.execution.codec import decode, encode

_CODE_DIGITS = 12


def cache_folder() -> Path:
    """Return the folder of the cache."""
    return Path(os.environ.get("TRACKBENCH_CACHE") or ".trackbench")


def figure_folder() -> Path:
    """Return the folder of cached figures, which is deleted when blocks are cleared."""
    return cache_folder() / "figures"


def times_folder() -> Path:
    """Return the folder of measured CPU times, which is deleted when blocks are cleared."""
    return cache_folder() / "times"


@dataclass(frozen=True)
class BlockStore:
    """Store of the blocks that this version of the code computed, under one folder."""

    root: Path

    def get(self, task: BlockTask) -> BlockResult | None:
        """Return the task's block, or None if it is missing or damaged."""
        key = block_key(task, task.runs_used)
        try:
            content = self._file(key).read_bytes()
        except OSError:
            return None
        return decode(content, key)

    def has_file(self, task: BlockTask) -> bool:
        """Return whether a file exists for the task, good or damaged."""
        return self._file(block_key(task, task.runs_used)).is_file()

    def put(self, task: BlockTask, results: dict[int, BlockResult]) -> None:
        """Store a block for each number of its runs that is used; raises WriteError."""
        for used, result in results.items():
            key = block_key(task, used)
            file = self._file(key)
            ensure_folder(file.parent)
            write_bytes(file, encode(result, key))

    def prepare(self) -> None:
        """Create the folder with a .gitignore; raises WriteError."""
        ensure_folder(self.root)
        if not (self.root / ".gitignore").exists():
            write_text(self.root / ".gitignore", "*\n")

    def _file(self, key: str) -> Path:
        return self.root / "blocks" / code_digest()[:_CODE_DIGITS] / key[:2] / f"{key}.block"


class FolderSize(NamedTuple):
    """Number of files and their bytes."""

    number: int
    bytes: int

    @classmethod
    def of(cls, folders: Iterable[Path]) -> "FolderSize":
        """Count the files of some folders."""
        files = [path for folder in folders for path in folder.rglob("*.*") if path.is_file()]
        return cls(len(files), sum(path.stat().st_size for path in files))


class CacheSize(NamedTuple):
    """Size of a cache folder: blocks of this version of the code, of other versions, and
    figures.
    """

    blocks: FolderSize
    old_blocks: FolderSize
    figures: FolderSize


def cache_size(root: Path) -> CacheSize:
    """Return the size of a cache folder."""
    now = code_digest()[:_CODE_DIGITS]
    mine, others = ([f for f in _versions(root) if (f.name == now) is own] for own in (True, False))
    return CacheSize(FolderSize.of(mine), FolderSize.of(others), FolderSize.of([root / "figures"]))


def clear_cache(root: Path, old_only: bool = False) -> None:
    """Delete all blocks, or with ``old_only`` those of other versions of the code."""
    for name in ("figures", "times"):
        shutil.rmtree(root / name, ignore_errors=True)
    for folder in _versions(root):
        if not (old_only and folder.name == code_digest()[:_CODE_DIGITS]):
            shutil.rmtree(folder, ignore_errors=True)


def _versions(root: Path) -> list[Path]:
    blocks = root / "blocks"
    return sorted(f for f in blocks.iterdir() if f.is_dir()) if os.path.isdir(blocks) else []
