"""Load plugins: Python files of the user with filters, scenarios, tables or figures.

A plugin travels to a worker as its source text, so that another machine needs no file. Its module is
named by its content, so that an edited plugin is another module.
"""

import ast
import hashlib
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, packages_distributions, version
from pathlib import Path
from types import ModuleType

from trackbench import registry
from trackbench.errors import RunError
from trackbench.extension_points import InvalidHookError, Part
from trackbench.field_types import require_regular_file
from trackbench.plugins.errors import PluginError, guarded, message_of, place_within

_KEYED = ("trackbench", "numpy", "scipy")
"""Packages whose versions are part of every block's key."""


@dataclass(frozen=True)
class Plugin:
    """One file: its name for messages, its content, and the packages that it imports, by version."""

    path: str
    source: bytes
    packages: tuple[tuple[str, str], ...] = ()

    @property
    def digest(self) -> str:
        """Return the SHA-256 of the content."""
        return hashlib.sha256(self.source).hexdigest()

    @property
    def identity(self) -> str:
        """Return the SHA-256 of a plugin's content and of the versions of what it imports."""
        return hashlib.sha256(f"{self.digest} {self.packages}".encode()).hexdigest()

    @property
    def module(self) -> str:
        """Name of its module."""
        stem = "".join(c if c.isalnum() else "_" for c in Path(self.path).stem)
        return f"trackbench_plugin_{stem}_{self.identity[:12]}"


def read_plugin(path: Path) -> Plugin:
    """Return the file as it is now; raises OSError."""
    source = require_regular_file(path).read_bytes()
    return Plugin(str(path.absolute()), source, tuple(_versions(source)))


def _versions(source: bytes) -> Iterator[tuple[str, str]]:
    """Yield installed packages that a source imports, anywhere in it, with their versions."""
    try:
        nodes = list(ast.walk(ast.parse(source)))
    except (SyntaxError, ValueError):  # said when it is run
        return
    names = {a.name for node in nodes if isinstance(node, ast.Import) for a in node.names}
    names |= {node.module or "" for node in nodes if isinstance(node, ast.ImportFrom)}
    for name in sorted({name.partition(".")[0] for name in names}):
        if name and name not in (*_KEYED, *sys.stdlib_module_names):
            yield from _version(name)


def _version(name: str) -> Iterator[tuple[str, str]]:
    try:
        yield name, version(name)
    except PackageNotFoundError:  # a package need not be called as what it holds
        for other in packages_distributions().get(name, ()):
            yield other, version(other)


def load_plugin(plugin: Plugin, check: Callable[[type[Part]], None] | None = None) -> None:
    """Run the plugin's code once in this process, so that its kinds are registered.

    Raises PluginError for what its code raises, and for what ``check`` finds wrong with its kinds. A
    worker gets plugins that are checked.
    """
    if plugin.module in sys.modules:
        registry.reactivate(plugin.module)
        return
    # Step 1: on a worker, the packages that the plugin imports must be those of its key.
    installed = tuple(_versions(plugin.source))
    if installed != plugin.packages:
        raise PluginError(f"this worker has {_listed(installed)}, not {_listed(plugin.packages)}")
    # Step 2: a module under the name of the content, in which the code runs.
    module = ModuleType(plugin.module)
    module.__file__ = plugin.path
    setattr(module, "__plugin_digest__", plugin.identity)  # noqa: B010 (no such field in the type)
    sys.modules[plugin.module] = module
    registry.restore_normal_exit()
    try:
        with guarded():
            exec(compile(plugin.source, plugin.path, "exec"), module.__dict__)
        if check is not None:
            for _, _, cls in registry.registered(plugin.module):
                check(cls)
    except BaseException as error:
        # Step 3: of a plugin that failed nothing stays.
        registry.unregister(plugin.module)
        del sys.modules[plugin.module]
        if isinstance(error, PluginError) or not isinstance(error, Exception):
            raise
        if isinstance(error, InvalidHookError):
            raise PluginError(*error.args) from None
        where = place_within(error, {plugin.path}) or f"{Path(plugin.path).name}: "
        ended = error.__context__ if isinstance(error, RunError) else None
        raise PluginError(where + message_of(ended or error)) from None


def _listed(packages: tuple[tuple[str, str], ...]) -> str:
    return ", ".join(f"{name} {number}" for name, number in packages) or "nothing that it imports"
