"""Cache of finished blocks on disk, and their file format.

``$TRACKBENCH_CACHE`` or ``.trackbench/`` in the working directory contains
``blocks/<code>/<key>.block``. Blocks are content-addressed: two runs that write the same block write
the same bytes. ``figures/`` beside it caches drawn figures, ``times/`` measured CPU times.

A block's file: magic, SHA-256 of all that follows, length of the header (8 bytes), JSON header, raw
float64. Reading constructs only numbers, so a block from a stranger cannot run code.
"""

import hashlib
import inspect
import json
import os
import shutil
import struct
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from trackbench.atomic_files import ensure_folder, write_bytes, write_text
from trackbench.config.dump import as_config
from trackbench.core.arrays import Array
from trackbench.evaluation.block import BlockResult, BlockTask, Tracks
from trackbench.evaluation.error_series import StepSums
from trackbench.execution import fingerprints
from trackbench.execution.fingerprints import add_sources, code_digest, python_files
from trackbench.extension_points import Part, walk_parts


def block_key(task: BlockTask, used: int) -> str:
    """Return the key of a block reduced to its first ``used`` runs."""
    shown = task.runs_with_tracks_among(used)
    facts = [
        _part(task.scenario),
        _part(task.filter),
        _part(task.reference) if task.reference is not None else None,
        _part(task.assume) if task.assume is not None else None,
        [task.seed, task.index, task.width, used],
        [shown, task.keep_covariance and shown > 0, task.keep_steps],
        [task.predictive_metrics, task.hold_out],
        [code_digest(), fingerprints.own_arithmetic()],
    ]
    return hashlib.sha256(json.dumps(facts).encode()).hexdigest()


@lru_cache(maxsize=1000)
def _part(part: Any) -> list[Any]:
    """Return the keys of a filter or scenario, digests of its data files and plugin code."""
    parts = [inner for inner in walk_parts(part) if not isinstance(inner, type)]
    code = [digest for inner in parts for digest in _foreign_code(type(inner))]
    read: dict[str, str] = {}
    for inner in parts:
        read |= inner.contents if isinstance(inner, Part) else {}
    # What was read makes the numbers: the file itself may have been edited since.
    keys = as_config(part, lambda path: read.get(path) or _content_digest(path))
    uses_numpy = bool(code) or fingerprints.uses_numpy_arithmetic(part)
    return [keys, code, fingerprints.numpy_arithmetic() if uses_numpy else None]


def _content_digest(path: str) -> str:
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


def _foreign_code(cls: type[Any]) -> Iterator[str]:
    """Yield digests of the code of classes from outside this package."""
    for base in cls.__mro__:
        name = base.__module__
        if name.partition(".")[0] in ("trackbench", "builtins", "typing"):
            continue
        module = sys.modules[name]
        plugin = getattr(module, "__plugin_digest__", None)
        yield plugin or _package_digest(name.partition(".")[0])


@cache
def _package_digest(name: str) -> str:
    """Return the digest of an installed package's source, or of a module's."""
    try:
        file = Path(inspect.getsourcefile(sys.modules[name]) or "")
    except TypeError:  # typed into an interpreter: equal to nothing that was ever kept
        return os.urandom(16).hex()
    digest = hashlib.sha256()
    sources = python_files(file.parent if file.name == "__init__.py" else file)
    add_sources(digest, file.parent, sources)
    return digest.hexdigest()


_ArrayPath: TypeAlias = tuple[str, ...]

_MAGIC = b"TBBLOCK1"
_HASH = hashlib.sha256().digest_size
_LENGTH = struct.Struct("<Q")


def encode(result: BlockResult, key: str) -> bytes:
    """Return the file of a block; it contains ``key``, so that a renamed file is rejected."""
    arrays = dict(_arrays(result))
    header = {
        "key": key,
        "cpu_s": result.cpu_s,
        "width": result.width,
        "arrays": [[path, array.shape] for path, array in arrays.items()],
    }
    text = json.dumps(header).encode()
    raw = [np.ascontiguousarray(array, dtype="<f8").tobytes() for array in arrays.values()]
    body = b"".join([_LENGTH.pack(len(text)), text, *raw])
    return _MAGIC + hashlib.sha256(body).digest() + body


def decode(content: bytes, key: str) -> BlockResult | None:
    """Return the block; None if it is damaged, truncated, or of another format or key."""
    start = len(_MAGIC) + _HASH
    body = content[start:]
    if content[: len(_MAGIC)] != _MAGIC:
        return None
    if hashlib.sha256(body).digest() != content[len(_MAGIC) : start]:
        return None
    (length,) = _LENGTH.unpack_from(body)
    header = json.loads(body[_LENGTH.size : _LENGTH.size + length])
    if header["key"] != key:
        return None
    return _result(header, body[_LENGTH.size + length :])


def _arrays(result: BlockResult) -> Iterator[tuple[_ArrayPath, Array]]:
    for name, values in result.per_run.items():
        yield ("per_run", name), values
    for name, sums in result.steps.items():
        for part, array in sums._asdict().items():
            yield ("steps", name, part), array
    for name, values in result.run_series.items():
        yield ("kept", name), values
    if result.tracks is not None:
        for name, tracks in result.tracks._asdict().items():
            if tracks is not None:
                yield ("tracks", name), tracks


def _result(header: dict[str, Any], raw: bytes) -> BlockResult:
    per_run: dict[str, Array] = {}
    kept: dict[str, Array] = {}
    tracks: dict[str, Array] = {}
    sums: dict[str, dict[str, Array]] = {}
    at = 0
    for path, shape in header["arrays"]:
        number = int(np.prod(shape))
        array = np.frombuffer(raw, dtype="<f8", count=number, offset=at).reshape(shape)
        at += 8 * number
        if path[0] == "steps":
            sums.setdefault(path[1], {})[path[2]] = array
        else:
            {"per_run": per_run, "kept": kept, "tracks": tracks}[path[0]][path[1]] = array
    return BlockResult(
        per_run=per_run,
        steps={name: StepSums(**parts) for name, parts in sums.items()},
        run_series=kept,
        tracks=Tracks(**{"cov": None, **tracks}) if tracks else None,  # type: ignore[arg-type]
        cpu_s=header["cpu_s"],
        width=header["width"],
    )


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
    """Size of a cache folder: blocks of this code version, of other versions, and figures."""

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
