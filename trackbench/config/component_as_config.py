"""Write a component as the config mapping that makes it, without keys that older folders lack."""

from collections.abc import Callable
from dataclasses import MISSING, fields, is_dataclass
from typing import Any, TypeAlias

from trackbench.component_parts import Part, field_values
from trackbench.config.file_paths import file_keys
from trackbench.evaluation.metric_expression import Measure
from trackbench.field_types import key_of
from trackbench.models.assume import Assume

PlainData: TypeAlias = dict[str, Any]
"""A config, or a part of one, as a file has it."""


def as_config(component: Part | Assume, write_path: Callable[[str], str] = str) -> PlainData:
    """Write a registered dataclass as the mapping that makes it.

    ``write_path`` writes the path of a data file. Keys that were added after the first versions are left
    out unless they are set, so that configs of older results folders stay as they are.
    """
    names_of_files = file_keys(type(component))
    mapping: PlainData = {}
    if isinstance(component, Part):
        mapping["kind"] = component.kind
    for field in fields(component):
        if not field.init:
            continue
        value = getattr(component, field.name)
        if field.name in names_of_files and isinstance(value, str):
            value = write_path(value)
        elif field.name in names_of_files and value is not None:
            value = [write_path(path) for path in value]
        mapping[field.name] = _as_plain_data(value, write_path)
    return _without_unset_later_keys(component, mapping)


_LATER = (
    "faults",
    "robust",
    "delay",
    "late",
    "format",
    "density",
    "settled_error",
    "environment",
    "clockwise",
    "thousands",
    "input",
    "input_file",
    "input_gap",
    "input_naming",
)
"""Keys that older results folders lack: left out if unset, so that their configs stay as they are."""
_LATER_WITH_DEFAULT = ("gate_by", "input_holds")
"""Keys of this kind whose default is a word: left out at the default."""


def _without_unset_later_keys(component: Any, values: PlainData) -> PlainData:
    """Leave out keys of a component that older results folders lack, if they change nothing.

    A key of `_LATER` is left out if it is empty, as its default is. A key of `_LATER_WITH_DEFAULT` is
    left out if its value is its default.
    """
    defaults = {}
    for field in fields(component):
        has_factory = field.default_factory is not MISSING
        # Factories make empty lists and mappings, which count as no value.
        defaults[key_of(field.name)] = None if has_factory else field.default
    remaining = {}
    for key, value in values.items():
        # An empty list was written if the default is none: `clockwise: []` of one of several files.
        is_empty_list = defaults.get(key) is None and value in ([], ())
        is_unset = key in _LATER and not value and not defaults[key] and not is_empty_list
        is_default = key in _LATER_WITH_DEFAULT and value == defaults[key]
        if not (is_unset or is_default):
            remaining[key] = value
    return remaining


def _as_plain_data(value: object, write_path: Callable[[str], str]) -> object:
    """Write the value of a component's key as plain data: mappings, lists and scalars.

    ``write_path`` writes the path of a data file.
    """
    if isinstance(value, Part):
        return as_config(value, write_path)
    if is_dataclass(value) and not isinstance(value, type):
        # Keys that configs of older versions lack are left out unless they are set.
        by_key = {key_of(name): inner for name, inner in field_values(value).items()}
        value = _without_unset_later_keys(value, by_key)
    if isinstance(value, Measure):  # an expression, which is a named tuple: so before the tuples
        return str(value)
    if isinstance(value, dict):
        return {key: _as_plain_data(inner, write_path) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_as_plain_data(inner, write_path) for inner in value]
    return value
