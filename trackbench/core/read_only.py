"""Read-only memory of results that are shared."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import ModuleType
from typing import Any, Literal, cast

import numpy as np

from trackbench.core.arrays import A, T


def fixed(a: A) -> A:
    """Return the array in memory that cannot be made writable, for results that are shared.

    numpy refuses ``setflags(write=True)`` for an array over `bytes`, for its base and for its views.

    Parameters
    ----------
    a : array (...)
        Array of any shape and type. It becomes read-only itself.

    Returns
    -------
    array (...)
        Copy over `bytes`, or ``a`` itself if it has such memory, is of a subclass, or contains objects.
    """
    if isinstance(memory_owner(a), bytes):
        return a
    a.flags.writeable = False  # the caller may keep the old array
    # In the copy a subclass would lose its type, and objects would be addresses without a reference.
    if type(a) is not np.ndarray or a.dtype.hasobject:
        return a
    # Copy the values into a `bytes` object, in the order of the array's memory.
    order: Literal["C", "F"] = "F" if a.flags.fnc else "C"
    return cast(A, np.ndarray(a.shape, a.dtype, a.tobytes(order), order=order))


def memory_owner(a: Any) -> Any:
    """Return the object whose memory the array shows: itself, unless it is a view."""
    owner = a
    while isinstance(owner, np.ndarray) and owner.base is not None:
        owner = owner.base
    return owner


def freeze(whole: T) -> T:
    """Replace every array in the collections and attributes of ``whole`` by a `fixed` one.

    Tuples are rebuilt; lists, dictionaries and objects keep their identity.
    """
    return _freeze(whole, {})


def _freeze(whole: Any, done: dict[int, Any]) -> Any:
    """Return ``whole`` with `fixed` arrays; ``done`` maps the id of each object to (object, result)."""
    if id(whole) in done:
        return done[id(whole)][1]
    # Enter the object before its parts, which may refer to it. The reference keeps its identity valid.
    done[id(whole)] = whole, whole
    if isinstance(whole, np.ndarray):
        done[id(whole)] = whole, fixed(whole)
    elif isinstance(whole, tuple):
        parts = [_freeze(part, done) for part in whole]
        if any(part is not old for part, old in zip(parts, whole, strict=True)):
            # A named tuple is made by `_make`: its class takes each part as an argument.
            done[id(whole)] = whole, getattr(whole, "_make", type(whole))(parts)
    else:
        for name, part in parts_of(whole):
            replacement = _freeze(part, done)
            if replacement is part:
                continue
            if isinstance(whole, list | dict):
                whole[name] = replacement
            else:
                # Frozen dataclasses accept this. An object that refuses keeps its read-only old array.
                with suppress(AttributeError):
                    object.__setattr__(whole, name, replacement)
    return done[id(whole)][1]


def parts_of(whole: Any) -> list[tuple[Any, Any]]:
    """List the name and value of each item or attribute of ``whole``.

    Parameters
    ----------
    whole : object
        Collection, instance, or anything else.

    Returns
    -------
    list of (name, value)
        Items of a tuple, list or dictionary, by index or key. Attributes and dataclass fields of an
        instance, by name. Nothing for a class or a module.
    """
    if isinstance(whole, tuple | list):
        return list(enumerate(whole))
    if isinstance(whole, dict):
        return list(whole.items())
    if isinstance(whole, type | ModuleType):
        return []
    # Attributes of an instance, and dataclass fields that live in slots.
    names = {*getattr(whole, "__dict__", ()), *getattr(whole, "__dataclass_fields__", ())}
    return [(name, getattr(whole, name, None)) for name in names]


@contextmanager
def explain_read_only_errors() -> Iterator[None]:
    """Explain numpy's error about a read-only array to the author of a filter."""
    try:
        yield
    except ValueError as error:
        if "read-only" not in str(error) and "WRITEABLE" not in str(error):
            raise
        advice = "what a filter is given is read-only: copy it before you write to it"
        raise ValueError(f"{advice} ({error})") from error
