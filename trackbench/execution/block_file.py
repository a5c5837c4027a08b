"""File format of a finished block.

Magic, CRC-32 of all that follows (4 bytes), length of the header (8 bytes), JSON header, length of the
layout (8 bytes), JSON layout, raw float64 at a multiple of 8 bytes. The CRC-32 finds a damaged file, in
half the time of SHA-256. Reading constructs only numbers, so a block from a stranger cannot run code.
"""

import json
import struct
import zlib
from collections.abc import Iterator
from functools import lru_cache
from math import prod
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np

from trackbench.atomic_files import ensure_folder, write_bytes
from trackbench.core.arrays import Array
from trackbench.evaluation.block_result import BlockResult

ArrayPath: TypeAlias = tuple[str, ...]
"""Names that lead to an array in the results of a block: ``("steps", "squared_position", "total")``.

The first name is ``per_run``, ``steps``, ``kept`` for a stored series, or ``tracks``.
"""


class PackedArray(NamedTuple):
    """Place of an array among the numbers of a block, which are float64, one array after the other."""

    path: ArrayPath
    shape: tuple[int, ...]
    start: int
    """index of the array's first number"""
    end: int
    """index after its last number"""


class PackedBlock(NamedTuple):
    """A block with all its numbers in one array, as its file has them."""

    layout: tuple[PackedArray, ...]
    """arrays in the order of their numbers; those of one kind, such as sums per step, are neighbors"""
    numbers: Array
    cpu_s: float
    """CPU seconds of the filter for all runs of the block"""
    width: int
    """number of runs that the CPU time is for"""


class BlockFile(NamedTuple):
    """Path of a block, and the key that it contains."""

    path: Path
    key: str


def write_block(file: BlockFile, result: BlockResult) -> None:
    """Write a block's results to its file; raises WriteError."""
    ensure_folder(file.path.parent)
    write_bytes(file.path, encode(pack(result), file.key))


def pack(result: BlockResult) -> PackedBlock:
    """Return a block with all its numbers in one array, and the place of each array among them."""
    layout: list[PackedArray] = []
    parts: list[Array] = []
    start = 0
    for path, array in _arrays(result):
        end = start + array.size
        layout.append(PackedArray(path=path, shape=array.shape, start=start, end=end))
        parts.append(np.ravel(array))
        start = end
    return PackedBlock(
        layout=tuple(layout),
        numbers=np.concatenate(parts, dtype="<f8"),
        cpu_s=result.cpu_s,
        width=result.width,
    )


FORMAT = "TBBLOCK3"
_MAGIC = FORMAT.encode()
_CHECKSUM = struct.Struct("<I")
_LENGTH = struct.Struct("<Q")
_BEGIN = len(_MAGIC) + _CHECKSUM.size
"""Place in a file where the lengths, texts and numbers begin."""


def encode(block: PackedBlock, key: str) -> bytes:
    """Return the content of a block's file; it contains ``key``, so that a renamed file is rejected.

    The module's docstring has the format.
    """
    header = json.dumps({"key": key, "cpu_s": block.cpu_s, "width": block.width}).encode()
    layout = json.dumps([[array.path, array.shape] for array in block.layout]).encode()
    numbers = block.numbers.tobytes()
    # Spaces after the layout place the numbers at a multiple of their size: numpy reads these faster.
    before = _BEGIN + 2 * _LENGTH.size + len(header) + len(layout)
    layout += b" " * (-before % block.numbers.itemsize)
    lengths = [_LENGTH.pack(len(text)) for text in (header, layout)]
    body = b"".join([lengths[0], header, lengths[1], layout, numbers])
    return _MAGIC + _CHECKSUM.pack(zlib.crc32(body)) + body


def decode(content: bytes, key: str) -> PackedBlock | None:
    """Return the block in the bytes of a file; None if it is damaged, truncated, or of another key.

    The module's docstring has the format.
    """
    if content[: len(_MAGIC)] != _MAGIC or len(content) < _BEGIN:
        return None
    # Views on the bytes, which would otherwise be copied several times.
    body = memoryview(content)[_BEGIN:]
    (checksum,) = _CHECKSUM.unpack_from(content, len(_MAGIC))
    if zlib.crc32(body) != checksum:
        return None
    header_text, rest = _split_text(body)
    layout_text, numbers = _split_text(rest)
    header = json.loads(header_text)
    if header["key"] != key:
        return None
    return PackedBlock(
        layout=_read_layout(layout_text),
        numbers=np.frombuffer(numbers, dtype="<f8"),
        cpu_s=header["cpu_s"],
        width=header["width"],
    )


def _split_text(body: memoryview) -> tuple[bytes, memoryview]:
    """Split off the text at the beginning, whose length stands before it."""
    (length,) = _LENGTH.unpack_from(body)
    end = _LENGTH.size + length
    return bytes(body[_LENGTH.size : end]), body[end:]


@lru_cache(maxsize=64)
def _read_layout(text: bytes) -> tuple[PackedArray, ...]:
    """Return the places of a block's arrays, from the JSON list of their paths and shapes.

    The numbers of the arrays follow each other, all of them float64. The result is cached, because most
    blocks of a filter have the same arrays.
    """
    layout: list[PackedArray] = []
    start = 0  # index of a number, not of a byte
    for path, shape in json.loads(text):
        end = start + prod(shape)
        layout.append(PackedArray(path=tuple(path), shape=tuple(shape), start=start, end=end))
        start = end
    return tuple(layout)


def _arrays(result: BlockResult) -> Iterator[tuple[ArrayPath, Array]]:
    """Yield the arrays of a block with their paths, whose first names are part of the file format."""
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
