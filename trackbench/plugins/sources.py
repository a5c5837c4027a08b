"""Find what a plugin brings in: source files, data files, and packages by version.

Installed packages count by their version. Everything else counts by its content: packages installed
in editable mode, files beside the plugin or on the path, and files that its code opens or runs.
"""

import ast
import hashlib
import os
import sys
import sysconfig
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import cache
from importlib import invalidate_caches
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from importlib.metadata import distributions
from importlib.util import source_from_cache
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

import trackbench

_HOME = Path(trackbench.__file__).parent
_PYTHON = [Path(sysconfig.get_path(name)) for name in ("stdlib", "platstdlib")]
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
_EXTENSIONS = (".so", ".pyd")


def digest_of(path: str | Path) -> str:
    """Digest a file by SHA-256; raises OSError."""
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


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


class Finder:
    """Finder of modules that looks beside plugins, after all other places."""

    folders: tuple[str, ...] = ()

    @classmethod
    def look_beside(cls, plugin: str) -> None:
        """Search the folder of this plugin before those of other plugins."""
        folder = str(Path(plugin).parent)
        cls.folders = (folder, *(other for other in cls.folders if other != folder))
        # From the first plugin on, modules outside installed packages are compiled anew. A record is
        # kept of what they read when a plugin imports them.
        if cls not in sys.meta_path:
            sys.meta_path.append(cls)
            SourceFileLoader.get_code = _get_code  # type: ignore[assignment, method-assign]
            SourceFileLoader.exec_module = _exec_module  # type: ignore[assignment, method-assign]
        invalidate_caches()  # a file may be of this very second

    @classmethod
    def find_spec(
        cls, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return the spec of a module in the folder of a plugin; None if there is none.

        Python calls this. ``path`` is None for a module that is not within a package.
        """
        if path is not None:
            return None
        return PathFinder.find_spec(name, cls.folders)


_python_get_code = SourceFileLoader.get_code
_python_exec_module = SourceFileLoader.exec_module


def _exec_module(loader: SourceFileLoader, module: ModuleType) -> None:
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
    _read_at_import[path] = opened


def _get_code(loader: SourceFileLoader, fullname: str) -> CodeType | None:
    """Compile a source outside installed packages anew, however it is imported.

    A file of bytecode may belong to another source of the same second and length.
    """
    path = os.path.abspath(loader.path)
    if is_installed(path):
        return _python_get_code(loader, fullname)
    source = loader.get_data(path)
    code: CodeType = loader.source_to_code(source, path)
    return code


def imports(source: bytes, plugin: str) -> tuple[dict[str, str], set[str]]:
    """Find what a plugin's source imports anywhere, directly or by the modules that it imports.

    Return two results: the file of each module outside installed packages, by the module's name, and
    the names of the installed packages. No code is run. ``plugin`` is the path of the plugin's own file.
    """
    modules: dict[str, str] = {}
    packages: set[str] = set()
    # Sources to read, each with the name of the package that it is in.
    sources = [(source, "")]
    while sources:
        text, parent = sources.pop()
        for name in _imported_names(text, parent):
            for spec in _find_specs(name):
                file = spec.origin if spec.has_location else None
                if file is None or is_installed(file):
                    packages.add(spec.name.partition(".")[0])
                elif spec.name not in modules and file != plugin:
                    modules[spec.name] = os.path.abspath(file)
                    is_package = bool(spec.submodule_search_locations)
                    inner_parent = spec.name if is_package else spec.parent or ""
                    with suppress(OSError):
                        if not file.endswith(_EXTENSIONS):
                            sources.append((Path(file).read_bytes(), inner_parent))
    return modules, packages


def _imported_names(source: bytes, parent: str) -> Iterator[str]:
    """Yield the names of modules that a source imports, anywhere in it.

    ``parent`` is the name of the package that it is in, from which relative imports count.
    """
    try:
        nodes = list(ast.walk(ast.parse(source)))
    except (SyntaxError, ValueError):  # reported when it runs
        return
    for node in nodes:
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.name
        elif isinstance(node, ast.ImportFrom):
            words = []
            if node.level:  # one dot for the package itself, a further one for each around it
                packages = parent.split(".")
                words += packages[: len(packages) - node.level + 1]
            if node.module:
                words.append(node.module)
            name = ".".join(word for word in words if word)
            # `from a import b`: b may be a module of the package a, or a name in the module a.
            for alias in node.names:
                yield f"{name}.{alias.name}"


def _find_specs(name: str) -> Iterator[ModuleSpec]:
    """Yield the specs of the packages that contain a module, outermost first, and of the module.

    Nothing is imported. The specs end before the first name that is not found.
    """
    search_path: Sequence[str] | None = None
    inner_name = ""
    for word in name.split("."):
        inner_name = f"{inner_name}.{word}".lstrip(".")
        try:
            spec = _find_spec(inner_name, search_path)
        except (ImportError, ValueError, AttributeError):
            return
        if spec is None:
            return
        yield spec
        search_path = spec.submodule_search_locations
        if search_path is None:
            return


def _find_spec(name: str, search_path: Sequence[str] | None) -> ModuleSpec | None:
    """Return the spec of the first finder that knows the module."""
    for finder in list(sys.meta_path):
        spec = finder.find_spec(name, search_path, None)
        if spec is not None:
            return spec
    return None


def imported_modules(names: Collection[str], files: Collection[str]) -> dict[str, ModuleType]:
    """Select the imported modules of these names, and those that come from one of these files."""
    chosen = {}
    for name, module in [*sys.modules.items()]:
        file = os.path.abspath(getattr(module, "__file__", None) or "")
        if name != "__main__" and (name in names or file in files):
            chosen[name] = module
    return chosen


def forget_modules(modules: Iterable[str]) -> None:
    """Let Python execute these modules again when they are next imported.

    A compiled module stays, since a process loads it only once.
    """
    for name in modules:
        file = str(getattr(sys.modules.get(name), "__file__", None) or "")
        if name in sys.modules and not file.endswith(_EXTENSIONS):
            del sys.modules[name]


def is_rebuilt(module: ModuleType) -> bool:
    """Test whether the file of a compiled module has changed since this process loaded it.

    The first call for a file notes its content, and returns False.
    """
    file = os.path.abspath(getattr(module, "__file__", None) or "")
    if not file.endswith(_EXTENSIONS) or not os.path.isfile(file):
        return False
    return _loaded_extensions.setdefault(file, digest_of(file)) != digest_of(file)


_loaded_extensions: dict[str, str] = {}
"""Digest of each compiled module when it was loaded."""


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
_read_at_import: dict[str, Opened] = {}
"""Files and variables that each module's code read when a plugin imported it, by the module's file."""


def read_at_import(file: str) -> Opened:
    """Return the files and variables that a module's code read when a plugin imported it."""
    return _read_at_import.get(file, Opened())


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
    recorders = [*_recorders]
    _recorders.clear()  # the digest opens the file, too
    try:
        with suppress(OSError):
            if os.path.isfile(name):
                digest = digest_of(name)
                for recorder in recorders:
                    recorder.updated.setdefault(name, digest)
    finally:
        _recorders.extend(recorders)


@cache
def _add_audit_hook() -> None:
    sys.addaudithook(_note_opened_file)


@contextmanager
def recorded() -> Iterator[Opened]:
    """Record the files that are opened, and the environment variables that plugin code reads.

    A record within a record is part of both.
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
