"""Plugin: the content of its file, and digests of all that it imports and reads."""

import hashlib
import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from trackbench.plugins.imported_modules import Finder, imports
from trackbench.plugins.installed_packages import versions_of
from trackbench.plugins.opened_files_and_variables import (
    Opened,
    notes_on_undeclared,
    read_at_import,
)
from trackbench.readable_files import digest_of, require_regular_file

_UNSET = "not set"
Digests = tuple[tuple[str, str], ...]
"""Names of files or variables, each with the digest of its content."""


@dataclass(frozen=True)
class Plugin:
    """One file: its name for messages, its content, and what it imports and reads."""

    path: str
    source: bytes
    packages: Digests = ()
    """installed packages that it imports, by version"""
    files: Digests = ()
    """files and folders that the config declares"""
    environment: Digests = ()
    """environment variables that the config declares"""
    code: Digests = ()
    """source files that it imports, and that are no part of an installed package"""
    opened: Digests = ()
    """other files that it opened while it was loaded"""
    variables: Digests = ()
    """other environment variables that it read while it was loaded"""

    @property
    def digest(self) -> str:
        """SHA-256 of the content."""
        return hashlib.sha256(self.source).hexdigest()

    @property
    def identity(self) -> str:
        """SHA-256 of a plugin's content and of all that it imports and reads.

        A file is named by its path from the plugin's folder: two files of one name may exchange their
        contents, and the folder may be moved.
        """
        home = os.path.dirname(self.path)

        def named_from_home(digests: Digests) -> list[tuple[str, str]]:
            return sorted((_path_from(home, name), digest) for name, digest in digests)

        # Cached blocks depend on this list and its order.
        parts_of_identity = [
            self.digest,
            self.packages,
            named_from_home(self.files),  # declared by the config
            named_from_home((*self.code, *self.opened)),  # imported, and opened while it was loaded
            self.environment,  # variables that the config declares
            self.variables,  # other variables that it read while it was loaded
        ]
        return hashlib.sha256(repr(parts_of_identity).encode()).hexdigest()

    @property
    def module(self) -> str:
        """Name of the plugin's module, made of its file's name and the digest of its content.

        The digest covers what is read before the code runs: also the source files that it imports, and
        the files and variables that the config declares.
        """
        stem = "".join(c if c.isalnum() else "_" for c in Path(self.path).stem)
        # The name is needed before the code runs: what running it may add is left out.
        read_before = replace(self, packages=(), opened=(), variables=())
        return f"trackbench_plugin_{stem}_{read_before.identity[:12]}"

    @property
    def notes(self) -> Iterator[str]:
        """Yield a note on each file and variable that the plugin read undeclared while it was loaded.

        ``opened`` and ``variables`` have no declared ones. Sources and compiled modules get no note.
        """
        files = [name for name, _ in self.opened]
        variables = [name for name, _ in self.variables]
        yield from notes_on_undeclared(Path(self.path).name, files, variables)


def read_plugin(path: Path, files: Digests = (), environment: Iterable[str] = ()) -> Plugin:
    """Read a plugin's file as it is now; raises OSError. Its code is not run.

    ``files`` are the files that the config declares, with their digests. ``environment`` are the names
    of the variables that it declares.
    """
    source = require_regular_file(path).read_bytes()
    name = str(path.absolute())
    Finder.look_beside(name)  # from now on Python also finds modules beside the plugin
    modules, packages = imports(source, name)
    return Plugin(
        path=name,
        source=source,
        packages=tuple(versions_of(packages)),
        files=files,
        environment=digest_variables(environment),
        code=digest_files(modules.values()),
    )


def _path_from(home: str, name: str) -> str:
    """Write a path from this folder, with slashes on every system."""
    try:
        path = os.path.relpath(name, home)
    except ValueError:  # on another drive of Windows
        path = name
    return Path(path).as_posix()


def digest_files(files: Iterable[str]) -> Digests:
    """Digest files, each once, in the order of their paths."""
    return tuple((file, digest_of(file)) for file in sorted(set(files)))


def digest_variables(names: Iterable[str]) -> Digests:
    """Digest the values of environment variables, since they may be secret."""
    digests = []
    for name in sorted(names):
        digest = _UNSET
        value = os.environ.get(name)
        if value is not None:
            digest = hashlib.sha256(value.encode()).hexdigest()
        digests.append((name, digest))
    return tuple(digests)


def with_opened(plugin: Plugin, opened: Opened) -> Plugin:
    """Return the plugin with digests of the files that it opened and of the variables that it read.

    ``opened`` is the record of its own code.
    """
    # Imports are found once more, as the plugin's code may have extended Python's search path.
    modules, packages = imports(plugin.source, plugin.path)
    # Step 1: add the files and variables that its modules read when they were imported.
    all_opened = Opened()
    all_opened.add(opened)
    for file in (*modules.values(), *opened.files()):
        all_opened.add(read_at_import(file))
    # Step 2: leave out those that are declared, or known as code. Modules that were found only now stay.
    known_files = {plugin.path}
    known_files.update(name for name, _ in plugin.files)
    known_files.update(name for name, _ in plugin.code)
    declared_folders = tuple(f"{name}{os.sep}" for name, _ in plugin.files)
    other_files = set()
    for file in (*all_opened.files(), *modules.values()):
        if file not in known_files and not file.startswith(declared_folders):
            other_files.add(file)
    declared_variables = {name for name, _ in plugin.environment}
    return replace(
        plugin,
        packages=tuple(versions_of(packages)),
        opened=digest_files(other_files),
        variables=digest_variables(all_opened.variables.keys() - declared_variables),
    )
