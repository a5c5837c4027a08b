"""The code that makes a block's numbers, as one digest: what a worker is asked to have, too."""

import hashlib
import platform
import sys
from functools import cache
from importlib.metadata import version
from pathlib import Path

import trackbench

_SOURCES = ("core", "models", "scenarios", "filters", "adapters", "evaluation")
_AFTER_BLOCKS = {
    "differences.py",
    "efficiency.py",
    "intervals.py",
    "merge.py",
    "shares.py",
    "statistics.py",
    "summary.py",
    "uniformity.py",
}
"""Files of evaluation/ that only see finished blocks."""


@cache
def code_digest() -> str:
    """Digest of the package's own source that makes a block's numbers, and of what it runs on."""
    home = Path(trackbench.__file__).parent
    platform_ = (platform.machine(), sys.version_info[:2], version("numpy"), version("scipy"))
    digest = hashlib.sha256(repr(platform_).encode())
    for source in _SOURCES:
        add_sources(digest, home, home / source)
    return digest.hexdigest()


def add_sources(digest: "hashlib._Hash", home: Path, source: Path) -> None:
    """Take a source file, or every one in a folder, into the digest, with its name from ``home``."""
    files = sorted(source.rglob("*.py")) if source.is_dir() else [source]
    for file in files:
        if file.parent == home / "evaluation" and file.name in _AFTER_BLOCKS:
            continue
        digest.update(f"\n{file.relative_to(home).as_posix()}\n".encode())
        digest.update(file.read_bytes())
