"""File format of a finished block.

Magic, SHA-256 of all that follows, length of the header (8 bytes), JSON header, raw float64. Reading
constructs only numbers, so a block from a stranger cannot run code.
"""

import hashlib
import json
import struct
from collections.abc import Iterator
from math import prod
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from trackbench.atomic_files import ensure_folder, write_bytes
from trackbench.core.arrays import Array
from trackbench.evaluation.block import BlockResult, Tracks
from trackbench.evaluation.error_series import StepSums


class BlockFile(NamedTuple):
    """Path of a block, and the key that it contains."""

    path: Path
    key: str


def write_block(file: BlockFile, result: BlockResult) -> None:
    """Write a block; raises WriteError."""
    ensure_folder(file.path.parent)
    write_bytes(file.path, encode(result, file.key))


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
    """Return the block in the bytes of a file; None if it is damaged, truncated, or of another key."""
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
    """Yield the arrays of a block, each with the names that lead to it in the result.

    In files the first name of a stored series is ``kept``.
    """
    for name, values in result.per_run.items():
        yield ("per_run", name), values
    for name, sums in result.steps.items():
        for field, array in sums._asdict().items():
            yield ("steps", name, field), array
    for name, values in result.run_series.items():
        yield ("kept", name), values
    if result.tracks is not None:
        for name, tracks in result.tracks._asdict().items():
            if tracks is not None:
                yield ("tracks", name), tracks


def _result(header: dict[str, Any], raw: bytes) -> BlockResult:
    """Build the block from the numbers in ``raw``; the header names their arrays and has the shapes."""
    per_run: dict[str, Array] = {}
    run_series: dict[str, Array] = {}
    tracks: dict[str, Array] = {}
    sums: dict[str, dict[str, Array]] = {}
    start = 0
    numbers = np.frombuffer(raw, dtype="<f8")
    for path, shape in header["arrays"]:
        end = start + prod(shape)
        array = numbers[start:end].reshape(shape)
        start = end
        if path[0] == "steps":
            _, name, field = path
            sums.setdefault(name, {})[field] = array
        else:
            group, name = path
            arrays = {"per_run": per_run, "kept": run_series, "tracks": tracks}[group]
            arrays[name] = array
    return BlockResult(
        per_run=per_run,
        steps={name: StepSums(**fields) for name, fields in sums.items()},
        run_series=run_series,
        tracks=Tracks(**{"cov": None, **tracks}) if tracks else None,  # type: ignore[arg-type]
        cpu_s=header["cpu_s"],
        width=header["width"],
    )
