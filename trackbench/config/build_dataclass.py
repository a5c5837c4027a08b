"""A mapping into a frozen dataclass, with every mistake said in words and with its position."""

import json
from collections.abc import Collection, Sequence
from dataclasses import fields, is_dataclass, replace
from difflib import get_close_matches
from functools import cache
from math import isinf, isnan
from typing import Any, TypeVar, cast, get_args, get_type_hints

from pydantic import ConfigDict, TypeAdapter, ValidationError

from trackbench.errors import Mark, Problem
from trackbench.extension_points import Part
from trackbench.field_types import IS_FILE, ONE_LINE, DataError, InvalidKeyError
from trackbench.yaml_source import Keys, Source, dotted, formula

T = TypeVar("T")

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
"""What is said of a number beyond a limit, and the limit's name."""


def adapter(cls: type[T]) -> TypeAdapter[T]:
    """Return the strict validator of a dataclass: unknown keys are mistakes."""
    return _adapter(cast(Any, cls), described=False)


def described(cls: type[T]) -> TypeAdapter[T]:
    """Return the class with attribute docstrings for its JSON schema, which takes time."""
    return _adapter(cast(Any, cls), described=True)


def help_texts(cls: type[Any]) -> dict[str, str]:
    """Return the meaning of each key: the docstring under the field, in the class or a base."""
    texts: dict[str, str] = {}
    for base in reversed(cls.__mro__):
        if is_dataclass(base):
            keys = described(base).json_schema().get("properties", {})
            texts |= {k: v["description"] for k, v in keys.items() if "description" in v}
    return texts


def hints_of(cls: type[Any]) -> dict[str, Any]:
    """Return the types of a dataclass's keys, with what they are annotated with."""
    return _hints(cast(Any, cls))


def file_keys(cls: type[Any]) -> frozenset[str]:
    """Return keys of a dataclass that are paths of data files."""
    return _file_keys(cast(Any, cls))


def _is_file(hint: Any) -> bool:
    options = (hint, *get_args(hint))
    return any(IS_FILE in getattr(option, "__metadata__", ()) for option in options)


@cache
def _file_keys(cls: Any) -> frozenset[str]:
    return frozenset(name for name, hint in _hints(cls).items() if _is_file(hint))


@cache
def _hints(cls: Any) -> dict[str, Any]:
    return get_type_hints(cls, include_extras=True)


@cache
def _adapter(cls: Any, described: bool) -> TypeAdapter[Any]:
    _configure(cls, ConfigDict(extra="forbid", use_attribute_docstrings=described), set())
    return TypeAdapter(cls)


def _configure(hint: Any, config: ConfigDict, done: set[type]) -> None:
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
    cls: type[T], source: Source, keys: Keys, parts: Sequence[Any] = (), also: Sequence[str] = ()
) -> T | None:
    """Return the dataclass from the mapping at ``keys``, or None, with the reasons noted in ``source``.

    A number stands in the mapping for each of the ``parts`` made before, None for one with mistakes.
    ``also`` names keys that stand beside the dataclass's own.
    """
    data = at(source, keys)
    if not isinstance(data, dict):
        source.add_problem(keys, f"{_show(data)} is not a mapping")
        return None
    try:
        # JSON mode is pydantic's strict mode for plain data: no "3" for 3, but lists for tuples.
        return adapter(cls).validate_json(json.dumps(data), strict=True, context=parts)
    except (AttributeError, TypeError):
        if None in parts:  # what is missing has been said
            return None
        raise
    except ValidationError as error:
        found: dict[Problem, None] = {}
        for item in error.errors(include_url=False):
            if None in parts and item["type"] == "value_error":  # what is said without a part
                continue
            found |= dict.fromkeys(_problems(item, source, keys, cls, also))
        source.problems += _of_unions(found)
        return None


def at(source: Source, keys: Keys) -> Any:
    """Return the value at ``keys``."""
    data = source.data
    for key in keys:
        data = data[key]
    return data


def unknown(word: str, known: list[str]) -> str:
    """Return ``did you mean ...?``, or all there is."""
    near = get_close_matches(word, known, 1, 0.5) or [k for k in known if k.lower() == word.lower()]
    return f"did you mean {near[0]}?" if near else f"known: {', '.join(known)}"


def _of_unions(found: Collection[Problem]) -> list[Problem]:
    """Return one line for an invalid value, from the validator's several.

    Nor is a list said to be no word where its items are mistaken.
    """
    merged: dict[tuple[Mark, str, str], Problem] = {}
    for problem in found:
        value, verb, rest = problem.what.rpartition(" is ")
        if verb and any(p.path.startswith(f"{problem.path}.") for p in found):
            continue
        place = problem.mark, problem.path, value or rest
        before = merged.get(place)
        merged[place] = replace(before, what=f"{before.what} and {rest}") if before else problem
    return list(merged.values())


def _problems(
    item: Any, source: Source, keys: Keys, cls: type[Any], also: Sequence[str]
) -> list[Problem]:
    raised = item.get("ctx", {}).get("error")
    if isinstance(raised, DataError):
        return [Problem(Mark(p.file, p.line, p.column), "", p.what) for p in raised.places]
    return [_problem(item, source, keys, cls, also)]


def _problem(item: Any, source: Source, keys: Keys, cls: type[Any], also: Sequence[str]) -> Problem:
    kind, ctx, value = item["type"], item.get("ctx", {}), item["input"]
    error = ctx.get("error")
    within = error.path if isinstance(error, InvalidKeyError) else ()
    where = _existing(source, keys, item["loc"] + within)
    if kind in ("unexpected_keyword_argument", "extra_forbidden"):
        inner = _within(cls, where[len(keys) : -1])
        known = [f.name for f in fields(inner)] if inner is not None else []
        if inner is cls:
            known += also
        word = str(item["loc"][-1])
        renamed = inner.renamed_keys if inner is not None and issubclass(inner, Part) else {}
        if word in renamed:
            what = f"`{word}` is now `{renamed[word]}`"
            return Problem(source.key_mark(where), dotted(where[:-1]), what)
        what = f"unknown key; {unknown(word, known)}" if known else "unknown key"
        return Problem(source.key_mark(where), dotted(where), what)
    if kind in ("missing", "missing_argument", "missing_keyword_only_argument"):
        path = dotted((*keys, *item["loc"]))
        return Problem(source.key_mark(where), path, "this key is required")
    return source.problem(where, _words(kind, ctx, value, item["msg"]))


def _within(cls: type[Any], path: Keys) -> type[Any] | None:
    """Return the dataclass of a mapping within one of ``cls``, if it is unique."""
    found: type[Any] = cls
    for key in path:
        if isinstance(key, int):
            continue
        inner = dataclasses_in(get_type_hints(found).get(key))
        if len(inner) != 1:
            return None
        found = inner[0]
    return found


def dataclasses_in(hint: Any) -> list[type[Any]]:
    """Return the dataclasses that a value of this type, or an item of it, may be."""
    if isinstance(hint, type) and is_dataclass(hint):
        return [hint]
    return [cls for option in get_args(hint) for cls in dataclasses_in(option)]


def _words(kind: str, ctx: dict[str, Any], value: Any, message: str) -> str:
    shown = _show(value)
    if kind == "value_error":
        return str(ctx["error"])
    if kind == "json_invalid":
        return "the name of a folder it lies in is not UTF-8, and no config could hold it"
    if isinstance(value, float) and isnan(value):
        return "NaN is not a finite number"
    if kind in ("less_than", "greater_than") and isinstance(value, float) and isinf(value):
        return f"{shown} is not a finite number"
    if kind in _LIMITS:
        words, limit = _LIMITS[kind]
        return f"{shown} is {words} {_show(ctx[limit])}"
    if kind == "literal_error":
        return f"{shown} is not one of {ctx['expected'].replace(chr(39), '')}"
    if kind == "union_tag_invalid":
        return f"{ctx['tag']!r} is not one of {ctx['expected_tags'].replace(chr(39), '')}"
    if kind == "union_tag_not_found":
        return f"needs a {ctx['discriminator'].strip(chr(39))}"
    if kind == "string_pattern_mismatch" and ctx["pattern"] == ONE_LINE:
        return formula(str(value)) or f"{shown} is not one line of visible characters"
    if kind == "string_pattern_mismatch":
        return f"{shown} must start with a letter or digit and hold only letters, digits, . _ -"
    name = kind.removesuffix("_type").removesuffix("_parsing").removesuffix("_from_float")
    return f"{shown} is not {_TYPES[name]}" if name in _TYPES else message.lower()


def _existing(source: Source, keys: Keys, loc: tuple[str | int, ...]) -> Keys:
    """Return the part of a validator's location that exists in the config."""
    found = keys
    for step in loc:
        if (*found, step) in source.marks:
            found = (*found, step)
    return found


def _show(value: Any) -> str:
    if isinstance(value, float) and value.is_integer():
        return f"{value:g}"
    text = json.dumps(value) if not isinstance(value, str) else repr(value)
    return text if len(text) < 60 else text[:57] + "..."
