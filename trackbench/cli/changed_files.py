"""Files that have changed since they were last seen, by time, size and content."""

import hashlib
import time
from collections.abc import Iterable, Mapping
from pathlib import Path
from stat import S_ISREG
from typing import NamedTuple, TypeAlias

EVERY_S = 0.2
"""Seconds between two looks at the files.

No system call reports changes on every system, and a hundred files take a millisecond.
"""


class Stamp(NamedTuple):
    """Modification time, size and digest of a file."""

    time_ns: int
    size: int
    digest: str


Stamps: TypeAlias = Mapping[Path, Stamp | None]
"""Stamps by file; None for a missing file."""


def wait_for_changes(before: Stamps) -> list[Path]:
    """Wait until a file's content has changed and writing has ended; return the changed files.

    ``before`` are the files with their stamps, each modification time, size and digest.
    """
    last = before
    while True:
        time.sleep(EVERY_S)
        # A file that was not written since the last look keeps its stamp, and is not read again.
        now = stamps_of(before, known=last)
        changed_files = [file for file in before if _digest(now[file]) != _digest(before[file])]
        # A file that is still being written changes from one look to the next.
        is_written_whole = now == last
        if changed_files and is_written_whole:
            return changed_files
        last = now


def stamps_of(files: Iterable[Path], known: Stamps) -> Stamps:
    """Return the stamps of files; those in ``known`` that were not written since keep their stamps."""
    return {file: _stamp(file, known.get(file)) for file in files}


def _stamp(file: Path, known: Stamp | None) -> Stamp | None:
    """Return a file's modification time, size and digest; None for a missing file.

    The content is read only if the file was written since the stamp ``known``.
    """
    try:
        status = file.stat()
        if not S_ISREG(status.st_mode):
            return None
        if known is not None:
            is_as_known = (known.time_ns, known.size) == (status.st_mtime_ns, status.st_size)
            if is_as_known:
                return known
        with file.open("rb") as content:
            digest = hashlib.file_digest(content, "sha256").hexdigest()
        return Stamp(status.st_mtime_ns, status.st_size, digest)
    except (OSError, ValueError):  # a missing file, or a word that is no name of a file
        return None


def _digest(stamp: Stamp | None) -> str | None:
    """Return the digest of a file's content; None for a missing file."""
    if stamp is None:
        return None
    return stamp.digest
