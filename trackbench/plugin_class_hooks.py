"""Hooks: the methods and attributes that the base of a group declares for its classes.

A hook is a public method or attribute of the base that is no key. Every registered class has its base
among its own, so a hook is called directly. A plugin class that does not name the base gets it at its
registration. A missing hook, or a name that is nearly a hook's, is a mistake then.
"""

import inspect
import re
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from difflib import get_close_matches
from inspect import getattr_static
from types import new_class
from typing import Any, NamedTuple, cast

from trackbench.component_parts import Part

_ALIKE = 0.8  # of two names: `bound` and `bounds` are 0.91, `estimated` and `estimate` 0.94
_NOTHING = object()


class InvalidHookError(TypeError):
    """Missing hooks of a class, or names nearly like a hook: one line each."""

    def __str__(self) -> str:
        return "; ".join(self.args)


class Hook(NamedTuple):
    """A hook for people: ``diagnostics(state)``, whether there is no default, and what it is."""

    form: str
    needed: bool
    text: str


def rebase(cls: type[Any], base: type[Part]) -> type[Part]:
    """Return the class itself if it derives from the base, or else a copy that derives from both.

    The copy has the name and the keys of the class. Hooks that the class lacks come from the base. A
    test checks the package's own classes instead.

    Parameters
    ----------
    cls
        dataclass of a plugin or of the package
    base
        base of the class's group, which declares the hooks

    Returns
    -------
    type
        class that derives from ``base``

    Raises
    ------
    InvalidHookError
        if a plugin's class lacks a hook without default, or has a name that is nearly a hook's
    """
    if not issubclass(cls, base):
        body = {name: getattr(cls, name) for name in ("__module__", "__qualname__", "__doc__")}
        # A key without a default is no attribute of the class, and would meet the base's property.
        body |= {f.name: None for f in fields(cls) if not hasattr(cls, f.name)}
        cls = new_class(cls.__name__, (cls, base), {}, lambda namespace: namespace.update(body))
    if not cls.__module__.startswith("trackbench."):
        lines = [f"{file}:{line}: {message}" for file, line, message in sorted(mistakes(cls, base))]
        if lines:
            raise InvalidHookError(*lines)
    return cast(type[Part], cls)


def hooks(base: type[Part]) -> Iterator[Hook]:
    """Yield the hooks of a base, those without a default first, with their text for people.

    Parameters
    ----------
    base
        base of a group, such as ``Filter``

    Yields
    ------
    Hook
        form such as ``diagnostics(state)``, and the first paragraph of the hook's docstring
    """
    declared = _declared(base)
    for name, hook in sorted(declared.items(), key=lambda item: not _is_needed(item[1])):
        # A method is written with its arguments: `diagnostics(state)`.
        form = name
        if inspect.isroutine(hook) or isinstance(hook, classmethod):
            method: Any = getattr(base, name, hook)
            names = [n for n in inspect.signature(method).parameters if n != "self"]
            form += f"({', '.join(names)})"
        yield Hook(form, _is_needed(hook), _text(name, hook, base))


def overridden_hooks(cls: type, base: type[Part]) -> list[str]:
    """Name the hooks of the base whose default a class overrides.

    Hooks without a default, which every class has, and hooks that are keys of the class are left out.
    """
    keys = {f.name for f in fields(cls)}
    names = [n for n, hook in _declared(base).items() if n not in keys and not _is_needed(hook)]
    return [n for n in names if getattr_static(cls, n, None) is not getattr_static(base, n, None)]


def _declared(base: type[Part]) -> dict[str, object]:
    """Return the hooks that a base class declares, with their defaults, by name.

    A default is the method, property or value in the base. `_NOTHING` stands for a hook without default,
    which a class must have. None stands for such a hook of an optional capability, which a class need
    not have. Names that begin with _ and keys of the base, if it is a dataclass, are no hooks.
    """
    declared: dict[str, object] = {}
    # A name belongs to the first class that declares it: the base, then its own bases, then the optional
    # capabilities. An annotation without a value is a hook without default.
    for owner in _owners(base):
        without_default: object = _NOTHING
        if owner in base.optional_capabilities:
            without_default = None
        hooks_of_owner = dict.fromkeys(inspect.get_annotations(owner), without_default)
        hooks_of_owner |= dict(vars(owner))
        for name, hook in hooks_of_owner.items():
            declared.setdefault(name, hook)
    no_hooks = {"kind", "optional_capabilities"}
    if is_dataclass(base):
        no_hooks |= {f.name for f in fields(base)}
    return {n: v for n, v in declared.items() if not n.startswith("_") and n not in no_hooks}


def _owners(base: type[Part]) -> list[type]:
    """List the classes that declare a base's hooks: the base, its own bases, optional capabilities."""
    package_classes = [c for c in base.__mro__ if c.__module__.startswith("trackbench.")]
    return [*package_classes, *base.optional_capabilities]


def _is_needed(declared: object) -> bool:
    """Test whether a hook with this default in `_declared` is one that a class must have."""
    return declared is _NOTHING or getattr(declared, "__isabstractmethod__", False)


def mistakes(cls: type, base: type[Part]) -> Iterator[tuple[str, int, str]]:
    """Yield the mistakes in the hooks of a class.

    They are hooks that are missing, hidden by a key or without their ``@property``, and names that are
    nearly a hook's. An optional capability is a set of hooks that a class may have or lack: the base has
    no defaults of them.

    Parameters
    ----------
    cls
        dataclass that has ``base`` among its own bases
    base
        base of the class's group, which declares the hooks

    Yields
    ------
    file : str
        file of the class; its module if there is no source text
    line : int
        line of the mistake from 1; 0 if there is no source text
    message : str
        text of the mistake
    """
    known = _declared(base)
    keys = {f.name: f.default for f in fields(cls)}
    # Hooks that are missing, hidden by a key, or of another form.
    for name, declared in known.items():
        actual = getattr_static(cls, name, declared)
        if name not in keys and actual is declared and _is_needed(declared):
            yield *_place(cls, "class"), f"{cls.__name__} has no `{name}`"
        # A dataclass takes a base's attribute of the key's name for its default: here the hook itself.
        # ``declared`` is None for a hook of an optional capability, which has no default to be taken.
        if declared is not None and keys.get(name) is declared:
            yield *_place(cls, name), f"the key `{name}` is a hook, too: give it a default"
        if isinstance(declared, property) and inspect.isfunction(actual):
            yield *_place(cls, name), f"`{name}` is no method: put @property above it"
    # Names that are nearly those of hooks.
    for owner in set(cls.__mro__) - set(base.__mro__):
        names = {*vars(owner), *inspect.get_annotations(owner)} - known.keys() - keys.keys()
        for name in names:
            if name.startswith("_"):
                continue
            near = get_close_matches(name, known, n=1, cutoff=_ALIKE)
            if near:
                question = f"did you mean `{near[0]}`? Helpers begin with _"
                yield *_place(owner, name), f"`{name}` is no hook; {question}"


def _place(cls: type, name: str) -> tuple[str, int]:
    """Return the file and the line at which a class defines a name; else those of the class itself.

    Without a source text they are the class's module and 0.
    """
    try:
        lines, first = inspect.getsourcelines(cls)
    except (OSError, TypeError):
        return cls.__module__, 0
    definition = re.compile(rf"\s*(def\s+)?{name}\b")
    after = next((i for i, line in enumerate(lines) if definition.match(line)), 0)
    return str(inspect.getsourcefile(cls)), first + after


def _text(name: str, declared: object, base: type[Part]) -> str:
    """Return the first paragraph on a hook: of its docstring, or of the string under an attribute.

    ``declared`` is the hook's default, which has the docstring.
    """
    if inspect.isroutine(declared) or isinstance(declared, property | classmethod):
        text = inspect.getdoc(declared) or ""
    else:
        under = re.compile(rf'\n    {name}: [^\n]*\n    """(.*?)"""', re.S)
        matches = (under.search(inspect.getsource(owner)) for owner in _owners(base))
        text = next((match[1] for match in matches if match), "")
    return " ".join(text.split("\n\n")[0].replace("``", "`").split())
