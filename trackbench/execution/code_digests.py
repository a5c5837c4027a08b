"""Digests of the source code that a block's numbers depend on; a worker must have the same code.

Those of the machine's arithmetic are in `arithmetic_digests`.
"""

import hashlib
import inspect
import os
import platform
import sys
from collections.abc import Iterable, Iterator
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import trackbench

_SOURCES = (
    "core",
    "models",
    "scenarios",
    "filters",
    "adapters",
    "evaluation",
    "component_parts.py",
    "durations.py",
    "entry_points.py",
    "plugin_class_hooks.py",
    "field_types.py",
    "metrics.py",
    "readable_files.py",
    "folder_digests.py",
    "registry.py",
    "units_of_components.py",
    "execution/compute_batch.py",
)
_AFTER_BLOCKS = "computes with finished blocks; a worker never imports it"
_ERRORS = "decides how a failure is reported; a failed block is not stored"
_KEYS = "its result is part of the key"
NO_PART_OF_BLOCKS = {
    "__init__.py": "names the version and the functions of the API",
    "evaluation/bound_rows.py": _AFTER_BLOCKS,
    "evaluation/exact_errors.py": _AFTER_BLOCKS,
    "evaluation/result_over_all_runs.py": _AFTER_BLOCKS,
    "evaluation/metric_expression.py": _AFTER_BLOCKS,
    "evaluation/per_step_columns.py": _AFTER_BLOCKS,
    "evaluation/run_contributions.py": _AFTER_BLOCKS,
    "evaluation/summary_rows.py": _AFTER_BLOCKS,
    "evaluation/uniformity_tests.py": _AFTER_BLOCKS,
    "core/build_compiled.py": "builds what `core/compiled.py` loads; a worker never imports it",
    "plugins/plugin_errors.py": _ERRORS,
    "plugins/guarded_code.py": _ERRORS,
    "plugins/stop_signals.py": _ERRORS,
    "errors.py": _ERRORS,
    "crash_signals.py": _ERRORS,
    "atomic_files.py": "writes finished blocks",
    "execution/block_file.py": "writes finished blocks",
    "execution/failed_run.py": "finds the run at which a filter failed, whose block is not stored",
    "execution/arithmetic_digests.py": _KEYS,
    "execution/code_digests.py": _KEYS,
    "plugins/load.py": "runs a plugin's source, whose digest is part of the key",
    "plugins/plugin_content.py": "has a plugin's digest, which is part of the key",
    "plugins/imported_modules.py": "finds a plugin's files, whose digests are part of the key",
    "plugins/installed_packages.py": "finds a plugin's files, whose digests are part of the key",
    "plugins/loaded_and_changed_plugins.py": (
        "forgets plugins whose digest, which is part of the key, has changed"
    ),
    "plugins/opened_files_and_variables.py": "finds a plugin's files, whose digests are part of the key",
    "plugins/patches.py": "rejects plugins that change the package",
}
"""Files that the digest leaves out although a worker imports them or their folder is digested."""


@cache
def code_digest() -> str:
    """Return the digest of the sources that a block's numbers depend on, and of library versions."""
    home = Path(trackbench.__file__).parent
    digest = hashlib.sha256(repr(library_versions()).encode())
    add_sources(digest, home, block_sources(home))
    return digest.hexdigest()


def block_sources(home: Path) -> Iterator[Path]:
    """Yield the source files of the package at ``home`` that can change a block's numbers."""
    for source in _SOURCES:
        for file in python_files(home / source):
            if file.relative_to(home).as_posix() not in NO_PART_OF_BLOCKS:
                yield file


def python_files(source: Path) -> list[Path]:
    """Return the Python and C files of a folder in the order of their names, or a file itself."""
    if not source.is_dir():
        return [source]
    return sorted([*source.rglob("*.py"), *source.rglob("*.c")])


def add_sources(digest: "hashlib._Hash", home: Path, files: Iterable[Path]) -> None:
    """Add source files to the digest, each with its name from ``home``."""
    for file in files:
        digest.update(f"\n{file.relative_to(home).as_posix()}\n".encode())
        digest.update(file.read_bytes())


def foreign_code(cls: type[Any]) -> Iterator[str]:
    """Yield a digest of the code of each class from another package, among ``cls`` and its bases."""
    for base in cls.__mro__:
        name = base.__module__
        if name.partition(".")[0] in ("trackbench", "builtins", "typing"):
            continue
        module = sys.modules[name]
        # `trackbench.plugins.loaded_and_changed_plugins` writes the identity of a plugin, which is a
        # digest, to its module (`__plugin_digest__`), and to modules beside it that it imports
        # (`__plugin_brought__`). For other modules the digest is that of their package.
        digest = getattr(module, "__plugin_digest__", "")
        digest += getattr(module, "__plugin_brought__", "")
        yield digest or package_digest(name.partition(".")[0])


@cache
def package_digest(name: str) -> str:
    """Return the digest of the source of an imported package, or of a module in a single file."""
    try:
        file = Path(inspect.getsourcefile(sys.modules[name]) or "")
    except TypeError:
        # Code that was typed into an interpreter has no file: a random digest equals no stored one.
        return os.urandom(16).hex()
    digest = hashlib.sha256()
    sources = python_files(file.parent if file.name == "__init__.py" else file)
    add_sources(digest, file.parent, sources)
    return digest.hexdigest()


def library_versions() -> tuple[str, tuple[int, int], str, str]:
    """Return the processor's architecture and the versions of Python, numpy and scipy.

    They are part of `code_digests.code_digest`, and by it of every block's key: a block that another
    version stored is not found.
    """
    python = (sys.version_info.major, sys.version_info.minor)
    return platform.machine(), python, version("numpy"), version("scipy")
