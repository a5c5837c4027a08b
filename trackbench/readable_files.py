"""Files that can be read: texts of at most 1 MB in UTF-8, and digests of files and folders.

Devices and pipes cannot be read to their end.
"""

import errno
import hashlib
import os
import re
import stat
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path


def require_regular_file(path: str | Path) -> Path:
    """Return the path of a file that can be read to its end.

    Raises OSError for a missing file, a folder, and a device or a pipe, which may have no end.
    """
    refuse_endless(path)
    return Path(path)


def refuse_endless(path: str | Path) -> None:
    """Raise OSError if a path is no file that can be read to its end (`require_regular_file`)."""
    mode = os.stat(path).st_mode
    if stat.S_ISDIR(mode):
        raise OSError(errno.EISDIR, "is a folder")
    if not stat.S_ISREG(mode):
        raise OSError(errno.EINVAL, "is a device or a pipe, not a file")


def digest_of(path: str | Path) -> str:
    """Digest the content of a file by SHA-256; raises OSError."""
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


def digest_of_all(path: str | Path) -> str:
    """Digest the content of a file, or all that is in a folder (`paths_below`); raises OSError.

    Of a folder count the names of the files and folders in it, and the contents of the files. A file
    that may be executed counts as another one.
    """
    if not os.path.isdir(path):
        return digest_of(require_regular_file(path))
    entries: list[tuple[str, ...]] = []
    for inner in paths_below(path):
        name = inner.relative_to(path).as_posix()
        if inner.is_dir():
            entries.append((name, "folder"))
            continue
        is_executable = bool(inner.stat().st_mode & 0o111)
        entries.append((name, "program" if is_executable else "file", digest_of(inner)))
    return hashlib.sha256(repr(entries).encode()).hexdigest()


def paths_below(path: str | Path) -> list[Path]:
    """List a file, or the files and folders in a folder and in the folders that its links lead to.

    They are in the order of their names. Raises OSError if the path is missing, a device or a pipe, and
    for a link to a folder around it, which has no end.
    """
    if not os.path.isdir(path):
        return [require_regular_file(path)]
    return sorted(_paths_in(Path(path), (os.path.realpath(path),)))


def _paths_in(folder: Path, around: tuple[str, ...]) -> Iterator[Path]:
    """Yield the files and folders in a folder and in the folders within it.

    ``around`` are the real paths of the folders on the way to it, and last its own. Raises OSError for a
    link to one of these or to a folder around them, which would have no end.
    """
    for inner in folder.iterdir():
        if inner.is_file():
            yield inner
        if not inner.is_dir():
            continue
        real = os.path.realpath(inner)
        for outer in around:
            is_around = os.path.commonpath((real, outer)) == real
            if is_around:
                raise OSError(
                    errno.ELOOP,
                    f"has {inner}, a link to {real}, a folder around it; under `files` name the "
                    "files and folders that are read",
                )
        yield inner
        yield from _paths_in(inner, (*around, real))


_LARGEST_FILE = 1_000_000  # bytes


def text_of(path: Path) -> str:
    """Read a text file of at most 1 MB; raises OSError."""
    size = require_regular_file(path).stat().st_size
    if size > _LARGEST_FILE:
        raise OSError(errno.EFBIG, f"has {size} bytes, and may have 1 MB at most")
    return _decoded(path.read_bytes())


@cache
def text_of_stdin() -> str:
    """Read stdin as text. The text is kept, since stdin can be read only once; raises OSError."""
    content = sys.stdin.buffer.read(_LARGEST_FILE + 1)
    if len(content) > _LARGEST_FILE:
        raise OSError(errno.EFBIG, "has more than 1 MB")
    return _decoded(content)


def _decoded(content: bytes) -> str:
    """Return the text of a file with this content, with line ends of one character.

    Raises OSError if it is not UTF-8.
    """
    try:
        text = content.decode("utf-8-sig")  # a byte order mark is left out
    except UnicodeDecodeError:
        raise OSError(errno.EILSEQ, "is not a text file in UTF-8") from None
    return re.sub("\r\n?", "\n", text)
