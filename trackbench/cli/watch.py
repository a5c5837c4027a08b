"""Watch mode: run again whenever a config, or a file that it names, is saved."""

import hashlib
import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from stat import S_ISREG
from typing import NamedTuple, TypeAlias

import typer

_EVERY_S = 0.2
"""How often is looked: no system call tells on every system, and a hundred files take a millisecond."""


class Stamp(NamedTuple):
    """Modification time and digest of a file; None for a missing file."""

    time_ns: int
    size: int
    digest: str


Stamps: TypeAlias = Mapping[Path, Stamp | None]


def watch(config: Path, go: Callable[[], None]) -> None:
    """Call ``go`` now and after each change, until an exception such as Ctrl-C."""
    from trackbench.errors import counted

    files = {config}
    while True:
        files |= _named(config, files)
        before = _stamps(files, {})
        go()
        there = sum(stamp is not None for stamp in before.values())
        typer.echo(f"watching {counted(there, 'file')}, until Ctrl-C: {config}", err=True)
        for file in changed(before):
            typer.echo(f"{time.strftime('%H:%M:%S')} {file} was saved", err=True)


def changed(before: Stamps) -> list[Path]:
    """Wait until a file's content has changed and writing has ended; return the changed files."""
    last = before
    while True:
        time.sleep(_EVERY_S)
        now = _stamps(before, last)
        others = [file for file in before if _content(now[file]) != _content(before[file])]
        if others and now == last:
            return others
        last = now


def _named(config: Path, known: Iterable[Path]) -> set[Path]:
    """Return the files that a config names; the known ones if it cannot be read."""
    from trackbench.config.shipped_experiments import with_parts
    from trackbench.errors import UserError

    try:
        return set(with_parts(config))
    except UserError:
        return set(known)


def _stamps(files: Iterable[Path], known: Stamps) -> Stamps:
    return {file: _stamp(file, known.get(file)) for file in files}


def _stamp(file: Path, known: Stamp | None) -> Stamp | None:
    """Return the stamp of a file; its content is read only if it was written since ``known``."""
    try:
        found = file.stat()
        if not S_ISREG(found.st_mode):
            return None
        if known is not None and known[:2] == (found.st_mtime_ns, found.st_size):
            return known
        with file.open("rb") as content:
            digest = hashlib.file_digest(content, "sha256").hexdigest()
        return Stamp(found.st_mtime_ns, found.st_size, digest)
    except (OSError, ValueError):  # not there, or a word that is no name of a file
        return None


def _content(stamp: Stamp | None) -> str | None:
    return stamp.digest if stamp else None
