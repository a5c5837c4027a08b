"""Build dataclasses and registered components from mappings; report every mistake with its position."""

import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import is_dataclass
from functools import cache
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple, TypeVar, cast, get_args, get_origin, get_type_hints

from pydantic import ConfigDict, TypeAdapter, ValidationError
from pydantic_core import PydanticCustomError

from trackbench.config.includes import deep_merge
from trackbench.config.mistakes import REPORTED, mistakes_of, shown, unknown
from trackbench.extension_points import Part, key_of
from trackbench.field_types import IS_FILE, IS_VARIABLE, IS_WORD, annotations_of
from trackbench.filters.base import Filter
from trackbench.plugins.checks import check_sensors
from trackbench.plugins.errors import PluginError, plugin_code
from trackbench.registry import Group, kinds, of_kind
from trackbench.yaml_source import Keys, Source, dotted, marked, put

ENTRY_KEYS = ("assume", "late")
"""Keys of every filter's entry beside those of its class."""
T = TypeVar("T")
F = TypeVar("F", bound=Callable[..., object])


def _cached(function: F) -> F:
    """Cache a function of classes; mypy takes a class with type arguments for unhashable."""
    return cast(F, cache(function))


@_cached
def adapter(cls: type[T], documented: bool = False) -> TypeAdapter[T]:
    """Build the strict validator of a dataclass: unknown keys are mistakes.

    ``documented`` adds the docstrings of attributes to its JSON schema, which takes time.
    """
    config = ConfigDict(
        extra="forbid",
        use_attribute_docstrings=documented,
        alias_generator=key_of,
        populate_by_name=True,
    )
    _configure(cls, config, set())
    return TypeAdapter(cls)


def help_texts(cls: type) -> dict[str, str]:
    """Look up the meaning of each key: the docstring under the field, in the class or a base."""
    texts: dict[str, str] = {}
    for base in filter(is_dataclass, reversed(cls.__mro__)):
        keys = adapter(base, documented=True).json_schema().get("properties", {})
        texts |= {k: v["description"] for k, v in keys.items() if "description" in v}
    return texts


@_cached
def hints_of(cls: type) -> dict[str, object]:
    """Look up the types of a dataclass's keys, with what they are annotated with."""
    return get_type_hints(cls, include_extras=True)


@_cached
def file_keys(cls: type) -> frozenset[str]:
    """Name the keys whose values are paths of data files, words that may be, or variables."""

    def is_file(hint: object) -> bool:
        marks = chain.from_iterable(map(annotations_of, (hint, *get_args(hint))))
        return any(mark in (IS_FILE, IS_WORD, IS_VARIABLE) for mark in marks)

    return frozenset(name for name, hint in hints_of(cls).items() if is_file(hint))


def _configure(hint: object, config: ConfigDict, done: set[type]) -> None:
    """Make a dataclass, and every dataclass within it, strict and documented.

    Set here and not on each class, so that a filter stays a plain dataclass.
    """
    if isinstance(hint, type) and is_dataclass(hint) and hint not in done:
        done.add(hint)
        setattr(hint, "__pydantic_config__", config)  # noqa: B010
        for inner in get_type_hints(hint, include_extras=True).values():
            _configure(inner, config, done)
    for inner in get_args(hint):
        _configure(inner, config, done)


def build(
    cls: type[T], source: Source, keys: Keys, data: object = None, also: Sequence[str] = ()
) -> T | None:
    """Build the dataclass from the mapping at ``keys``; None with its mistakes in ``source``.

    ``data`` replaces that mapping. ``also`` names keys that stand beside those of the dataclass.
    """
    data = source.at(keys) if data is None else data
    if not isinstance(data, dict):
        source.add_problem(keys, f"{shown(data)} is not a mapping")
        return None
    reader = _Reader(source, keys, [], [])
    try:
        with plugin_code(cls, reader.parts):
            try:
                # JSON mode is pydantic's strict mode for plain data: no "3" for 3, but lists for tuples.
                return adapter(cls).validate_json(json.dumps(data), strict=True, context=reader)
            except ValidationError as error:
                source.problems += mistakes_of(error, source, keys, cls, also)
    except PluginError as error:
        source.add_problem(keys, str(error))
    return None


def build_kind(group: Group, source: Source, keys: Keys) -> Any:
    """Build the registered dataclass that the mapping at ``keys`` asks for by its ``kind``."""
    return _component(group, source.at(keys), source, keys)


def _component(group: Group, data: object, source: Source, keys: Keys) -> Part | None:
    # Step 1: find the class.
    if not isinstance(data, dict) or "kind" not in data:
        needs = "needs a kind" if isinstance(data, dict) else "is not a mapping with a kind"
        needs += f", as {{kind: {min(kinds(group), key=len)}}}; see `trackbench list {group}`"
        of_scenario = ("scenario", "assume", *keys[3:])
        if keys[2:3] == ("assume",) and source.has((*of_scenario, "kind")):
            model = shown(source.at(of_scenario))
            needs += (
                f"; a filter's own model has all of its keys, those of the scenario are {model}"
            )
        if not any(p.path == dotted(keys) for p in source.problems):  # else it has been said
            source.add_problem(keys, needs)
        return None
    kind = data["kind"]
    if kind is None:
        what = f"has no value; {unknown('', list(kinds(group)))}"
        source.add_problem((*keys, "kind"), what)
        return None
    cls = of_kind(group, kind) if isinstance(kind, str) else None
    if cls is None:
        what = f"{kind!r} is not a kind of {group[:-1]}; {unknown(str(kind), list(kinds(group)))}"
        source.add_problem((*keys, "kind"), what)
        return None
    # Step 2: complete the keys by the preset, and build.
    values = _with_preset(cls, data, source, keys)
    _make_paths_absolute(cls, source, keys, values)
    if issubclass(cls, Filter) and cls.runs_program:
        if not _is_allowed(source, values):
            source.add_problem((*keys, "command"), "a program is run only with --allow-plugins")
            return None
        _add_declared(source, values)
    also = ["preset"] if cls.presets else []
    if keys[:-1] == ("filters",):  # keys of every filter's entry: see `read_assumed`
        values = {key: value for key, value in values.items() if key not in ENTRY_KEYS}
        also += ENTRY_KEYS
        if isinstance(values.get("start"), dict):
            what = "the prior of one filter is `assume: {start: {kind: ...}}`"
            source.add_key_problem((*keys, "start"), what)
            return None
        for key in ("motion", "sensor"):
            if key in values and key not in hints_of(cls):
                what = f"the {key} that one filter assumes is `assume: {{{key}: {{kind: ...}}}}`"
                source.add_key_problem((*keys, key), what)
                return None
    return build(cls, source, keys, values, also)


def _add_declared(source: Source, values: dict[str, object]) -> None:
    """Add the files and variables that the config declares for all of its programs."""
    for key in ("files", "environment"):
        declared = source.data.get(key)
        own = values.get(key, [])
        if not isinstance(declared, list) or not isinstance(own, list):
            continue  # said by the validation of the whole
        words = [word for word in declared if isinstance(word, str)]
        if key == "files":
            mark = source.mark((key,))
            folder = Path(mark.file).parent if mark.line else Path()
            words = [str((folder / word).absolute()) for word in words]
        if words:
            values[key] = [*own, *(word for word in words if word not in own)]


def _is_allowed(source: Source, values: Mapping[str, object]) -> bool:
    words = values.get("command")  # one that is no list cannot be run, and is reported
    if source.programs is None or not (isinstance(words, list) and words):
        return True
    return len(words) == 1 and words[0] in [*source.programs]


class _Reader(NamedTuple):
    """Context of a component's validator: builds the components that the keys of it hold."""

    source: Source
    keys: Keys
    parts: list[object]
    """components that it has built"""
    path: list[str]
    """keys of the dataclasses between the component and a key, as `assume`"""

    def read(self, group: Group, key: str, value: object, hint: object) -> object:
        """Build what the key holds: a component, several, or None where its type allows these."""
        keys = (*self.keys, *self.path, key)
        if value is None and _may_be(hint, type(None)):
            return None
        if not isinstance(value, list) or not _may_be(hint, tuple):
            return self._components(group, {keys: value})[0]
        if not value:
            self.source.add_problem(keys, f"is empty: name at least one of {group}")
        return self._components(group, {(*keys, i): item for i, item in enumerate(value)})

    def _components(self, group: Group, entries: Mapping[Keys, object]) -> tuple[Part, ...]:
        """Build a component for each entry, or raise if the source has mistakes of one."""
        built = [self._part(group, entry, keys) for keys, entry in entries.items()]
        parts = [part for part in built if part is not None]
        if not parts or len(parts) < len(entries):
            raise PydanticCustomError(REPORTED, "has mistakes")
        self.parts.extend(parts)
        check_sensors(self.parts)
        return tuple(parts)

    def _part(self, group: Group, value: object, keys: Keys) -> Part | None:
        """Build the component of a mapping; a word is a kind without keys of its own."""
        if isinstance(value, str):
            value = {"kind": value}
            if self.source.has(keys):
                mark = self.source.mark(keys)
                put(self.source.at(keys[:-1]), keys[-1], marked(value, mark), mark)
        return _component(group, value, self.source, keys)


def _may_be(hint: object, cls: type) -> bool:
    """Test whether a key of this type may hold an instance of the class."""
    return any(cls in (option, get_origin(option)) for option in (hint, *get_args(hint)))


def _make_paths_absolute(cls: type, source: Source, keys: Keys, values: dict[str, object]) -> None:
    """Count the paths of data files from the folder of the YAML file that names them."""
    for key in file_keys(cls) & values.keys():
        mark, paths = source.mark((*keys, key)), values[key]
        folder = Path(mark.file).parent if mark.line else Path()
        marks = {*chain.from_iterable(map(annotations_of, get_args(hints_of(cls)[key])))}
        if IS_VARIABLE in marks:
            continue
        words = IS_WORD in marks

        def absolute(path: object, folder: Path = folder, words: bool = words) -> object:
            if not isinstance(path, str):
                return path
            if not words or os.path.isfile(folder / path):
                return str((folder / path).absolute())
            # A word as --table=file.csv
            name, equals, value = path.partition("=")
            if value and os.path.isfile(folder / value):
                return f"{name}{equals}{(folder / value).absolute()}"
            return path

        values[key] = [*map(absolute, paths)] if isinstance(paths, list) else absolute(paths)


def _with_preset(
    cls: type[Part], entry: Mapping[str, object], source: Source, keys: Keys
) -> dict[str, object]:
    """Put the values of a component's keys over those of its preset."""
    presets, data = cls.presets, {k: v for k, v in entry.items() if k != "kind"}
    name = data.pop("preset", None) if presets else None
    if name is None:
        return data
    where = (*keys, "preset")
    if not isinstance(name, str) or name not in presets:
        other = unknown(str(name), list(presets))
        source.add_problem(where, f"{name!r} is not a preset of {cls.kind}; {other}")
        return data
    if any(presets.values()) and all(deep_merge(p, data) == data for p in presets.values()):
        what = f"no preset of {cls.kind} changes anything: all that they set is given"
        source.add_problem(where, what)
    return deep_merge(presets[name], data)
