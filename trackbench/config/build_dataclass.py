"""A mapping into a frozen dataclass, with every mistake said in words and with its position."""

import json
from collections.abc import Collection, Sequence
from dataclasses import fields, is_dataclass, replace
from difflib import get_close_matches
from functools import cache
from math import isinf, isnan
from typing import Any, TypeVar, cast, get_args, get_type_hints

from pydantic import ConfigDict, TypeAdapter, ValidationError
from pydantic_core import ErrorDetails

from trackbench.errors import Mark, Problem
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


def help_texts(cls: type) -> dict[str, str]:
    """Return the meaning of each key: the docstring under the field, in the class or a base."""
    texts: dict[str, str] = {}
    for base in reversed(cls.__mro__):
        if is_dataclass(base):
            keys = described(base).json_schema().get("properties", {})
            texts |= {k: v["description"] for k, v in keys.items() if "description" in v}
    return texts


def hints_of(cls: type) -> dict[str, Any]:
    """Return the types of a dataclass's keys, with what they are annotated with."""
    return _hints(cast(Any, cls))


def file_keys(cls: type) -> frozenset[str]:
    """Return keys of a dataclass that are paths of data files."""
    return _file_keys(cast(Any, cls))


def _is_file(hint: object) -> bool:
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
    cls: type[T],
    source: Source,
    keys: Keys,
    data: object = None,
    parts: Sequence[object] = (),
    also: Sequence[str] = (),
) -> T | None:
    """Return the dataclass from the mapping at ``keys``, or None, with its mistakes in ``source``.

    ``data`` replaces that mapping: a number stands in it for each of the prebuilt ``parts``, which are
    None where they have mistakes. ``also`` names keys that stand beside those of the dataclass.
    """
    data = source.at(keys) if data is None else data
    if not isinstance(data, dict):
        source.add_problem(keys, f"{_show(data)} is not a mapping")
        return None
    try:
        # JSON mode is pydantic's strict mode for plain data: no "3" for 3, but lists for tuples.
        return adapter(cls).validate_json(json.dumps(data), strict=True, context=parts)
    except (AttributeError, TypeError):
        if None in parts:  # the mistakes of that part are reported
            return None
        raise
    except ValidationError as error:
        problems: dict[Problem, None] = {}
        for item in error.errors(include_url=False):
            if None in parts and item["type"] == "value_error":  # perhaps for lack of that part
                continue
            problems |= dict.fromkeys(_problems(item, source, keys, cls, also))
        source.problems += _without_unions(problems)
        return None


def unknown(word: str, known: list[str]) -> str:
    """Return ``did you mean ...?``, or all there is."""
    near = get_close_matches(word, known, 1, 0.5) or [k for k in known if k.lower() == word.lower()]
    return f"did you mean {near[0]}?" if near else f"known: {', '.join(known)}"


def _without_unions(problems: Collection[Problem]) -> list[Problem]:
    """Return one line for an invalid value, for which the validator of a union has several.

    A mistaken item of a list is reported without the remark that the list is no word.
    """
    merged: dict[tuple[Mark, str, str], Problem] = {}
    for problem in problems:
        value, verb, rest = problem.what.rpartition(" is ")
        if verb and any(p.path.startswith(f"{problem.path}.") for p in problems):
            continue
        place = problem.mark, problem.path, value or rest
        before = merged.get(place)
        merged[place] = replace(before, what=f"{before.what} and {rest}") if before else problem
    return list(merged.values())


def _problems(
    item: ErrorDetails, source: Source, keys: Keys, cls: type, also: Sequence[str]
) -> list[Problem]:
    kind, ctx, value = item["type"], item.get("ctx", {}), item["input"]
    error = ctx.get("error")
    if isinstance(error, DataError):
        return [Problem(Mark(p.file, p.line, p.column), dotted(keys), p.what) for p in error.places]
    # The validator's location names options of unions, too, which are no keys of the config.
    where = keys
    for step in item["loc"] + (error.path if isinstance(error, InvalidKeyError) else ()):
        if source.has((*where, step)):
            where = (*where, step)
    if kind in ("unexpected_keyword_argument", "extra_forbidden"):
        inner = _dataclass_at(cls, where[len(keys) : -1])
        known = [f.name for f in fields(inner)] if inner is not None else []
        if inner is cls:
            known += also
        what = f"unknown key; {unknown(str(item['loc'][-1]), known)}" if known else "unknown key"
        return [Problem(source.key_mark(where), dotted(where), what)]
    if kind in ("missing", "missing_argument", "missing_keyword_only_argument"):
        path = dotted((*keys, *item["loc"]))
        return [Problem(source.key_mark(where), path, "this key is required")]
    return [source.problem(where, _describe(kind, ctx, value, item["msg"]))]


def _dataclass_at(cls: Any, path: Keys) -> Any:
    """Return the dataclass of a mapping within one of ``cls``, if it is unique."""
    for key in path:
        if isinstance(key, int):
            continue
        options = dataclasses_in(get_type_hints(cls).get(key))
        if len(options) != 1:
            return None
        cls = options[0]
    return cls


def dataclasses_in(hint: object) -> list[type[Any]]:
    """Return the dataclasses that a value of this type, or an item of it, may be."""
    if isinstance(hint, type) and is_dataclass(hint):
        return [hint]
    return [cls for option in get_args(hint) for cls in dataclasses_in(option)]


def _describe(kind: str, ctx: dict[str, Any], value: object, message: str) -> str:
    """Return in words what the validator found wrong with a value."""
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


def _show(value: object) -> str:
    if isinstance(value, float) and value.is_integer():
        return f"{value:g}"
    text = json.dumps(value) if not isinstance(value, str) else repr(value)
    return text if len(text) < 60 else text[:57] + "..."
