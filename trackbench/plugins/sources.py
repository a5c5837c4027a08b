"""Find what a plugin brings in: source files, data files, and packages by version.

Installed packages count by their version. Everything else counts by its content: packages installed
in editable mode, files beside the plugin or on the path, and files that its code opens or runs.
"""

import ast
import hashlib
import os
import sys
import sysconfig
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import cache
from importlib import invalidate_caches
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from importlib.metadata import distributions
from importlib.util import source_from_cache
from itertools import chain
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

import trackbench

_HOME = Path(trackbench.__file__).parent
_PYTHON = [Path(sysconfig.get_path(name)) for name in ("stdlib", "platstdlib")]
_OF_THE_SYSTEM = [*map(Path, ("/dev", "/etc", "/proc", "/sys", "/usr/lib", "/usr/share"))]
_OF_THE_USER = [Path("~/.cache").expanduser(), Path("~/.config").expanduser()]
_EXTENSIONS = (".so", ".pyd")
_executed: dict[str, str] = {}
"""Digest of the source that each file was last executed from."""


def digest_of(path: str | Path) -> str:
    """Digest a file by SHA-256; raises OSError."""
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


@cache
def is_installed(file: str) -> bool:
    """Test whether a file belongs to Python, to trackbench, or to a package with a RECORD."""
    path = Path(file)
    if path.is_relative_to(_HOME) or not path.is_absolute():  # such as <string>
        return True
    for folder in path.parents:
        if recorded := _recorded(str(folder)):
            return path.relative_to(folder).as_posix() in recorded
    return any(path.is_relative_to(root) for root in _PYTHON)


@cache
def _recorded(folder: str) -> frozenset[str]:
    """List the files that the packages installed in a folder have in their RECORD."""
    packages = distributions(path=[folder])
    lines = ((package.read_text("RECORD") or "").splitlines() for package in packages)
    return frozenset(line.partition(",")[0] for line in chain.from_iterable(lines))


class Finder:
    """Finder of modules that looks beside plugins, after all other places."""

    folders: tuple[str, ...] = ()

    @classmethod
    def look_beside(cls, plugin: str) -> None:
        """Search the folder of this plugin before those of other plugins."""
        folder = str(Path(plugin).parent)
        cls.folders = (folder, *(other for other in cls.folders if other != folder))
        if cls not in sys.meta_path:
            sys.meta_path.append(cls)
            SourceFileLoader.get_code = _get_code  # type: ignore[assignment, method-assign]
        invalidate_caches()  # a file may be of this very second

    @classmethod
    def find_spec(
        cls, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return the spec of a file beside a plugin."""
        return PathFinder.find_spec(name, cls.folders) if path is None else None


_python_get_code = SourceFileLoader.get_code


def _get_code(loader: SourceFileLoader, fullname: str) -> CodeType | None:
    """Compile a source outside installed packages anew, however it is imported.

    A file of bytecode may belong to another source of the same second and length.
    """
    path = os.path.abspath(loader.path)
    if is_installed(path):
        return _python_get_code(loader, fullname)
    source = loader.get_data(path)
    _executed[path] = hashlib.sha256(source).hexdigest()
    code: CodeType = loader.source_to_code(source, path)
    return code


def imports(source: bytes, plugin: str) -> tuple[dict[str, str], set[str]]:
    """Find modules outside installed packages, each with its file, and names of other packages.

    They are those that a plugin's source imports anywhere, and that these modules import in turn.
    Nothing is run.
    """
    modules: dict[str, str] = {}
    packages: set[str] = set()
    waiting = [(source, "")]
    while waiting:
        text, parent = waiting.pop()
        for spec in chain.from_iterable(map(_specs, _names(text, parent))):
            file = spec.origin if spec.has_location else None
            if file is None or is_installed(file):
                packages.add(spec.name.partition(".")[0])
            elif spec.name not in modules and file != plugin:
                modules[spec.name] = os.path.abspath(file)
                inner = spec.name if spec.submodule_search_locations else spec.parent or ""
                with suppress(OSError):
                    if not file.endswith(_EXTENSIONS):
                        waiting.append((Path(file).read_bytes(), inner))
    return modules, packages


def _names(source: bytes, parent: str) -> Iterator[str]:
    """Yield the names of modules that a source imports, anywhere in it."""
    try:
        nodes = [*ast.walk(ast.parse(source))]
    except (SyntaxError, ValueError):  # reported when it runs
        return
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            around = parent.split(".")[: len(parent.split(".")) - node.level + 1]
            start = ".".join(around) if node.level else ""
            name = ".".join(part for part in (start, node.module) if part)
            yield from (f"{name}.{alias.name}" for alias in node.names)


def _specs(name: str) -> Iterator[ModuleSpec]:
    """Yield the specs of the packages around a module and of the module, without importing them."""
    path: Sequence[str] | None = None
    inner = ""
    for part in name.split("."):
        inner = f"{inner}.{part}".lstrip(".")
        try:
            found = (finder.find_spec(inner, path, None) for finder in [*sys.meta_path])
            spec = next((spec for spec in found if spec is not None), None)
        except (ImportError, ValueError, AttributeError):
            return
        if spec is None:
            return
        yield spec
        path = spec.submodule_search_locations
        if path is None:
            return


def forget_edited(modules: Mapping[str, str], opened: Collection[str]) -> None:
    """Forget imported modules of a plugin if any of their files has other content by now.

    ``modules`` are files by the module's name; ``opened`` are files of modules that the plugin's code
    finds by itself.
    """
    imported = {}
    for name, module in [*sys.modules.items()]:
        file = os.path.abspath(getattr(module, "__file__", None) or "")
        if name in modules or file in opened:
            imported[name] = file
    imported = {n: f for n, f in imported.items() if not f.endswith(_EXTENSIONS)}
    if any(
        file != modules.get(name, file) or _executed.get(file) != digest_of(file)
        for name, file in imported.items()
    ):
        for name in imported.keys() - {"__main__"}:
            del sys.modules[name]


class Opened:
    """Files that were opened while plugin code was loaded, and variables that it read."""

    def __init__(self, read: Iterable[str] = (), variables: Iterable[str] = ()) -> None:
        self.read = dict.fromkeys(read)
        self.variables = dict.fromkeys(variables)
        self.written: set[str] = set()

    def files(self) -> list[str]:
        """Select the files that make the plugin: those of no installed package, and not written."""
        paths: dict[str, None] = {}
        for name in self.read:
            path = Path(name)
            if path.suffix == ".pyc":
                with suppress(ValueError):
                    path = Path(source_from_cache(name))
            roots = (*_OF_THE_SYSTEM, *_OF_THE_USER)
            apart = any(path.is_relative_to(root) for root in roots) or is_installed(str(path))
            if path.is_file() and not apart and str(path) not in self.written:
                paths[str(path)] = None
        return [*paths]


_recorders: list[Opened] = []


def _hear(event: str, arguments: tuple[Any, ...]) -> None:
    """Note a file that is opened; Python calls this for each event of its audit."""
    if event == "open" and _recorders and isinstance(arguments[0], str | bytes | os.PathLike):
        name = os.path.abspath(os.fsdecode(arguments[0]))
        writes = arguments[2] & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)
        for recorder in _recorders:
            if writes:
                recorder.written.add(name)
            else:
                recorder.read[name] = None


@cache
def _listen() -> None:
    sys.addaudithook(_hear)


@contextmanager
def recorded() -> Iterator[Opened]:
    """Record the files that are opened, and the environment variables that plugin code reads."""
    _listen()
    opened = Opened()
    environment: Any = os.environ
    encode: Callable[[str], bytes] = environment.encodekey

    def noted(key: str) -> bytes:
        frame = sys._getframe(1)
        while frame.f_back is not None and frame.f_globals["__name__"] in _READERS:
            frame = frame.f_back
        if not is_installed(frame.f_code.co_filename):
            opened.variables[key] = None
        return encode(key)

    _recorders.append(opened)
    environment.encodekey = noted
    try:
        yield opened
    finally:
        environment.encodekey = encode
        _recorders.remove(opened)


_READERS = ("os", "_collections_abc", "collections.abc")
"""Modules of Python between ``os.environ`` and the code that reads a variable."""
