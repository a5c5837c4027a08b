"""Installed packages, which count by their version, and editable ones, which count by their content."""

import sys
import sysconfig
from collections.abc import Iterable, Iterator
from functools import cache
from importlib.metadata import PackageNotFoundError, distributions, packages_distributions, version
from pathlib import Path

import trackbench

_KEYED = ("trackbench", "numpy", "scipy")
"""Packages whose versions are part of every block's key."""
_HOME = Path(trackbench.__file__).parent
_PYTHON = [Path(sysconfig.get_path(name)) for name in ("stdlib", "platstdlib")]


@cache
def is_installed(file: str) -> bool:
    """Test whether a file belongs to Python, to trackbench, or to a package with a RECORD."""
    path = Path(file)
    if path.is_relative_to(_HOME) or not path.is_absolute():  # such as <string>
        return True
    # The nearest folder with installed packages decides.
    for folder in path.parents:
        installed_files = _installed_files(str(folder))
        if installed_files:
            return path.relative_to(folder).as_posix() in installed_files
    return any(path.is_relative_to(root) for root in _PYTHON)


@cache
def _installed_files(folder: str) -> frozenset[str]:
    """List the files that the packages installed in a folder have in their RECORD."""
    files: set[str] = set()
    for package in distributions(path=[folder]):
        record = package.read_text("RECORD") or ""
        files.update(line.partition(",")[0] for line in record.splitlines())
    return frozenset(files)


def versions_of(names: Iterable[str]) -> Iterator[tuple[str, str]]:
    """Yield the installed packages that provide modules of these names, with their versions.

    Python's own modules are left out, and so are packages whose versions the keys of all blocks have.
    """
    other_names = set(names).difference(("", *_KEYED), sys.stdlib_module_names)
    for name in sorted(other_names):
        try:
            yield name, version(name)
        except PackageNotFoundError:  # a package may have another name than its modules
            for distribution in packages_distributions().get(name, ()):
                yield distribution, version(distribution)
