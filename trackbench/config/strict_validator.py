"""Strict validator of a dataclass, by pydantic: unknown keys and values of other types are mistakes."""

from dataclasses import is_dataclass
from typing import TypeVar, get_args, get_type_hints

from pydantic import ConfigDict, TypeAdapter

from trackbench.field_types import cached, key_of

T = TypeVar("T")


@cached
def adapter(cls: type[T], documented: bool = False) -> TypeAdapter[T]:
    """Build the strict validator of a dataclass: unknown keys are mistakes.

    ``documented`` adds the docstrings of attributes to its JSON schema, which takes time.
    """
    # The configuration is set here and not on each class, so that a filter stays a plain dataclass.
    # `TypeAdapter` reads it at once: a later call may replace it.
    config = ConfigDict(
        extra="forbid",
        use_attribute_docstrings=documented,
        alias_generator=key_of,
        populate_by_name=True,
    )
    _set_pydantic_config(cls, config, configured=set())
    return TypeAdapter(cls)


def _set_pydantic_config(hint: object, config: ConfigDict, configured: set[type]) -> None:
    """Give a dataclass, and every dataclass within it, this configuration of pydantic.

    ``configured`` collects the classes that have it, so that each is visited once.
    """
    if isinstance(hint, type) and is_dataclass(hint) and hint not in configured:
        configured.add(hint)
        setattr(hint, "__pydantic_config__", config)  # noqa: B010
        for inner in get_type_hints(hint, include_extras=True).values():
            _set_pydantic_config(inner, config, configured)
    for inner in get_args(hint):
        _set_pydantic_config(inner, config, configured)
