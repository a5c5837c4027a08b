"""Cache of finished blocks on disk.

``$TRACKBENCH_CACHE`` or ``.trackbench/`` in the working directory contains
``blocks/<code>/<key>.block``. Blocks are content-addressed: two runs that write the same block write
the same bytes. ``figures/`` beside it caches drawn figures, ``times/`` measured CPU times. A marker
file shows that the folder is a cache: without it nothing is deleted.
"""

import hashlib
import json
import os
import re
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

from trackbench.atomic_files import ensure_folder, write_text
from trackbench.component_parts import Part, walk_parts
from trackbench.config.resolved_config import as_config
from trackbench.errors import Mark, Problem, UserError, WriteError
from trackbench.evaluation.block_result import BlockResult
from trackbench.evaluation.block_task import BlockTask
from trackbench.execution import code_digests
from trackbench.execution.block_file import FORMAT, BlockFile, PackedBlock, decode, write_block
from trackbench.execution.code_digests import code_digest, foreign_code
from trackbench.readable_files import require_regular_file


@lru_cache(maxsize=20_000)
def block_key(task: BlockTask, used: int) -> str:
    """Return the key of a block of which the first ``used`` runs count: its file name in the cache.

    It is a SHA-256 digest of everything that the stored numbers depend on: scenario and filters with the
    code of their plugins, the requested metrics, the runs, the package's code with the versions of
    Python, numpy and scipy, and results of the package's own arithmetic on this machine.
    """
    # Copy the cached digest of what is equal for all blocks of the filter, then add the rest.
    digest = _digest_without_runs(
        (task.scenario, task.filter, task.reference, task.reference_assume, task.assume),
        (task.keep_steps, task.predictive_metrics, task.hold_out),
    ).copy()
    runs_with_tracks = task.runs_with_tracks_among(used)
    has_covariances = task.keep_covariance and runs_with_tracks > 0
    runs = [task.seed, task.index, task.width, used, runs_with_tracks, has_covariances]
    code = [FORMAT, code_digest(), code_digests.own_arithmetic()]
    digest.update(json.dumps([runs, code]).encode())
    return digest.hexdigest()


@lru_cache(maxsize=1000)
def _digest_without_runs(components: tuple[Any, ...], requests: tuple[Any, ...]) -> Any:
    """Return the SHA-256 object that begins the keys of all blocks that differ in their runs alone.

    ``components`` are the scenario, the filter, the reference, and what these two assume; ``requests``
    name what is computed from the estimates. The object is cached: update a copy of it.
    """
    facts: list[Any] = [_facts_of(component) for component in components]
    facts.append(requests)
    return hashlib.sha256(json.dumps(facts).encode())


@lru_cache(maxsize=1000)
def _facts_of(component: Any) -> list[Any] | None:
    """Return what the numbers of a filter or scenario depend on; None if ``component`` is None.

    These are its keys with digests of its data files, digests of plugin code, and, if it computes with
    numpy's functions, the digest of numpy's arithmetic.
    """
    if component is None:
        return None
    code: list[str] = []
    contents: dict[str, str] = {}
    for inner in walk_parts(component):
        if isinstance(inner, type):
            continue
        code += foreign_code(type(inner))
        if isinstance(inner, Part):
            contents |= inner.contents

    def content_digest(path: str) -> str:
        """Return the digest of a data file, which the keys then have in place of its path."""
        # The numbers depend on the content that was read; the file may have been edited since.
        return contents.get(path) or hashlib.sha256(Path(path).read_bytes()).hexdigest()

    keys = as_config(component, content_digest)
    arithmetic = None
    if code or code_digests.uses_numpy_arithmetic(component):
        arithmetic = code_digests.numpy_arithmetic()
    return [keys, code, arithmetic]


_CODE_DIGITS = 12


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

    def get(self, task: BlockTask) -> PackedBlock | None:
        """Return the task's block, or None if it is missing or damaged."""
        key = block_key(task, task.runs_used)
        path = self._path(key)
        try:
            require_regular_file(path)
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

        These numbers are those of `run_whole_block`.
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
        version = code_digest()[:_CODE_DIGITS]
        # A text: four joined paths would take most of a lookup's time.
        return f"{self.root}/blocks/{version}/{key[:2]}/{key}.block"


def has_new_blocks() -> bool:
    """Test whether a block was stored since this process prepared its cache folders.

    Workers store blocks before they report them to this process. So the times of the files decide.
    """
    for root, begin in BlockStore.prepared.items():
        version = root / "blocks" / code_digest()[:_CODE_DIGITS]
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
    now = code_digest()[:_CODE_DIGITS]
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


def mark_cache(root: Path) -> bool:
    """Mark a folder as a cache, by a file in it, unless it has files that trackbench did not write.

    Return whether the folder is marked now. Only the files of marked folders are deleted. Raises
    WriteError.
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
    now = code_digest()[:_CODE_DIGITS]
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
