"""Modules that a plugin imports: their source files, and packages by version.

Installed packages count by their version. Everything else counts by its content: packages installed
in editable mode, files beside the plugin or on the path, and files that its code opens or runs.
"""

import ast
import os
import sys
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from importlib import invalidate_caches
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from pathlib import Path
from types import CodeType, ModuleType

from trackbench.plugins.installed_packages import is_installed
from trackbench.plugins.opened_files_and_variables import execute_and_record
from trackbench.plugins.plugin_errors import PluginError
from trackbench.readable_files import digest_of

_EXTENSIONS = (".so", ".pyd")


class Finder:
    """Finder of modules that looks beside plugins, after all other places."""

    folders: tuple[str, ...] = ()

    @classmethod
    def look_beside(cls, plugin: str) -> None:
        """Search the folder of this plugin before those of other plugins."""
        folder = str(Path(plugin).parent)
        cls.folders = (folder, *(other for other in cls.folders if other != folder))
        # From the first plugin on, modules outside installed packages are compiled from their source: a
        # file of bytecode could be that of an earlier content. What they read as a plugin imports them
        # is recorded (`execute_and_record`), since cached blocks depend on it.
        if cls not in sys.meta_path:
            sys.meta_path.append(cls)
            SourceFileLoader.get_code = _get_code  # type: ignore[assignment, method-assign]
            SourceFileLoader.exec_module = execute_and_record  # type: ignore[assignment, method-assign]
        invalidate_caches()  # Python's lists of a folder's files, which may lack one of this second

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
                # A module without a file, as one that is built into Python, counts as installed.
                file = spec.origin if spec.has_location else None
                if file is None or is_installed(file):
                    packages.add(spec.name.partition(".")[0])
                elif spec.name not in modules and file != plugin:
                    modules[spec.name] = _file_or_archive(os.path.abspath(file))
                    is_package = bool(spec.submodule_search_locations)
                    inner_parent = spec.name if is_package else spec.parent or ""
                    # A compiled module has no source to read.
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
        if isinstance(node, ast.Call):
            yield from _name_in_call(node, parent)
        elif isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.name
        elif isinstance(node, ast.ImportFrom):
            name = _absolute_name(node.module or "", node.level, parent)
            # `from a import b`: b may be a module of the package a, or a name in the module a.
            for alias in node.names:
                yield f"{name}.{alias.name}"


def _absolute_name(module: str, dots: int, parent: str) -> str:
    """Return the whole name of a module that a source names after so many dots; ``module`` may be empty.

    ``parent`` is the name of the source's package. One dot is this package, and each further one the
    package around it.
    """
    words = []
    if dots:
        packages = parent.split(".")
        words += packages[: len(packages) - dots + 1]
    words.append(module)
    return ".".join(word for word in words if word)


def _name_in_call(call: ast.Call, parent: str) -> Iterator[str]:
    """Yield the name in ``import_module("name")`` or ``__import__("name")``, unless it is computed.

    A name that begins with dots counts from the source's package, ``parent``.
    """
    function = call.func
    called = function.attr if isinstance(function, ast.Attribute) else getattr(function, "id", "")
    if called not in ("import_module", "__import__") or not call.args:
        return
    first = call.args[0]
    if isinstance(first, ast.Constant) and isinstance(first.value, str):
        module = first.value.lstrip(".")
        yield _absolute_name(module, len(first.value) - len(module), parent)


def _file_or_archive(path: str) -> str:
    """Return the path of a module's file, or of the zip archive that it is in."""
    for outer in (Path(path), *Path(path).parents):
        if outer.is_file():
            return str(outer)
    return path


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


def check_module_names(files: Mapping[str, str]) -> None:
    """Raise PluginError if Python already has another module under the name of one of these.

    ``files`` has the file of each module that a plugin imports, by the module's name. The other module
    is one that another plugin imported from its own folder. The plugin would get that one.
    """
    for name, loaded_module in imported_modules(names=files, files=()).items():
        loaded_file = os.path.abspath(getattr(loaded_module, "__file__", None) or "")
        if not os.path.isfile(loaded_file) or os.path.samefile(loaded_file, files[name]):
            continue
        # Two files of equal content are as good as one.
        if digest_of(loaded_file) != digest_of(files[name]):
            raise PluginError(
                f"imports {name} from {files[name]}, and another plugin has imported {loaded_file}, "
                "which has the same name; rename one of the two files"
            )
