"""Mistakes in a config, in words and with their positions: unknown keys, values beyond limits."""

from collections.abc import Collection, Sequence
from dataclasses import fields, replace
from typing import Any, get_type_hints

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from trackbench.component_parts import Part
from trackbench.config.did_you_mean import MERGE_KEY, NO_MERGING, unknown
from trackbench.config.file_paths import with_typed_paths
from trackbench.config.value_mistakes import describe_value, shown
from trackbench.errors import Mark, Problem
from trackbench.field_types import (
    DataError,
    InvalidKeyError,
    dataclasses_in,
    key_of,
)
from trackbench.registry import Group, kinds, of_kind
from trackbench.yaml_source import Keys, Source, dotted

REPORTED = "reported"
"""Type of the validator's error for a component whose mistakes are in the source."""


def mistakes_of(
    error: ValidationError, source: Source, keys: Keys, cls: type, further_keys: Sequence[str] = ()
) -> list[Problem]:
    """Locate and describe what the validator of ``cls`` found wrong with the mapping at ``keys``.

    ``further_keys`` are keys that the mapping may have besides those of ``cls``.
    """
    problems: dict[Problem, None] = {}
    for details in error.errors(include_url=False):
        problems |= dict.fromkeys(_problems_of(details, source, keys, cls, further_keys))
    merged = _merge_union_problems(problems)
    # Paths of data files are absolute by now: write them as the user did.
    return [with_typed_paths(problem, source.typed_folders) for problem in merged]


def _merge_union_problems(problems: Collection[Problem]) -> list[Problem]:
    """Merge the problems of one value, of which the validator of a union reports one per type.

    For a list with a mistaken item, the problem that the list is no word is dropped. For a mapping of no
    known kind, the problem that it is no number is dropped.
    """
    merged: dict[tuple[Mark, str, str], Problem] = {}
    for problem in problems:
        # A text on a value's type reads "VALUE is not TYPE". Of any other text all is in ``rest``.
        value, verb, rest = problem.message.rpartition(" is ")
        # Step 1: drop texts on the type of a value whose parts have mistakes.
        has_inner_problems = any(p.path.startswith(f"{problem.path}.") for p in problems)
        if verb and has_inner_problems:
            continue
        # A text on a mapping's type begins with the mapping; that on its kind does not.
        has_problem_of_kind = any(
            p.path == problem.path and not p.message.startswith("{") for p in problems
        )
        if verb and value.startswith("{") and has_problem_of_kind:
            continue
        # Step 2: join "3 is not a word" and "3 is not a list" to one line, with one advice.
        place = (problem.mark, problem.path, value or rest)
        earlier = merged.get(place)
        if earlier is None:
            merged[place] = problem
            continue
        earlier_text, separator, advice = earlier.message.partition("; write ")
        text, other_separator, other_advice = rest.partition("; write ")
        joined_advice = f"{separator}{advice}" or f"{other_separator}{other_advice}"
        merged[place] = replace(earlier, message=f"{earlier_text} and {text}{joined_advice}")
    return list(merged.values())


def _problems_of(
    details: ErrorDetails, source: Source, keys: Keys, cls: type, further_keys: Sequence[str]
) -> list[Problem]:
    """Put one error of the validator into words, with its position in the file.

    ``keys`` is the path to the mapping that was read as ``cls``. ``further_keys`` are keys that the
    mapping may have besides those of ``cls``.
    """
    error_type = details["type"]
    if error_type == REPORTED:  # the source already has the mistakes of this component
        return []
    context = details.get("ctx", {})
    location = details["loc"]
    error = context.get("error")
    if isinstance(error, DataError):  # mistakes in a data file have positions of their own
        return [
            Problem(Mark(p.file, p.line, p.column), dotted(keys), p.message, p.answer)
            for p in error.places
        ]
    # Step 1: find the place. The validator's location also names options of unions, which are no keys.
    steps = location
    if isinstance(error, InvalidKeyError):
        steps = location + error.path
    where = keys
    for step in steps:
        if source.has((*where, step)):
            where = (*where, step)
    # Step 2: a key that the dataclass lacks, or that the mapping lacks: the location ends with it.
    if error_type in ("unexpected_keyword_argument", "extra_forbidden"):
        keys_of_owner = where[len(keys) : -1]  # below the mapping that was read as ``cls``
        owner = _find_dataclass(cls, keys_of_owner, location)
        further_keys_of_owner = further_keys if owner is cls else ()
        message = _describe_unknown_key(str(location[-1]), owner, further_keys_of_owner)
        # A class may have hints, by the key in whose mapping the unknown key stands.
        hints = getattr(cls, "hints_on_unknown_keys", {})
        for key in keys_of_owner:
            if key in hints:
                message = f"{message}; {hints[key]}"
        return [Problem(source.key_mark(where), dotted(where), message)]
    if error_type == "missing" and isinstance(location[-1], int):
        message = (
            f"{shown(details['input'])} has too few values; at least {location[-1] + 1} are needed"
        )
        return [source.problem(where, message)]
    if error_type in ("missing", "missing_argument", "missing_keyword_only_argument"):
        path = dotted((*where, location[-1]))
        return [Problem(source.key_mark(where), path, "this key is required")]
    # Step 3: any other mistake is one in the value.
    message = describe_value(error_type, context, details["input"], details["msg"])
    return [source.problem(where, message)]


def _describe_unknown_key(key: str, owner: type[Any] | None, further_keys: Sequence[str]) -> str:
    """Explain that a key is unknown, and suggest one of the dataclass ``owner`` or of ``further_keys``.

    ``owner`` is None if the dataclass is not known.
    """
    if owner is None:
        return "unknown key"
    if issubclass(owner, Part) and key in owner.unsupported_keys:
        return owner.unsupported_keys[key]
    known_keys = [key_of(field.name) for field in fields(owner)]
    known_keys += further_keys
    if not known_keys:
        return "unknown key"
    return f"unknown key; {unknown(key, known_keys)}"


def _find_dataclass(cls: type, path: Keys, tags: Keys) -> type[Any] | None:
    """Find the dataclass of the mapping at ``path`` below a mapping of ``cls``.

    If a key allows several dataclasses, the one is taken whose kind is in ``tags``, the validator's
    location. Return None if there is no such one.
    """
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


def add_conflicts(source: Source, keys: Keys, conflicts: dict[str, str]) -> None:
    """Add the problems that a component reports by key; an empty key means the component."""
    for key, message in conflicts.items():
        place = (*keys, *key.split(".")) if key else keys
        source.add_problem(place, message)


def describe_missing_kind(group: Group, data: object, source: Source, keys: Keys) -> str:
    """Explain that a component needs a kind, and how to write one.

    ``data`` is the value that the config has at ``keys`` in place of the component.
    """
    message = "needs a kind" if isinstance(data, dict) else "is not a mapping with a kind"
    example = min(kinds(group), key=len)
    message += f", as {{kind: {example}}}; see `trackbench list {group}`"
    if isinstance(data, dict) and MERGE_KEY in data:
        return f"{message}; {NO_MERGING}"
    # A filter's own model, at ("filters", LABEL, "assume", ...), replaces that of the scenario; nothing
    # is inherited.
    scenario_model = ("scenario", "assume", *keys[3:])
    is_filter_model = keys[2:3] == ("assume",)
    if is_filter_model and source.has((*scenario_model, "kind")):
        model = shown(source.value_at(scenario_model))
        message += f"; a filter's own model has all of its keys, those of the scenario are {model}"
    return message


def find_class(group: Group, kind: object, source: Source, keys: Keys) -> type[Part] | None:
    """Find the class of the kind that the component at ``keys`` has.

    Return None, with a problem added to the source, if there is no such kind.
    """
    if isinstance(kind, str):
        cls = of_kind(group, kind)
        if cls is not None:
            return cls
    # The message names all kinds, whose files are imported for it alone.
    known = list(kinds(group))
    if kind is None:
        message = f"has no value; {unknown('', known)}"
    else:
        message = f"{kind!r} is not a kind of {group[:-1]}; {unknown(str(kind), known)}"
    source.add_problem((*keys, "kind"), message)
    return None
