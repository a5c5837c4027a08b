"""Files that can be read to their end: texts of at most 1 MB in UTF-8, and digests of files.

Devices and pipes cannot be read to their end.
"""

import errno
import hashlib
import os
import re
import stat
import sys
from functools import cache
from pathlib import Path


def require_regular_file(path: str | Path) -> Path:
    """Return the path of a file that can be read to its end.

    Raises OSError for a missing file, a folder, and a device or a pipe, which may have no end.
    """
    refuse_endless(path)
    return Path(path)


def refuse_endless(path: str | Path) -> None:
    """Raise OSError if a path is no file that can be read to its end (`require_regular_file`).

    Parameters
    ----------
    path
        path to check

    Raises
    ------
    OSError
        for a missing file, a folder, and a device or a pipe
    """
    mode = os.stat(path).st_mode
    if stat.S_ISDIR(mode):
        raise OSError(errno.EISDIR, "is a folder")
    if not stat.S_ISREG(mode):
        raise OSError(errno.EINVAL, "is a device or a pipe, not a file")


def digest_of(path: str | Path) -> str:
    """Digest the content of a file by SHA-256; raises OSError."""
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


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
