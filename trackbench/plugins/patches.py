"""Find functions and constants of the package that plugin code replaces, and put them back.

Blocks of the package's own filters are cached under the digest of its source. A function that a plugin
replaced would make numbers of another source under that key.
"""

import sys
from collections.abc import Iterator
from itertools import chain
from types import FunctionType, ModuleType
from typing import Any, TypeAlias

_ROOTS = ("trackbench", "numpy", "scipy")
_BODY = ("__code__", "__defaults__", "__kwdefaults__")
_MISSING = object()

Names: TypeAlias = list[tuple[Any, dict[str, Any]]]
"""Modules and classes, each with the values of its names."""
Bodies: TypeAlias = dict[FunctionType, tuple[Any, ...]]
"""Functions with their code and default values."""
OwnValues: TypeAlias = tuple[Names, Bodies]


def own_values() -> OwnValues:
    """Record the values of the modules and classes of the package, numpy and scipy."""
    names = [(holder, dict(vars(holder))) for holder in _holders()]
    values = chain.from_iterable(of_holder.values() for _, of_holder in names)
    return names, {v: _body(v) for v in values if isinstance(v, FunctionType)}


def _holders() -> Iterator[Any]:
    """Yield the imported modules, and the classes that the package's define."""
    for module in [*sys.modules.values()]:
        root = str(getattr(module, "__name__", "")).partition(".")[0]
        if root in _ROOTS and isinstance(module, ModuleType):
            yield module
            for value in [*vars(module).values()] if root == _ROOTS[0] else ():
                if isinstance(value, type) and value.__module__ == module.__name__:
                    yield value


def _body(function: FunctionType) -> tuple[Any, ...]:
    return tuple(getattr(function, attribute) for attribute in _BODY)


def undo_patches(before: OwnValues) -> list[str]:
    """Restore replaced values; return their names, such as ``trackbench.core.kalman.condition``."""
    names, bodies = before
    changed = [function for function, body in bodies.items() if _body(function) != body]
    replaced = [f"{function.__module__}.{function.__qualname__}" for function in changed]
    for function in changed:
        for attribute, value in zip(_BODY, bodies[function], strict=True):
            setattr(function, attribute, value)
    for holder, values in names:
        now = dict(vars(holder))
        for name in {**values, **now} if now != values else ():
            if _is_patched(holder, values.get(name, _MISSING), now.get(name, _MISSING), name):
                is_class = isinstance(holder, type)
                prefix = (
                    f"{holder.__module__}.{holder.__qualname__}" if is_class else holder.__name__
                )
                replaced.append(f"{prefix}.{name}")
                if name in values:
                    setattr(holder, name, values[name])
                else:
                    delattr(holder, name)
    return replaced


def _is_patched(holder: Any, before: Any, now: Any, name: str) -> bool:
    """Test whether a name has another value; of numpy and scipy only functions count.

    Importing a submodule or using a class adds names, which are no patches.
    """
    if now is before:
        return False
    if not holder.__name__.startswith(_ROOTS[1:]) or isinstance(holder, type):
        is_internal = name.startswith("__") and not callable(now)
        return before is not _MISSING or not (isinstance(now, ModuleType) or is_internal)
    return before is not _MISSING and callable(before)


def patch_message(names: list[str]) -> str:
    """Explain why a plugin that replaces these names is refused, and what to do."""
    more = f" and {len(names) - 1} more" if len(names) > 1 else ""
    return (
        f"replaces {names[0]}{more}, which filters of the package use, too; a plugin may only add: "
        "write the changed function into a filter of its own"
    )
