"""Find functions and constants of the package that plugin code replaces, and put them back.

Blocks of the package's own filters are cached under the digest of its source. A function that a plugin
replaced would make numbers of another source under that key.
"""

import sys
from collections.abc import Iterator
from types import FunctionType, ModuleType
from typing import Any, TypeAlias

_PACKAGES = ("trackbench", "numpy", "scipy")
_BODY = ("__code__", "__defaults__", "__kwdefaults__")
"""Attributes of a function that its results depend on."""
_MISSING = object()
"""Value of a name that does not exist."""

Names: TypeAlias = list[tuple[Any, dict[str, Any]]]
"""Modules and classes, each with the values of its names."""
Bodies: TypeAlias = dict[FunctionType, tuple[Any, ...]]
"""Functions with their code and default values."""
OwnValues: TypeAlias = tuple[Names, Bodies]


def own_values() -> OwnValues:
    """Record the values in trackbench's, numpy's and scipy's modules and in trackbench's classes.

    Return two results: each module and class with the values of its names, and the code and default
    values of each function among these values.
    """
    names = []
    bodies = {}
    for holder in _modules_and_classes():
        values = dict(vars(holder))
        names.append((holder, values))
        for value in values.values():
            if isinstance(value, FunctionType):
                bodies[value] = _function_body(value)
    return names, bodies


def _modules_and_classes() -> Iterator[Any]:
    """Yield the imported modules of trackbench, numpy and scipy, and the classes in trackbench's."""
    for module in list(sys.modules.values()):
        package = str(getattr(module, "__name__", "")).partition(".")[0]
        if package not in _PACKAGES or not isinstance(module, ModuleType):
            continue
        yield module
        if package == "trackbench":
            for value in list(vars(module).values()):
                if isinstance(value, type) and value.__module__ == module.__name__:
                    yield value


def _function_body(function: FunctionType) -> tuple[Any, ...]:
    # Written out for speed: some 16 000 functions are read for each block of a plugin's filter.
    return function.__code__, function.__defaults__, function.__kwdefaults__


def undo_patches(before: OwnValues) -> list[str]:
    """Restore the values that were replaced since ``before``, as `own_values` recorded them.

    Return their names, such as ``trackbench.core.kalman.condition``.
    """
    names, bodies = before
    replaced = []
    # Step 1: functions whose code or default values were changed in place.
    for function, body in bodies.items():
        if _function_body(function) != body:
            replaced.append(f"{function.__module__}.{function.__qualname__}")
            for attribute, value in zip(_BODY, body, strict=True):
                setattr(function, attribute, value)
    # Step 2: names of modules and classes with other values.
    for holder, values in names:
        values_now = dict(vars(holder))
        if values_now == values:
            continue
        for name in {**values, **values_now}:
            value = values.get(name, _MISSING)
            value_now = values_now.get(name, _MISSING)
            if not _is_patched(holder, name, value, value_now):
                continue
            replaced.append(f"{_full_name(holder)}.{name}")
            if name in values:
                setattr(holder, name, values[name])
            else:
                delattr(holder, name)
    return replaced


def _full_name(holder: Any) -> str:
    """Return the name of a module, or of a class with its module."""
    if isinstance(holder, type):
        return f"{holder.__module__}.{holder.__qualname__}"
    return str(holder.__name__)


def _is_patched(holder: Any, name: str, value: Any, value_now: Any) -> bool:
    """Test whether plugin code has replaced or added the value of a name.

    ``holder`` is the module or class of the name, ``value`` its value before and ``value_now`` after. In
    modules of numpy and scipy only replaced functions count. A submodule that was imported, and an
    internal name that Python added to a class, are no patches.
    """
    if value_now is value:
        return False
    is_new = value is _MISSING
    is_library = holder.__name__.startswith(("numpy", "scipy")) and not isinstance(holder, type)
    if is_library:
        return not is_new and callable(value)
    if not is_new:
        return True
    is_internal = name.startswith("__") and not callable(value_now)
    return not isinstance(value_now, ModuleType) and not is_internal


def patch_message(names: list[str]) -> str:
    """Explain why a plugin that replaces these names is refused, and what to do."""
    replaced = names[0]
    if len(names) > 1:
        replaced += f" and {len(names) - 1} more"
    return (
        f"replaces {replaced}, which filters of the package use, too; a plugin may only add: "
        "write the changed function into a filter of its own"
    )
