"""Cache of finished blocks on disk, and the blocks found there that wait in memory for the merge.

``$TRACKBENCH_CACHE`` or ``.trackbench/`` in the working directory contains
``blocks/<code>/<key>.block``. Blocks are content-addressed: two runs that write the same block write
the same bytes. ``figures/`` beside it caches drawn figures, ``times/`` measured CPU times. A marker
file shows that the folder is a cache: without it nothing is deleted.
"""

import os
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from trackbench.atomic_files import ensure_folder, write_text
from trackbench.errors import WriteError
from trackbench.evaluation.block_result import BlockResult
from trackbench.evaluation.block_task import BlockTask
from trackbench.execution.block_file import BlockFile, PackedBlock, decode, write_block
from trackbench.execution.block_key import block_key
from trackbench.execution.clear_cache import CODE_DIGITS, mark_cache
from trackbench.execution.code_digests import code_digest
from trackbench.readable_files import refuse_endless

_KEPT_BYTES = 256_000_000
"""Size of the stored blocks that stay in memory from when they are found until they are merged."""


def cache_folder() -> Path:
    """Return the folder of the cache."""
    return Path(os.environ.get("TRACKBENCH_CACHE") or ".trackbench")


def figure_cache_folder() -> Path:
    """Return the folder of cached figures, which is deleted when blocks are cleared."""
    return cache_folder() / "figures"


def times_folder() -> Path:
    """Return the folder of measured CPU times, which is deleted when blocks are cleared."""
    return cache_folder() / "times"


@dataclass(frozen=True)
class BlockStore:
    """Store of the blocks that this version of the code computed, under one folder."""

    prepared: ClassVar[dict[Path, float]] = {}
    """folders that this process prepared for blocks, and when it did so, s since 1970"""
    root: Path

    def is_to_be_written(self, tasks: Iterable[BlockTask], fresh: bool) -> bool:
        """Test whether blocks of these tasks would be stored: with ``fresh``, or if one is missing."""
        # Unlike `has_file`, `get` reads the block, so that a damaged one is missing.
        return fresh or any(self.get(task) is None for task in tasks)

    def get(self, task: BlockTask) -> PackedBlock | None:
        """Return the task's block, or None if it is missing or damaged."""
        key = block_key(task, task.runs_used)
        path = self._path(key)
        try:
            refuse_endless(path)
            with open(path, "rb", buffering=0) as file:
                content = file.read()
        except OSError:
            return None
        return decode(content, key)

    def has_file(self, task: BlockTask) -> bool:
        """Test whether a file exists for the task, good or damaged."""
        return os.path.isfile(self._path(block_key(task, task.runs_used)))

    def put(self, task: BlockTask, results: dict[int, BlockResult]) -> None:
        """Store the task's results, each by the number of runs used, in a file of its own.

        Raises WriteError.
        """
        for used, result in results.items():
            write_block(self.files(task)[used], result)

    def files(self, task: BlockTask) -> dict[int, BlockFile]:
        """Return the files of a task's results, by the number of runs that each is computed from.

        A block is always filtered as a whole. Metrics are computed of the runs that this plan uses, of
        all runs, for longer plans, and of the numbers of runs after which the experiment may stop.
        """
        counts = {task.runs_used, task.width, *task.extra_run_counts}
        keys = {used: block_key(task, used) for used in counts}
        return {
            used: BlockFile(Path(self._path(key)).absolute(), key) for used, key in keys.items()
        }

    def prepare(self) -> None:
        """Create the folder with a .gitignore and its marker; raises WriteError if that fails."""
        ensure_folder(self.root)
        # `has_new_blocks` counts from the first time on.
        BlockStore.prepared.setdefault(self.root, time.time())
        with suppress(WriteError):  # stored blocks can be used in a read-only folder, too
            mark_cache(self.root)
            if not (self.root / ".gitignore").exists():
                write_text(self.root / ".gitignore", "*\n")

    def _path(self, key: str) -> str:
        version = code_digest()[:CODE_DIGITS]
        # A text: four joined paths would take most of a lookup's time.
        return f"{self.root}/blocks/{version}/{key[:2]}/{key}.block"


def has_new_blocks() -> bool:
    """Test whether a block was stored since this process prepared its cache folders.

    Workers store blocks before they report them to this process. So the times of the files decide.
    """
    for root, begin in BlockStore.prepared.items():
        version = root / "blocks" / code_digest()[:CODE_DIGITS]
        for path in version.rglob("*.block"):
            # The clock of the file system may be a little behind that of Python.
            if path.stat().st_mtime > begin - 0.05:
                return True
    return False


@contextmanager
def announced(root: Path) -> Iterator[Path]:
    """Place a temporary file in the cache folder ``root``, yield its path, and remove it in the end.

    A worker that finds the file shares the folder with this process, and may store blocks there.
    """
    token = root.absolute() / f"shared-{os.urandom(8).hex()}"
    write_text(token, "")
    try:
        yield token
    finally:
        token.unlink(missing_ok=True)


class FoundBlocks:
    """Stored blocks that were found and wait for the merge, so that their files are read once.

    Blocks beyond `_KEPT_BYTES` are not kept: the merge reads their files again. Tasks are looked up by
    identity, because the hash of a task takes half as long as reading its block. The task is kept with
    its block, so that no other object gets its identity.
    """

    def __init__(self) -> None:
        self._blocks: dict[int, tuple[BlockTask, PackedBlock]] = {}
        self._bytes = 0

    def keep(self, task: BlockTask, block: PackedBlock) -> None:
        """Keep a block if there is room for it; the key is the identity of its task."""
        if self._bytes + block.numbers.nbytes <= _KEPT_BYTES:
            self._blocks[id(task)] = task, block
            self._bytes += block.numbers.nbytes

    def take(self, task: BlockTask) -> PackedBlock | None:
        """Return a block and forget it; None if it was not kept.

        Only the very object ``task`` that the block was kept for finds it: the key is its identity.
        """
        if id(task) not in self._blocks:
            return None
        _, block = self._blocks.pop(id(task))
        self._bytes -= block.numbers.nbytes
        return block
