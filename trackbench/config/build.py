"""Build dataclasses and registered components from mappings; report every mistake with its position."""

import json
import os
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import fields, is_dataclass, replace
from difflib import get_close_matches
from functools import cache
from itertools import chain
from math import isinf, isnan
from pathlib import Path
from typing import Any, NamedTuple, TypeVar, cast, get_args, get_origin, get_type_hints

from pydantic import ConfigDict, TypeAdapter, ValidationError
from pydantic_core import ErrorDetails, PydanticCustomError

from trackbench.config.includes import deep_merge
from trackbench.errors import Mark, Problem
from trackbench.extension_points import Part, key_of
from trackbench.field_types import (
    IS_FILE,
    IS_WORD,
    ONE_LINE,
    DataError,
    InvalidKeyError,
    annotations_of,
)
from trackbench.filters.base import Filter
from trackbench.plugins.checks import check_sensors
from trackbench.plugins.errors import PluginError, plugin_code
from trackbench.registry import Group, kinds, of_kind
from trackbench.yaml_source import Keys, Source, dotted, formula, marked, put

ENTRY_KEYS = ("assume", "late")
"""Keys of every filter's entry beside those of its class."""
T = TypeVar("T")
F = TypeVar("F", bound=Callable[..., object])

_TYPES = {
    "int": "a whole number",
    "float": "a number",
    "bool": "true or false",
    "string": "a word",
    "list": "a list",
    "tuple": "a list",
    "dict": "a mapping",
    "dataclass": "a mapping",
    "finite_number": "a finite number",
}
_LIMITS = {
    "greater_than_equal": ("less than", "ge"),
    "greater_than": ("not greater than", "gt"),
    "less_than_equal": ("greater than", "le"),
    "less_than": ("not less than", "lt"),
}
"""Words for a number beyond a limit, and the name of the limit."""


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
    """Name the keys whose values are paths of data files, or words that may be."""

    def is_file(hint: object) -> bool:
        marks = chain.from_iterable(map(annotations_of, (hint, *get_args(hint))))
        return any(mark in (IS_FILE, IS_WORD) for mark in marks)

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
        source.add_problem(keys, f"{_show(data)} is not a mapping")
        return None
    reader = _Reader(source, keys, [])
    try:
        with plugin_code(cls, reader.parts):
            try:
                # JSON mode is pydantic's strict mode for plain data: no "3" for 3, but lists for tuples.
                return adapter(cls).validate_json(json.dumps(data), strict=True, context=reader)
            except ValidationError as error:
                problems: dict[Problem, None] = {}
                for item in error.errors(include_url=False):
                    problems |= dict.fromkeys(_problems(item, source, keys, cls, also))
                source.problems += _without_unions(problems)
    except PluginError as error:
        source.add_problem(keys, str(error))
    return None


def unknown(word: str, known: list[str]) -> str:
    """Suggest ``did you mean ...?``, or list the first 40 known words."""
    alike = [k for k in known if sorted(k.lower()) == sorted(word.lower())]  # efk is ekf, not epf
    near = alike or get_close_matches(word, known, 1, 0.5)
    shown = ", ".join(known[:40]) + (f", {len(known) - 40} more" if len(known) > 40 else "")
    return f"did you mean {near[0]}?" if near else f"known: {shown}"


def _without_unions(problems: Collection[Problem]) -> list[Problem]:
    """Merge the lines on an invalid value, for which the validator of a union has several.

    A mistaken item of a list is reported without the remark that the list is no word, and a mapping of
    no known kind without the remark that it is no number.
    """
    merged: dict[tuple[Mark, str, str], Problem] = {}
    for problem in problems:
        value, verb, rest = problem.what.rpartition(" is ")
        if verb and any(p.path.startswith(f"{problem.path}.") for p in problems):
            continue
        of_kinds = [p for p in problems if p.path == problem.path and not p.what.startswith("{")]
        if verb and value.startswith("{") and of_kinds:
            continue
        before = merged.get(place := (problem.mark, problem.path, value or rest))
        merged[place] = replace(before, what=f"{before.what} and {rest}") if before else problem
    return list(merged.values())


def _problems(
    item: ErrorDetails, source: Source, keys: Keys, cls: type, also: Sequence[str]
) -> list[Problem]:
    kind, ctx, value = item["type"], item.get("ctx", {}), item["input"]
    if kind == _REPORTED:
        return []
    error = ctx.get("error")
    if isinstance(error, DataError):
        return [Problem(Mark(p.file, p.line, p.column), dotted(keys), p.what) for p in error.places]
    # Step 1: where. The validator's location also names options of unions, which are no keys.
    where = keys
    for step in item["loc"] + (error.path if isinstance(error, InvalidKeyError) else ()):
        if source.has((*where, step)):
            where = (*where, step)
    # Step 2: a key that the dataclass lacks, or that the mapping lacks.
    if kind in ("unexpected_keyword_argument", "extra_forbidden"):
        inner = _dataclass_at(cls, where[len(keys) : -1], item["loc"])
        known = [key_of(f.name) for f in fields(inner)] if inner is not None else []
        if inner is cls:
            known += also
        word = str(item["loc"][-1])
        if inner is not None and issubclass(inner, Part) and word in inner.unsupported_keys:
            return [Problem(source.key_mark(where), dotted(where), inner.unsupported_keys[word])]
        what = f"unknown key; {unknown(word, known)}" if known else "unknown key"
        return [Problem(source.key_mark(where), dotted(where), what)]
    if kind in ("missing", "missing_argument", "missing_keyword_only_argument"):
        path = dotted((*where, item["loc"][-1]))
        return [Problem(source.key_mark(where), path, "this key is required")]
    # Step 3: any other mistake is one in the value.
    return [source.problem(where, _describe(kind, ctx, value, item["msg"]))]


def _dataclass_at(cls: type, path: Keys, tags: Keys) -> type[Any] | None:
    """Find the dataclass of a mapping within one of ``cls``, if it is unique or tagged by its kind."""
    for key in path:
        if isinstance(key, int):
            continue
        options = dataclasses_in(get_type_hints(cls).get(key))
        if len(options) > 1:
            options = [option for option in options if getattr(option, "kind", None) in tags]
        if len(options) != 1:
            return None
        cls = options[0]
    return cls


def dataclasses_in(hint: object) -> list[type[Any]]:
    """Find the dataclasses that a value of this type, or an item of it, may be."""
    if isinstance(hint, type) and is_dataclass(hint):
        return [hint]
    return [cls for option in get_args(hint) for cls in dataclasses_in(option)]


def _describe(kind: str, ctx: Mapping[str, object], value: object, message: str) -> str:
    """Describe in words what the validator found wrong with a value."""
    shown = _show(value)
    if kind == "value_error":
        return str(ctx["error"])
    if kind == "json_invalid":
        return "the name of a folder it lies in is not UTF-8, and no config could hold it"
    if isinstance(value, float) and (
        isnan(value) or (isinf(value) and kind in ("less_than", "greater_than"))
    ):
        return f"{'NaN' if isnan(value) else shown} is not a finite number"
    # Numbers beyond a limit, words that are not in a list, texts that do not match.
    if kind in _LIMITS:
        words, limit = _LIMITS[kind]
        return f"{shown} is {words} {_show(ctx[limit])}"
    if kind == "literal_error":
        return f"{shown} is not one of {_unquoted(ctx['expected'])}"
    if kind == "union_tag_invalid":
        return f"{ctx['tag']!r} is not one of {_unquoted(ctx['expected_tags'])}"
    if kind == "union_tag_not_found":
        return f"needs a {_unquoted(ctx['discriminator'])}"
    if kind == "string_pattern_mismatch" and ctx["pattern"] == ONE_LINE:
        return formula(str(value)) or f"{shown} is not one line of visible characters"
    if kind == "string_pattern_mismatch":
        return f"{shown} must start with a letter or digit and hold only letters, digits, . _ -"
    # A value of another type.
    name = kind.removesuffix("_type").removesuffix("_parsing").removesuffix("_from_float")
    return f"{shown} is not {_TYPES[name]}" if name in _TYPES else message.lower()


def _unquoted(words: object) -> str:
    return str(words).replace("'", "")


def _show(value: object) -> str:
    if isinstance(value, float) and value.is_integer():
        return f"{value:g}"
    text = json.dumps(value) if not isinstance(value, str) else repr(value)
    return text if len(text) < 60 else text[:57] + "..."


def build_kind(group: Group, source: Source, keys: Keys) -> Any:
    """Build the registered dataclass that the mapping at ``keys`` asks for by its ``kind``."""
    return _component(group, source.at(keys), source, keys)


def _component(group: Group, data: object, source: Source, keys: Keys) -> Part | None:
    # Step 1: find the class.
    if not isinstance(data, dict) or "kind" not in data:
        needs = "needs a kind" if isinstance(data, dict) else "is not a mapping with a kind"
        needs += f", as {{kind: {min(kinds(group), key=len)}}}; see `trackbench list {group}`"
        if not any(p.path == dotted(keys) for p in source.problems):  # else it has been said
            source.add_problem(keys, needs)
        return None
    kind = data["kind"]
    cls = of_kind(group, kind) if isinstance(kind, str) else None
    if cls is None:
        what = f"{kind!r} is not a kind of {group[:-1]}; {unknown(str(kind), list(kinds(group)))}"
        source.add_problem((*keys, "kind"), what)
        return None
    # Step 2: complete the keys by the preset, and build.
    values = _with_preset(cls, data, source, keys)
    _make_paths_absolute(cls, source, keys, values)
    if issubclass(cls, Filter) and cls.runs_program and not _is_allowed(source, values):
        source.add_problem((*keys, "command"), "a program is run only with --allow-plugins")
        return None
    also = ["preset"] if cls.presets else []
    if keys[:-1] == ("filters",):  # keys of every filter's entry: see `read_assumed`
        values = {key: value for key, value in values.items() if key not in ENTRY_KEYS}
        also += ENTRY_KEYS
        if isinstance(values.get("start"), dict):
            what = "the prior of one filter is `assume: {start: {kind: ...}}`"
            source.add_key_problem((*keys, "start"), what)
            return None
    return build(cls, source, keys, values, also)


def _is_allowed(source: Source, values: Mapping[str, object]) -> bool:
    words = values.get("command")  # one that is no list cannot be run, and is reported
    if source.programs is None or not (isinstance(words, list) and words):
        return True
    return len(words) == 1 and words[0] in [*source.programs]


_REPORTED = "reported"
"""Type of the validator's error for a component whose mistakes are in the source."""


class _Reader(NamedTuple):
    """Context of a component's validator: builds the components that the keys of it hold."""

    source: Source
    keys: Keys
    parts: list[object]
    """components that it has built"""

    def read(self, group: Group, key: str, value: object, hint: object) -> object:
        """Build what the key holds: a component, several, or None where its type allows these."""
        keys = (*self.keys, key)
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
            raise PydanticCustomError(_REPORTED, "has mistakes")
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
        words = IS_WORD in chain.from_iterable(map(annotations_of, get_args(hints_of(cls)[key])))

        def absolute(path: object, folder: Path = folder, words: bool = words) -> object:
            if not isinstance(path, str) or (words and not os.path.isfile(folder / path)):
                return path
            return str((folder / path).absolute())

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
