"""Python files of one's own: loaded only when allowed, the same in every worker.

A plugin travels as its source text, so that a worker on another machine needs no file, and its module
is named by its content, so that an edited plugin is another module.
"""

import ast
import hashlib
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, packages_distributions, version
from pathlib import Path
from types import ModuleType

from trackbench import registry
from trackbench.errors import RunError, UserError, reason
from trackbench.extension_points import InvalidHookError
from trackbench.field_types import require_regular_file
from trackbench.plugins.errors import BadPluginError, message_of, place_within
from trackbench.plugins.interrupts import guarded
from trackbench.registry import kinds
from trackbench.yaml_source import Source

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


def load_plugins(source: Source, folder: Path, allowed: bool) -> tuple[Plugin, ...]:
    """Load the config's ``plugins``, paths counted from ``folder``; raises UserError.

    A config that names plugins is refused unless their code may be run.
    """
    names = source.data.get("plugins") or []
    if not isinstance(names, list):
        return ()  # said by the validation of the whole
    plugins, problems = [], []
    for i, name in enumerate(names):
        where = ("plugins", i)
        try:
            plugins.append(_loaded(folder, name, allowed))
        except BadPluginError as why:
            problems += [source.problem(where, what) for what in why.args]
    if problems:
        raise UserError(*problems)
    _check_apart(plugins, source)
    return tuple(plugins)


def _check_apart(plugins: list[Plugin], source: Source) -> None:
    """Reject two plugins of a config that register the same kind."""
    owners: dict[tuple[str, str], Plugin] = {}
    for i, plugin in enumerate(plugins):
        for group, kind, _ in registry.registered(plugin.module):
            owner = owners.setdefault((group, kind), plugin)
            if owner is not plugin and owner.module != plugin.module:
                what = f"{plugin.path}: the kind {kind!r} is registered by {owner.path}, too"
                where = ("plugins", i)
                raise UserError(source.problem(where, what))


def _loaded(folder: Path, name: object, allowed: bool) -> Plugin:
    if not isinstance(name, str) or not name.endswith(".py"):
        raise BadPluginError(f"{name!r} is not the path of a Python file")
    if not allowed:
        raise BadPluginError(f"the code in {name} is run only with --allow-plugins")
    for group in ("filters", "scenarios"):
        kinds(group)  # what the package has comes first, so that a plugin cannot take its names
    try:
        plugin = read_plugin(folder / name)
        load_plugin(plugin)
    except OSError as error:
        raise BadPluginError(f"{folder / name}: {reason(error)}") from None
    return plugin


def load_plugin(plugin: Plugin, checked: bool = True) -> None:
    """Run the plugin's code once in this process, so that its kinds are registered.

    Raises BadPluginError with what its code raises, or what is wrong with its kinds,
    which a worker need not look at once more.
    """
    if plugin.module in sys.modules:
        registry.reactivate(plugin.module)
        return
    here = tuple(_versions(plugin.source))
    if here != plugin.packages:
        raise BadPluginError(f"this worker has {_listed(here)}, not {_listed(plugin.packages)}")
    module = ModuleType(plugin.module)
    module.__file__ = plugin.path
    setattr(module, "__plugin_digest__", plugin.identity)  # noqa: B010 (no such field in the type)
    sys.modules[plugin.module] = module
    registry.restore_normal_exit()
    try:
        with guarded():
            exec(compile(plugin.source, plugin.path, "exec"), module.__dict__)
        if checked:
            _check_kinds(plugin.module)
    except BaseException as error:
        registry.unregister(plugin.module)
        del sys.modules[plugin.module]
        if isinstance(error, BadPluginError) or not isinstance(error, Exception):
            raise
        if isinstance(error, InvalidHookError):
            raise BadPluginError(*error.args) from None
        where = place_within(error, {plugin.path}) or f"{Path(plugin.path).name}: "
        ended = error.__context__ if isinstance(error, RunError) else None
        raise BadPluginError(where + message_of(ended or error)) from None


def _listed(packages: tuple[tuple[str, str], ...]) -> str:
    return ", ".join(f"{name} {number}" for name, number in packages) or "nothing that it imports"


def _check_kinds(module: str) -> None:
    from trackbench.config.plugin_checks import check_kind

    for _, _, cls in registry.registered(module):
        check_kind(cls)
