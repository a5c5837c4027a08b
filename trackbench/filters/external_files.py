"""Files on which an external program's estimates depend: digests, changes, and what is not watched."""

import hashlib
import os
import shutil
from collections.abc import Sequence
from pathlib import Path

from trackbench.field_types import InvalidKeyError
from trackbench.folder_digests import digest_of_all, paths_below


def digest_of_word(word: str) -> str:
    """Return the SHA-256 of a word of the command.

    Parameters
    ----------
    word : str
        A file, a program on the PATH, ``--key=file``, or a text.

    Returns
    -------
    str
        Digest of the file, of ``--key`` and the file, or of the text, in hexadecimal digits.

    Raises
    ------
    InvalidKeyError
        If the file cannot be read.
    """
    path = Path(shutil.which(word) or word)
    value = Path(word.partition("=")[2])
    try:
        if path.is_file():
            content = path.read_bytes()
        elif "=" in word and value.is_file():
            content = word.encode() + b"\0" + value.read_bytes()
        else:
            content = word.encode()
    except OSError as error:
        raise InvalidKeyError(f"{word}: {error.strerror}") from None
    return hashlib.sha256(content).hexdigest()


def digest_below(path: str, index: int) -> str:
    """Return the SHA-256 of a file, or of all that is in a folder.

    ``index`` is its place in the key `files`, which an InvalidKeyError names if it cannot be read.
    """
    try:
        return digest_of_all(path)
    except OSError as error:
        raise InvalidKeyError(f"{path}: {error.strerror}", "files", index) from None


def digest_of_variable(name: str) -> str:
    """Digest the value of an environment variable, which may be secret."""
    value = os.environ.get(name)
    return "unset" if value is None else hashlib.sha256(value.encode()).hexdigest()


def stamps(command: Sequence[str], files: Sequence[str]) -> list[tuple[int, ...]]:
    """Return inodes, sizes and times of the files of a program, which show a change while it runs.

    Parameters
    ----------
    command : sequence of str
        The program and its arguments. Words that are no files are left out.
    files : sequence of str
        Further files and folders of the program.

    Returns
    -------
    list of tuple of int
        Inode, size in bytes, and time of the last change in ns, of each file.
    """
    paths = [Path(shutil.which(word) or word) for word in command]
    paths += [Path(word.partition("=")[2]) for word in command if "=" in word]
    for file in files:
        paths += paths_below(file)
    stats = [path.stat() for path in paths if path.is_file()]
    return [(stat.st_ino, stat.st_size, stat.st_mtime_ns) for stat in stats]


def unwatched_cautions(command: Sequence[str], files: Sequence[str]) -> list[str]:
    """Return a note if the program may have files whose changes are not noticed.

    Changes of files among the words of the command are noticed in any case, changes in folders only if
    ``files`` lists them.

    Parameters
    ----------
    command : sequence of str
        The program and its arguments.
    files : sequence of str
        Files and folders that the key of this name lists.

    Returns
    -------
    list of str
        One note, or none.
    """
    watched = {os.path.realpath(file) for file in files}
    unwatched = []
    for word in command[1:]:
        path = word.partition("=")[2] if "=" in word else word
        if os.path.isdir(path) and os.path.realpath(path) not in watched:
            unwatched.append(f"the folder {path}")
    if not files and not unwatched and not _names_file(command):
        unwatched.append(f"what {' '.join(command)[:60]!r} runs")
    if not unwatched:
        return []
    return [
        f"changes of {' and '.join(unwatched)} are not noticed, and blocks from before them "
        "would be used: name files or folders of the program under `files`, or add --fresh"
    ]


def _names_file(command: Sequence[str]) -> bool:
    """Test whether the command has a file of the program: not only an interpreter from the PATH."""
    first = command[0]
    if len(command) == 1 or os.path.dirname(first):
        return True
    words = command[1:]
    return any(os.path.isfile(word) or os.path.isfile(word.partition("=")[2]) for word in words)
