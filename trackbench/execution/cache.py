"""Finished blocks on disk: what is there need not be computed again.

``$TRACKBENCH_CACHE`` or ``.trackbench/`` in the working directory holds
``blocks/<code>/<key>.block``: content-addressed, so two runs that write the same block write the same
bytes, and checksummed, so a damaged one is computed again and never used. ``figures/`` beside it holds
figures that were drawn, ``times/`` CPU times that were measured.
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
    """Where blocks are kept."""
    return Path(os.environ.get("TRACKBENCH_CACHE") or ".trackbench")


def figure_folder() -> Path:
    """Where figures are kept that were drawn; they go whenever blocks are cleared."""
    return cache_folder() / "figures"


def times_folder() -> Path:
    """Where measured CPU times are kept; they go whenever blocks are cleared."""
    return cache_folder() / "times"


@dataclass(frozen=True)
class BlockStore:
    """Blocks of this version of the code under one folder."""

    root: Path

    def get(self, task: BlockTask) -> BlockResult | None:
        """The task's block if it is there and whole."""
        key = block_key(task, task.used)
        try:
            content = self._file(key).read_bytes()
        except OSError:
            return None
        return decode(content, key)

    def has_file(self, task: BlockTask) -> bool:
        """Whether there is a file for the task, good or damaged."""
        return self._file(block_key(task, task.used)).is_file()

    def put(self, task: BlockTask, results: dict[int, BlockResult]) -> None:
        """Keep a block, by the number of its runs that are used; raises WriteError."""
        for used, result in results.items():
            key = block_key(task, used)
            file = self._file(key)
            ensure_folder(file.parent)
            write_bytes(file, encode(result, key))

    def prepare(self) -> None:
        """Make the folder, out of version control's sight; raises WriteError."""
        ensure_folder(self.root)
        if not (self.root / ".gitignore").exists():
            write_text(self.root / ".gitignore", "*\n")

    def _file(self, key: str) -> Path:
        return self.root / "blocks" / code_digest()[:_CODE_DIGITS] / key[:2] / f"{key}.block"


class Held(NamedTuple):
    """Number of files and their bytes."""

    number: int
    bytes: int

    @classmethod
    def of(cls, folders: Iterable[Path]) -> "Held":
        """What some folders hold."""
        files = [path for folder in folders for path in folder.rglob("*.*") if path.is_file()]
        return cls(len(files), sum(path.stat().st_size for path in files))


class CacheSize(NamedTuple):
    """What a cache folder holds: blocks of this version of the code and of others, and figures."""

    blocks: Held
    old_blocks: Held
    figures: Held


def cache_size(root: Path) -> CacheSize:
    """What a cache folder holds."""
    now = code_digest()[:_CODE_DIGITS]
    mine, others = ([f for f in _versions(root) if (f.name == now) is own] for own in (True, False))
    return CacheSize(Held.of(mine), Held.of(others), Held.of([root / "figures"]))


def clear_cache(root: Path, old_only: bool = False) -> None:
    """Remove every block, or only those that other versions of the code made."""
    for name in ("figures", "times"):
        shutil.rmtree(root / name, ignore_errors=True)
    for folder in _versions(root):
        if not (old_only and folder.name == code_digest()[:_CODE_DIGITS]):
            shutil.rmtree(folder, ignore_errors=True)


def _versions(root: Path) -> list[Path]:
    blocks = root / "blocks"
    return sorted(f for f in blocks.iterdir() if f.is_dir()) if os.path.isdir(blocks) else []
