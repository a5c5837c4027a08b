"""Rules for a plugin's classes: frozen dataclasses, types of keys, defaults that YAML can express."""

from collections.abc import Iterator
from dataclasses import MISSING, Field, fields, is_dataclass
from typing import cast

from trackbench.component_parts import Part
from trackbench.config.experiment import DrawnExhibit, Exhibit
from trackbench.config.strict_validator import adapter
from trackbench.filters.base import Filter, WrongReturnError
from trackbench.plugins.plugin_errors import PluginError, location_of
from trackbench.registry import base_of

_FILES = {"per_step", "per_run", "summary"}
_PLAIN = (bool, int, float, str, type(None))


def check_kind(cls: type[Part]) -> None:
    """Raise PluginError, with the first mistake, for a class that no config could name."""
    mistake = next(_class_mistakes(cls), None)
    if mistake is not None:
        # An error that names no method has the location of the class.
        location = location_of(WrongReturnError("", ""), cls)
        raise PluginError(f"{location}{cls.__name__}: {mistake}")


def _class_mistakes(cls: type[Part]) -> Iterator[str]:
    """Yield the mistakes in the attributes and keys of a registered class."""
    if cls.__hash__ is None:
        yield "is not frozen: @dataclass(frozen=True, kw_only=True)"
    presets: object = cls.presets
    if not isinstance(presets, dict) or not all(isinstance(p, dict) for p in presets.values()):
        yield "presets is not a mapping of names to mappings of keys"
    if issubclass(cls, Filter):
        needs: object = cls.requires
        if not isinstance(needs, tuple) or not all(isinstance(n, str) and "." in n for n in needs):
            yield f"requires is {needs!r}, not a tuple of names such as 'motion.F'"
        if isinstance(cls.summed_diagnostics, str):
            yield "summed_diagnostics is a word, not a set of words"
    if issubclass(cls, (base_of("tables"), base_of("figures"))):
        yield from _exhibit_mistakes(cast(type[Exhibit], cls))
    # Keys: defaults and types that a YAML can hold.
    for field in fields(cls):
        default = _default_value(field)
        if field.init and not _is_plain_data(default):
            yield f"the key {field.name} is a {type(default).__name__}, which no YAML can hold"
    try:
        adapter(cls)
    except Exception as error:
        first_line = str(error).split("\n", 1)[0]
        # pydantic's advice, "Set `arbitrary_types_allowed=True` ...", does not help here.
        without_advice = first_line.split(". Set `arb", 1)[0]
        yield f"has a key of a type that no YAML can hold: {without_advice}"


def _exhibit_mistakes(cls: type[Exhibit]) -> Iterator[str]:
    """Yield the mistakes in the attributes of a table or figure class.

    ``requires`` has the metrics that it always shows, each with its file. ``label_keys`` are its keys
    with labels of filters, and ``numbers`` those that count runs and components.
    """
    needs = cls.requires
    if not isinstance(needs, dict) or not set(needs.values()) <= _FILES:
        yield f"requires is {needs!r}, not a mapping of metrics to {', '.join(sorted(_FILES))}"
    known_keys = {field.name for field in fields(cls)}
    key_lists = {"label_keys": cls.label_keys}
    if issubclass(cls, DrawnExhibit):
        key_lists["numbers"] = cls.numbers
    for name, keys in key_lists.items():
        if not isinstance(keys, tuple) or not set(keys) <= known_keys:
            yield f"{name} is {keys!r}, not a tuple of keys"


def _default_value(field: "Field[object]") -> object:
    """Return a key's default; None without one."""
    if field.default_factory is not MISSING:
        return field.default_factory()
    if field.default is MISSING:
        return None
    return field.default


def _is_plain_data(value: object) -> bool:
    """Test whether a YAML file can have a value: it is made of scalars, lists, mappings, components."""
    if isinstance(value, list | tuple):
        return all(_is_plain_data(item) for item in value)
    if isinstance(value, dict):
        return all(_is_plain_data(item) for item in (*value, *value.values()))
    if isinstance(value, _PLAIN):
        return True
    return is_dataclass(value) and not isinstance(value, type)
