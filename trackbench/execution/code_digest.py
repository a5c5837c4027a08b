"""Digest of the code that makes a block's numbers; a worker must have the same."""

import hashlib
import platform
import sys
from collections.abc import Iterable, Iterator
from functools import cache
from importlib.metadata import version
from pathlib import Path

import trackbench

_SOURCES = (
    *("core", "models", "scenarios", "filters", "adapters", "evaluation"),
    *("extension_points.py", "field_types.py", "metrics.py", "registry.py", "execution/worker.py"),
)
_AFTER_BLOCKS = "computes with finished blocks; a worker never imports it"
_ERRORS = "decides how a failure is reported; a failed block is not stored"
_KEYS = "its result is part of the key"
NO_PART_OF_BLOCKS = {
    "__init__.py": "names the version and the functions of the API",
    "evaluation/intervals.py": _AFTER_BLOCKS,
    "evaluation/efficiency.py": _AFTER_BLOCKS,
    "evaluation/metric_expression.py": _AFTER_BLOCKS,
    "evaluation/merge.py": _AFTER_BLOCKS,
    "evaluation/stopping_rule.py": _AFTER_BLOCKS,
    "evaluation/run_contributions.py": _AFTER_BLOCKS,
    "evaluation/statistics.py": _AFTER_BLOCKS,
    "evaluation/summary.py": _AFTER_BLOCKS,
    "evaluation/uniformity_tests.py": _AFTER_BLOCKS,
    "plugins/errors.py": _ERRORS,
    "errors.py": _ERRORS,
    "execution/machine_fingerprint.py": _KEYS,
    "execution/code_digest.py": _KEYS,
    "plugins/load.py": "runs a plugin's source, whose digest is part of the key",
}
"""Files that the digest leaves out although a worker imports them or their folder is digested."""


@cache
def code_digest() -> str:
    """Return the digest of the source files that make a block's numbers, Python and library
    versions.
    """
    home = Path(trackbench.__file__).parent
    platform_ = (platform.machine(), sys.version_info[:2], version("numpy"), version("scipy"))
    digest = hashlib.sha256(repr(platform_).encode())
    add_sources(digest, home, block_sources(home))
    return digest.hexdigest()


def block_sources(home: Path) -> Iterator[Path]:
    """Yield the source files of the package at ``home`` that can change a block's numbers."""
    for source in _SOURCES:
        for file in python_files(home / source):
            if file.relative_to(home).as_posix() not in NO_PART_OF_BLOCKS:
                yield file


def python_files(source: Path) -> list[Path]:
    """Return a source file, or all in a folder in the order of their names."""
    return sorted(source.rglob("*.py")) if source.is_dir() else [source]


def add_sources(digest: "hashlib._Hash", home: Path, files: Iterable[Path]) -> None:
    """Add source files to the digest, each with its name from ``home``."""
    for file in files:
        digest.update(f"\n{file.relative_to(home).as_posix()}\n".encode())
        digest.update(file.read_bytes())
