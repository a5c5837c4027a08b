"""Digests of whole folders, and the files and folders in them, also behind links."""

import errno
import hashlib
import os
from collections.abc import Iterator
from pathlib import Path

from trackbench.readable_files import digest_of, require_regular_file


def digest_of_all(path: str | Path) -> str:
    """Digest the content of a file, or all that is in a folder (`paths_below`).

    The digest of a folder covers the names of the files and folders in it, and the contents of the
    files. A file that may be executed counts as another one.

    Parameters
    ----------
    path
        file or folder

    Returns
    -------
    str
        SHA-256 in hexadecimal digits

    Raises
    ------
    OSError
        if the path is missing, a device or a pipe, and for a link to a folder around it
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
