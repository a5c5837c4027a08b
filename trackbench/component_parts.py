"""Components of an experiment and the parts that they are made of: which are the package's own."""

from collections.abc import Iterator
from dataclasses import Field, fields, is_dataclass
from typing import TYPE_CHECKING, ClassVar

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


class Part:
    """Root of the bases of all groups."""

    if TYPE_CHECKING:  # every registered class is a dataclass
        __dataclass_fields__: ClassVar[dict[str, Field[object]]]

    kind: str = ""
    """the name under which the class is registered"""
    presets: ClassVar[dict[str, dict[str, object]]] = {}
    """named sets of keys, chosen in a config by ``preset: NAME``"""
    unsupported_keys: ClassVar[dict[str, str]] = {}
    """keys that a user may expect, each with the reason why it is rejected"""
    optional_capabilities: ClassVar[tuple[type, ...]] = ()
    """protocols of hooks that have no default: a class has them or not"""

    @property
    def contents(self) -> dict[str, str]:
        """Digests of the data files read, by path; without them files are hashed."""
        return {}

    @classmethod
    def explain(cls) -> str:
        """Return further lines for ``trackbench describe``."""
        return ""


def is_foreign(component: object) -> bool:
    """Test whether a component of an experiment, or a class, is not the package's own."""
    cls = component if isinstance(component, type) else type(component)
    return cls.__module__.partition(".")[0] != "trackbench"


def field_values(instance: "DataclassInstance") -> dict[str, object]:
    """Return the values of a dataclass by key; values within it stay as they are."""
    return {field.name: getattr(instance, field.name) for field in fields(instance)}


def walk_parts(component: object) -> Iterator[object]:
    """Yield a component of an experiment, or each of several, and all that it is made of.

    Parameters
    ----------
    component
        dataclass, class, or a tuple or list of these; any other value yields nothing

    Yields
    ------
    object
        each dataclass before the dataclasses in its fields, and each class
    """
    if isinstance(component, tuple | list):
        for item in component:
            yield from walk_parts(item)
    elif isinstance(component, type):
        yield component
    elif is_dataclass(component) and not isinstance(component, type):
        yield component
        for value in field_values(component).values():
            yield from walk_parts(value)


def foreign_parts(component: object) -> list[object]:
    """Find the parts of a component that are not the package's own."""
    return [part for part in walk_parts(component) if is_foreign(part)]
