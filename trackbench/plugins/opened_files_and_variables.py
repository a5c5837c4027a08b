"""Files that a plugin opens and environment variables that it reads while it is loaded."""

import os
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from importlib.machinery import SourceFileLoader
from importlib.util import source_from_cache
from pathlib import Path
from types import ModuleType
from typing import Any

from trackbench.plugins.installed_packages import is_installed
from trackbench.readable_files import digest_of

_UNRELATED_FOLDERS = (
    Path("/dev"),
    Path("/etc"),
    Path("/proc"),
    Path("/sys"),
    Path("/usr/lib"),
    Path("/usr/share"),
    Path("~/.cache").expanduser(),
    Path("~/.config").expanduser(),
)
"""Folders of the system and of the user's settings, whose files are no part of a plugin."""


class Opened:
    """Files that were opened while plugin code was loaded, and variables that it read."""

    def __init__(self, read: Iterable[str] = (), variables: Iterable[str] = ()) -> None:
        # Dictionaries without values, which keep the order.
        self.read = dict.fromkeys(read)
        """paths of the files that were opened to be read only"""
        self.variables = dict.fromkeys(variables)
        """names of the environment variables"""
        self.written: set[str] = set()
        """files that were opened to be written only, or that were created or emptied"""
        self.updated: dict[str, str] = {}
        """digest, before it was opened, of each file that was opened to be read and written"""

    def add(self, other: "Opened") -> None:
        """Add the files and variables of another record. Digests that this record has are kept."""
        self.read |= other.read
        self.variables |= other.variables
        self.written |= other.written
        self.updated = {**other.updated, **self.updated}

    def files(self) -> list[str]:
        """Return the paths of the files on which the plugin's code depends.

        Files of installed packages and files that were written are left out. A file that was opened to
        be read and written (``updated``, with the digest from before) counts if its content has not
        changed.
        """
        unchanged = [name for name, digest in self.updated.items() if _is_unchanged(name, digest)]
        paths: dict[str, None] = {}
        for name in (*self.read, *unchanged):
            path = Path(name)
            if path.suffix == ".pyc":  # bytecode stands for its source
                with suppress(ValueError):
                    path = Path(source_from_cache(name))
            if any(path.is_relative_to(folder) for folder in _UNRELATED_FOLDERS):
                continue
            if is_installed(str(path)) or str(path) in self.written:
                continue
            if path.is_file():
                paths[str(path)] = None
        return list(paths)


def _is_unchanged(name: str, digest: str) -> bool:
    """Test whether a file still has this digest."""
    with suppress(OSError):
        return digest_of(name) == digest
    return False


_recorders: list[Opened] = []
"""Records under way, the outermost first."""
_python_exec_module = SourceFileLoader.exec_module
_read_by_module: dict[str, Opened] = {}
"""Files and variables that each module's code read when a plugin imported it, by the module's file."""


def execute_and_record(loader: SourceFileLoader, module: ModuleType) -> None:
    """Execute a module, and record what its code reads if a plugin imports it.

    A second plugin that imports the module does not execute it again, but depends on what the module
    read. So the record is kept by the module's file.
    """
    path = os.path.abspath(loader.path)
    if not _recorders or is_installed(path):
        _python_exec_module(loader, module)
        return
    with recorded() as opened:
        _python_exec_module(loader, module)
    _read_by_module[path] = opened


def read_at_import(file: str) -> Opened:
    """Return the files and variables that a module's code read when a plugin imported it."""
    return _read_by_module.get(file, Opened())


def _note_opened_file(event: str, arguments: tuple[Any, ...]) -> None:
    """Note a file that is opened; Python calls this for each event of its audit."""
    if not _recorders or event not in ("open", "sqlite3.connect", "ctypes.dlopen"):
        return
    if not isinstance(arguments[0], str | bytes | os.PathLike):
        return
    name = os.path.abspath(os.fsdecode(arguments[0]))
    if event != "open":
        # A library or a database. Python does not pass on how it is opened.
        _note_update(name)
        return
    # A file that may be created or emptied counts as written, even if it is read, too. One that exists
    # and is opened to be read and written counts as read, unless its content changes (`_note_update`).
    flags = arguments[2]  # after the path and the mode
    if flags & (os.O_WRONLY | os.O_CREAT | os.O_TRUNC):
        for recorder in _recorders:
            recorder.written.add(name)
    elif flags & os.O_RDWR:
        _note_update(name)
    else:
        for recorder in _recorders:
            recorder.read[name] = None


def _note_update(name: str) -> None:
    """Note a file that may be read and written, with its content before that."""
    paused = [*_recorders]
    _recorders.clear()  # the digest opens the file, too
    try:
        with suppress(OSError):
            if os.path.isfile(name):
                digest = digest_of(name)
                for recorder in paused:
                    recorder.updated.setdefault(name, digest)
    finally:
        _recorders.extend(paused)


@cache
def _add_audit_hook() -> None:
    sys.addaudithook(_note_opened_file)


@contextmanager
def recorded() -> Iterator[Opened]:
    """Record the files that are opened, and the environment variables that plugin code reads.

    A record within a record is part of both. Each look-up of a variable calls ``os.environ.encodekey``:
    the outermost record replaces this function by one that also notes the name.
    """
    _add_audit_hook()
    opened = Opened()
    replaced_functions: list[tuple[Any, Callable[[Any], Any]]] = []
    if not _recorders:
        replaced_functions = list(_note_variables())
    _recorders.append(opened)
    try:
        yield opened
    finally:
        _recorders.remove(opened)
        for environment, encode in replaced_functions:
            environment.encodekey = encode


def _note_variables() -> Iterator[tuple[Any, Callable[[Any], Any]]]:
    """Replace the function by which environments look up a name, so that reads are noted.

    Yield each environment with its original function, which is to be restored.
    """
    environments: list[Any] = [os.environ]
    if os.supports_bytes_environ:
        environments.append(os.environb)
    for environment in environments:
        encode = environment.encodekey

        def encode_and_note(key: Any, encode: Callable[[Any], Any] = encode) -> Any:
            """Encode a variable's name; note it if code outside installed packages looks it up."""
            # The code that reads the variable, and not Python's own around it.
            frame = sys._getframe(1)
            while frame.f_back is not None and frame.f_globals["__name__"] in _READERS:
                frame = frame.f_back
            if not is_installed(frame.f_code.co_filename):
                for recorder in _recorders:
                    recorder.variables[os.fsdecode(key)] = None
            return encode(key)

        environment.encodekey = encode_and_note
        yield environment, encode


_READERS = ("os", "_collections_abc", "collections.abc", "posixpath", "ntpath", "pathlib")
"""Modules of Python between ``os.environ`` and the code that reads a variable, as by expandvars."""


def notes_on_undeclared(
    plugin: str, files: Iterable[str], variables: Iterable[str]
) -> Iterator[str]:
    """Yield a note on each file and variable that a plugin read undeclared while it was loaded.

    ``plugin`` is the name of its file. Sources and compiled modules get no note.
    """
    data = [name for name in files if not name.endswith((".py", ".so", ".pyd"))]
    for key, names in (("files", data), ("environment", variables)):
        for name in names:
            yield (
                f"{plugin} read {name} while it was loaded; name it under "
                f"`{key}`, so that later changes are noticed wherever it is read"
            )
