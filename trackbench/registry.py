"""Registry of the classes that a config names by ``kind``: filters, scenarios, tables, figures, ...

A decorator registers a class. The registry finds its module by the decorator in the package's source
text, through an entry point of an installed package, or in a plugin file. A YAML never names an import
path.
"""

import atexit
import gc
import importlib
import re
import sys
from collections.abc import Callable, Iterator
from dataclasses import is_dataclass
from functools import cache
from pathlib import Path
from typing import Literal, NamedTuple, TypeVar, cast, get_args

from trackbench.component_parts import Part
from trackbench.entry_points import entries_of_group
from trackbench.plugin_class_hooks import rebase

Group = Literal[
    "filters", "scenarios", "targets", "motions", "sensors", "starts", "figures", "tables"
]
GROUPS: tuple[Group, ...] = get_args(Group)
BLOCK_GROUPS = tuple(group for group in GROUPS if group not in ("figures", "tables"))
"""Groups whose parts make a block's numbers."""
T = TypeVar("T", bound=type)

_PLACES: dict[Group, tuple[str, str, str]] = {
    "filters": ("trackbench.filters", "trackbench.filters.base", "Filter"),
    "scenarios": ("trackbench.scenarios", "trackbench.scenarios.base", "Scenario"),
    "targets": ("trackbench.scenarios.targets", "trackbench.scenarios.targets.base", "Target"),
    "motions": ("trackbench.models.motions", "trackbench.models.base", "Motion"),
    "sensors": ("trackbench.models.sensors", "trackbench.models.sensors.base", "SensorBase"),
    "starts": ("trackbench.scenarios.starts", "trackbench.scenarios.starts.base", "Start"),
    "figures": ("trackbench.report.figures", "trackbench.report.kinds", "FigureKind"),
    "tables": ("trackbench.report.tables", "trackbench.report.kinds", "TableKind"),
}
"""Package of each group's kinds; module and name of their base."""
_kinds: dict[Group, dict[str, type[Part]]] = {group: {} for group in GROUPS}
_scanned: set[Group] = set()
_of_plugins: dict[str, list[tuple[Group, str, type[Part]]]] = {}
"""Registrations of each plugin's module: group, kind, class."""


def register(group: Group, kind: str) -> Callable[[T], T]:
    """Decorate a class to register ``kind: <kind>`` with its group's base.

    A kind belongs to one module or plugin file, which registers it once.

    Parameters
    ----------
    group
        group of the class, such as ``filters`` or ``tables``
    kind
        name by which a config chooses the class

    Returns
    -------
    callable
        decorator of the dataclass. It returns the class itself, or a copy that also derives from the
        base of the group

    Raises
    ------
    TypeError
        when it decorates a class that is no dataclass, that lacks a hook, or that has a name which is
        nearly a hook's (`InvalidHookError`)
    ValueError
        when it decorates, if the group is unknown or the kind is registered already
    """

    def add(cls: T) -> T:
        """Check and register the class; return it."""
        if not is_dataclass(cls):
            raise TypeError(f"{cls.__name__} is not a dataclass (frozen=True, kw_only=True)")
        if group not in GROUPS:
            raise ValueError(f"{group!r} is not a group of kinds: {', '.join(GROUPS)}")
        # An edited plugin, loaded anew as another module of the same origin, may replace its kinds.
        known = _kinds[group].get(kind)
        if known is not None and _origin(known) != _origin(cls):
            raise ValueError(f"{group} kind {kind!r} is already taken by {known.__module__}")
        if (group, kind) in ((g, k) for g, k, _ in registered(cls.__module__)):
            raise ValueError(f"the kind {kind!r} is registered twice in this file")
        # The class with its group's hooks: itself, or a copy that derives from the group's base, too.
        whole: type[Part] = rebase(cls, base_of(group))
        whole.kind = kind
        _kinds[group][kind] = whole
        if is_plugin(cls.__module__):
            _of_plugins.setdefault(cls.__module__, []).append((group, kind, whole))
        return cast(T, whole)

    return add


def base_of(group: Group) -> type[Part]:
    """Import the base of a group's classes, which declares their hooks."""
    _, module, name = _PLACES[group]
    return cast(type[Part], vars(importlib.import_module(module))[name])


def registered(module: str) -> list[tuple[Group, str, type[Part]]]:
    """Return the registrations of a plugin's module: group, kind, class."""
    return _of_plugins.get(module, [])


def registered_kinds() -> Iterator[type[Part]]:
    """Yield every class of any group that is registered by now."""
    return (cls for known in _kinds.values() for cls in known.values())


def reactivate(module: str) -> None:
    """Register a plugin's kinds again, after another file of its name was loaded."""
    for group, kind, cls in registered(module):
        _kinds[group][kind] = cls


def unregister(module: str) -> None:
    """Remove the kinds of a plugin's module, since its code failed or is to run again.

    A kind that another file has registered since stays.
    """
    for group, kind, cls in _of_plugins.pop(module, []):
        if _kinds[group].get(kind) is cls:
            del _kinds[group][kind]


def restore_normal_exit() -> None:
    """Let Python end the program as usual: it then writes the files that plugin code left open."""
    atexit.unregister(gc.freeze)  # a shortcut of `__main__`


def _origin(cls: type) -> str:
    """Return the name of a class's module, that of a plugin without the digest at its end.

    An edited plugin, which has another digest, may thus register its kinds again.
    """
    module = cls.__module__
    return module.rpartition("_")[0] if is_plugin(module) else module


def is_plugin(module: str) -> bool:
    """Test whether the module is a file that a config names."""
    return hasattr(sys.modules[module], "__plugin_digest__")


def of_kind(group: Group, kind: str) -> type[Part] | None:
    """Look up the class of a kind, None if there is none; of a kind of the package import only its file.

    For any other kind the whole group is imported, with the installed packages that register kinds.
    """
    home = _homes(group).get(kind)
    if kind not in _kinds[group] and home is not None:
        importlib.import_module(home.module)
    return _kinds[group].get(kind) or kinds(group).get(kind)


def kinds(group: Group) -> dict[str, type[Part]]:
    """Return every registered class of a group, and import the group first.

    Parameters
    ----------
    group
        group of the classes, such as ``filters``

    Returns
    -------
    dict
        classes by kind, sorted by kind: those of the package, of installed packages and of loaded
        plugins
    """
    if group not in _scanned:
        _scanned.add(group)
        import_own(group)
        for entry in entries_of_group(group):
            # `__main__` shortens the end of the program. With foreign code it ends as usual: Python then
            # writes the files that the entry's code leaves open.
            restore_normal_exit()
            entry.load()
    return dict(sorted(_kinds[group].items()))


class _Home(NamedTuple):
    """Place of a kind of the package: its module, and the docstring of its class."""

    module: str
    doc: str


_REGISTRATION = re.compile(
    r'^@register\("(\w+)", "([^"]+)"\)\n(?:@[^\n]*\n)*class [^:]*:\n    """(.*?)"""', re.S | re.M
)


@cache
def _homes(group: Group) -> dict[str, _Home]:
    """Find the module and docstring of each of the package's kinds of a group, by kind.

    They are read from the source text: nothing is imported.
    """
    package, *_ = _PLACES[group]
    folder = Path(__file__).parents[1].joinpath(*package.split("."))
    homes: dict[str, _Home] = {}
    for file in [*folder.glob("*.py"), *folder.glob("*/*.py")]:
        name = ".".join(file.relative_to(folder).with_suffix("").parts)
        for of_group, kind, doc in _REGISTRATION.findall(file.read_text(encoding="utf-8")):
            if of_group == group:
                homes[kind] = _Home(f"{package}.{name}", doc)
    return homes


def documentation(group: Group) -> dict[str, str]:
    """Read the docstring of every kind of a group, sorted, without importing the package's kinds.

    If the group is imported anyway, or installed packages add kinds to it, the classes are asked.
    """
    if group in _scanned or entries_of_group(group):
        return {kind: cls.__doc__ or "" for kind, cls in kinds(group).items()}
    return {kind: home.doc for kind, home in sorted(_homes(group).items())}


def import_own(*groups: Group) -> None:
    """Import the package's own files that register kinds of these groups."""
    for group in groups:
        for module in sorted({home.module for home in _homes(group).values()}):
            importlib.import_module(module)
