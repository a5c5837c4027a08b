"""Build dataclasses and registered components from mappings; report every mistake with its position."""

import json
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, TypeVar, get_args, get_origin

from pydantic import ValidationError
from pydantic_core import PydanticCustomError

from trackbench.component_parts import Part
from trackbench.config.allow_plugins import PROGRAM_REFUSED, is_allowed
from trackbench.config.file_paths import make_paths_absolute
from trackbench.config.files_key import add_declared
from trackbench.config.key_and_value_mistakes import (
    REPORTED,
    describe_missing_kind,
    find_class,
    mistakes_of,
    shown,
)
from trackbench.config.presets import with_preset
from trackbench.config.strict_validator import adapter
from trackbench.field_types import hints_of
from trackbench.filters.base import Filter
from trackbench.plugins.plugin_errors import PluginError, plugin_code
from trackbench.plugins.scenario_trial import check_sensors
from trackbench.registry import Group
from trackbench.yaml_source import Keys, Source, dotted, marked, put

ENTRY_KEYS = ("assume", "late")
"""Keys of every filter's entry beside those of its class."""
T = TypeVar("T")


def build(
    cls: type[T], source: Source, keys: Keys, data: object = None, further_keys: Sequence[str] = ()
) -> T | None:
    """Build the dataclass from the mapping at ``keys``; None with its mistakes in ``source``.

    ``data`` replaces that mapping. ``further_keys`` are keys that the mapping in the file may have
    besides those of the dataclass: a message on an unknown key suggests them, too.
    """
    if data is None:
        data = source.value_at(keys)
    if not isinstance(data, dict):
        source.add_problem(keys, f"{shown(data)} is not a mapping")
        return None
    # The reader collects the components that are built, so that an error in them is known as a plugin's.
    reader = _Reader(source=source, keys=keys, parts=[], path=[])
    try:
        with plugin_code(cls, reader.parts):
            try:
                # JSON mode is pydantic's strict mode for plain data: no "3" for 3, but lists for tuples.
                return adapter(cls).validate_json(json.dumps(data), strict=True, context=reader)
            except ValidationError as error:
                source.problems += mistakes_of(error, source, keys, cls, further_keys)
    except PluginError as error:
        source.add_problem(keys, str(error))
    return None


def build_kind(group: Group, source: Source, keys: Keys) -> Any:
    """Build the registered dataclass that the mapping at ``keys`` names by its ``kind``.

    Returns None, with its mistakes in ``source``, if it cannot be built.
    """
    return _build_component(group, source.value_at(keys), source, keys)


def build_exhibits(group: Group, source: Source) -> dict[str, Any]:
    """Build the tables or the figures, as ``group`` says, by name; those with mistakes are left out.

    The source gets the mistakes.
    """
    exhibits = {}
    for name in source.data.get(group) or {}:
        exhibit = build_kind(group, source, (group, name))
        if exhibit is not None:
            exhibits[name] = exhibit
    return exhibits


def _build_component(group: Group, data: object, source: Source, keys: Keys) -> Part | None:
    """Build the component that the mapping ``data`` describes; None with its mistakes in ``source``.

    ``keys`` is the place at which mistakes are reported.
    """
    # Step 1: find the class.
    if not isinstance(data, dict) or "kind" not in data:
        if not any(p.path == dotted(keys) for p in source.problems):  # else it is already reported
            source.add_problem(keys, describe_missing_kind(group, data, source, keys))
        return None
    cls = find_class(group, data["kind"], source, keys)
    if cls is None:
        return None
    # Step 2: complete the keys by the preset, and build.
    values = with_preset(cls, data, source, keys)
    make_paths_absolute(cls, source, keys, values)
    if issubclass(cls, Filter) and cls.runs_program:
        if not is_allowed(source, values):
            source.add_problem((*keys, "command"), PROGRAM_REFUSED)
            return None
        # With the files and environment variables that the config declares for all programs.
        add_declared(source, values)
    further_keys = ["preset"] if cls.presets else []
    if keys[:-1] == ("filters",):  # keys of every filter's entry: see `read_assumed`
        values = {key: value for key, value in values.items() if key not in ENTRY_KEYS}
        further_keys += ENTRY_KEYS
        # A component of the filter model that stands beside `assume` and not in it. A filter's class may
        # have a motion or sensor of its own.
        if isinstance(values.get("start"), dict):
            message = "the prior of one filter is `assume: {start: {kind: ...}}`"
            source.add_key_problem((*keys, "start"), message)
            return None
        for key in ("motion", "sensor"):
            if key in values and key not in hints_of(cls):
                message = f"the {key} that one filter assumes is `assume: {{{key}: {{kind: ...}}}}`"
                source.add_key_problem((*keys, key), message)
                return None
    return build(cls, source, keys, values, further_keys)


class _Reader(NamedTuple):
    """Context of a component's validator: builds the components within its keys."""

    source: Source
    keys: Keys
    parts: list[object]
    """components that are built"""
    path: list[str]
    """keys of the dataclasses between the component and a key, as `assume`"""

    def read(self, group: Group, key: str, value: object, hint: object) -> object:
        """Build the component that a key names, or a tuple of components for a list.

        ``value`` is what the config has under ``key``, and ``hint`` the type of the key. A ``null`` is
        None if the type allows it. Mistakes, such as an empty list, are added to the source. Then an
        error is raised, which the validator collects.
        """
        keys = (*self.keys, *self.path, key)
        if value is None and _allows_type(hint, type(None)):
            return None
        if not isinstance(value, list) or not _allows_type(hint, tuple):
            return self._build_all(group, {keys: value})[0]
        if not value:  # `_build_all` then raises the error
            self.source.add_problem(keys, f"is empty: name at least one of {group}")
        return self._build_all(group, {(*keys, i): item for i, item in enumerate(value)})

    def _build_all(self, group: Group, entries: Mapping[Keys, object]) -> tuple[Part, ...]:
        """Build a component for each entry; ``entries`` are by the keys at which they stand.

        If one has mistakes, they are added to the source, and an error of the type `REPORTED` is raised.
        """
        parts = []
        for keys, entry in entries.items():
            part = self._build_part(group, entry, keys)
            if part is not None:
                parts.append(part)
        # An empty list is a mistake that `read` has added.
        if not parts or len(parts) < len(entries):
            raise PydanticCustomError(REPORTED, "has mistakes")
        # A plugin's sensor must be able to measure the scenario's target. One of the two is built first:
        # so all components that the validator has built so far are checked.
        self.parts.extend(parts)
        check_sensors(self.parts)
        return tuple(parts)

    def _build_part(self, group: Group, value: object, keys: Keys) -> Part | None:
        """Build the component of a mapping; a word is a kind without keys of its own.

        Return None if it has mistakes, which are then in the source.
        """
        if isinstance(value, str):
            value = {"kind": value}
            # The config gets the mapping, too, so that later mistakes find their keys in it.
            if self.source.has(keys):
                mark = self.source.mark(keys)
                put(self.source.value_at(keys[:-1]), keys[-1], marked(value, mark), mark)
        return _build_component(group, value, self.source, keys)


def _allows_type(hint: object, cls: type) -> bool:
    """Test whether a key of the type ``hint`` may hold an instance of the class."""
    return any(cls in (option, get_origin(option)) for option in (hint, *get_args(hint)))
