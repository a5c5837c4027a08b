"""Find the files of a results folder that are missing or changed, by their recorded digests."""

import hashlib
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

from trackbench.errors import reason
from trackbench.results.file_names import is_in_git


class Damage(NamedTuple):
    """Damaged files of a results folder."""

    missing: list[str]
    """names of files that are missing although git keeps them"""
    changed: list[str]
    """names of files with another digest"""
    unreadable: Mapping[str, str] = MappingProxyType({})
    """reasons why files cannot be read, by their names"""


def check_digests(folder: Path, recorded: Mapping[str, str]) -> Damage:
    """Find which of the files with ``recorded`` digests are missing or changed.

    A missing file counts only if git keeps it.
    """
    missing = []
    changed = []
    unreadable = {}
    for name, digest in recorded.items():
        if not (folder / name).is_file():
            if is_in_git(name):
                missing.append(name)
            continue
        try:
            digest_now = digest_of(folder / name)
        except OSError as error:
            unreadable[name] = reason(error)
            continue
        if digest_now != digest:
            changed.append(name)
    return Damage(missing=missing, changed=changed, unreadable=unreadable)


def digest_of(path: Path) -> str:
    """Return a file's digest; raises OSError if it cannot be read."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
