"""Atomic writing of files: each is complete, or stays as it was."""

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path
from typing import IO

from trackbench.errors import WriteError

_touched: ContextVar[list[Path] | None] = ContextVar("touched", default=None)
"""Files written and removed so far, in the block of `record_writes`; None outside of it."""


def write_text(path: Path, text: str) -> None:
    """Write a file atomically."""
    write_bytes(path, text.encode())


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file atomically."""
    with atomic_write(path) as file:
        file.write(content)


@contextmanager
def atomic_write(path: Path) -> Iterator[IO[bytes]]:
    """Write a temporary file, fsync, rename: the old file stays until the new one is complete.

    Parameters
    ----------
    path
        file to write; the temporary file stands in the same folder

    Yields
    ------
    IO[bytes]
        the temporary file, open for writing

    Raises
    ------
    WriteError
        if the disk is full or the folder may not be written
    """
    # Threads of a process may write one file at the same time, as a block that all of them compute.
    writer = f"{os.getpid()}{threading.get_native_id():010d}"
    partial = path.with_name(f".{path.name}.{writer}.part")
    try:
        partial.unlink(missing_ok=True)
        with partial.open("xb") as file:  # "x" refuses a link that someone put in its place
            yield file
            file.flush()
            os.fsync(file.fileno())
        partial.replace(path)
        # The caller of `record_writes` writes digests of the recorded files to the manifest.
        note(path)
    except OSError as error:
        raise WriteError.from_os_error(path, error) from error
    finally:
        with suppress(OSError):  # the cause of the failed writing may prevent this, too
            partial.unlink(missing_ok=True)


def ensure_folder(folder: Path) -> Path:
    """Create the folder, with its parents.

    Parameters
    ----------
    folder
        folder to create; one that exists stays as it is

    Returns
    -------
    Path
        the folder

    Raises
    ------
    WriteError
        if the folder cannot be created
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise WriteError.from_os_error(folder, error) from error
    return folder


def remove(path: Path) -> None:
    """Remove a file if it exists.

    Parameters
    ----------
    path
        file to remove

    Raises
    ------
    WriteError
        if an existing file cannot be removed
    """
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise WriteError.from_os_error(path, error) from error
    note(path)


@contextmanager
def record_writes() -> Iterator[list[Path]]:
    """Record the files that are written and removed meanwhile, in this order.

    A record within another one takes the files alone: the outer record does not get them.
    """
    paths: list[Path] = []
    token = _touched.set(paths)
    try:
        yield paths
    finally:
        _touched.reset(token)


def note(path: Path) -> None:
    """Record a file as written or removed, if `record_writes` is running."""
    paths = _touched.get()
    if paths is not None:
        paths.append(path)
