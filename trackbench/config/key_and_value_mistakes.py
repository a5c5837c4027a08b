"""Mistakes in a config, in words and with their positions: unknown keys, wrong values, no such kind."""

import json
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import fields, replace
from math import isinf, isnan
from typing import Any, get_type_hints

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from trackbench.component_parts import Part
from trackbench.config.did_you_mean import MERGE_KEY, NO_MERGING, unknown
from trackbench.config.file_paths import with_typed_paths
from trackbench.errors import Mark, Problem
from trackbench.field_types import (
    LEGEND_LABEL,
    ONE_LINE,
    DataError,
    InvalidKeyError,
    dataclasses_in,
    key_of,
)
from trackbench.registry import Group, kinds, of_kind
from trackbench.unsafe_characters import explain_formula
from trackbench.yaml_scalars import scalar
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
        if _is_key_of_assumed_motion(source, where):
            path = dotted((*_ASSUMED_MOTION, where[-1]))
            message = f"unknown key; {where[-1]} is a key of the motion that filters assume: {path}"
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


_ASSUMED_MOTION = ("scenario", "assume", "motion")


def _is_key_of_assumed_motion(source: Source, where: Keys) -> bool:
    """Test whether a filter's unknown key at ``where`` is one of the motion that filters assume."""
    is_key_of_filter = where[:1] == ("filters",) and len(where) == 3
    return is_key_of_filter and source.has((*_ASSUMED_MOTION, where[-1]))


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
    # A filter's own model, at ("filters", LABEL, "assume", ...), replaces that of the scenario; nothing
    # is inherited.
    scenario_model = ("scenario", "assume", *keys[3:])
    replaces_model = keys[2:3] == ("assume",) and source.has((*scenario_model, "kind"))
    example = min(kinds(group), key=len)
    if replaces_model:
        example = source.value_at((*scenario_model, "kind"))
    message = "needs a kind" if isinstance(data, dict) else "is not a mapping with a kind"
    message += f", as {{kind: {example}}}; see `trackbench list {group}`"
    if isinstance(data, dict) and MERGE_KEY in data:
        return f"{message}; {NO_MERGING}"
    if replaces_model:
        model = shown(source.value_at(scenario_model))
        message += f"; a filter's own model has all of its keys, those of the scenario are {model}"
        # `--grid filters.EKF.assume.motion.q=...` may mean the model of all filters.
        keys_of_both = []
        if isinstance(data, dict):
            keys_of_both = [key for key in data if source.has((*scenario_model, key))]
        if keys_of_both:
            paths = " and ".join(dotted((*scenario_model, key)) for key in keys_of_both)
            message += f"; for the model of all filters change {paths}"
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
        message = f"{kind!r} {_NO_KIND} {group[:-1]}; {unknown(str(kind), known)}"
    source.add_problem((*keys, "kind"), message)
    return None


_NO_KIND = "is not a kind of"


def is_unknown_kind(problem: Problem) -> bool:
    """Test whether a mistake is a kind that `find_class` does not find."""
    return problem.path.endswith(".kind") and f" {_NO_KIND} " in problem.message


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


def describe_value(
    error_type: str, context: Mapping[str, object], value: object, message: str
) -> str:
    """Describe in words the mistake that the validator found in a value.

    ``error_type`` and ``message`` are those of the validator. ``context`` has the limits and names that
    belong to the type.
    """
    text = shown(value)
    if error_type == "value_error":
        return str(context["error"])
    # The JSON is that of the function `build`, which is valid but for a path with other bytes than
    # UTF-8.
    if error_type == "json_invalid":
        return "the name of a folder it lies in is not UTF-8, and no config could hold it"
    if isinstance(value, float) and isnan(value):
        return "NaN is not a finite number"
    # The type of a finite number is an interval from -inf to inf without its ends.
    if isinstance(value, float) and isinf(value) and error_type in ("less_than", "greater_than"):
        return f"{text} is not a finite number"
    # Numbers beyond a limit, words that are not in a list, texts that do not match. `_LIMITS` has the
    # words for a limit, and its key in the context.
    if error_type in _LIMITS:
        words, limit = _LIMITS[error_type]
        return f"{text} is {words} {shown(context[limit])}"
    if error_type == "literal_error":
        return f"{text} is not one of {_without_quotes(context['expected'])}"
    if error_type == "union_tag_invalid":
        return f"{context['tag']!r} is not one of {_without_quotes(context['expected_tags'])}"
    if error_type == "union_tag_not_found":
        return f"needs a {_without_quotes(context['discriminator'])}"
    if error_type == "string_pattern_mismatch" and context["pattern"] in (ONE_LINE, LEGEND_LABEL):
        if str(value).startswith("_"):
            return f"{text} begins with _, and legends leave such a label out; begin with a letter"
        return explain_formula(str(value)) or f"{text} is not one line of visible characters"
    if error_type == "string_pattern_mismatch":
        return f"{text} must start with a letter or digit and hold only letters, digits, . _ -"
    if error_type in ("too_long", "too_short"):
        limit_text = ""
        if "max_length" in context:
            limit_text = f"at most {context['max_length']} are allowed"
        elif "min_length" in context:
            limit_text = f"at least {context['min_length']} are needed"
        return f"{text} has {context['actual_length']} values; {limit_text}"
    # A value of another type.
    type_name = (
        error_type.removesuffix("_type").removesuffix("_parsing").removesuffix("_from_float")
    )
    if type_name not in _TYPES:
        return message.lower()
    return f"{text} is not {_TYPES[type_name]}{_advise_spelling(type_name, value)}"


def _advise_spelling(type_name: str, value: object) -> str:
    """Advise how to write a value that has the form of another type; empty without advice.

    ``type_name`` is the validator's name of the type that the key needs.
    """
    if value is None:  # as after `title:` and `--set title=`
        if type_name == "string":
            return '; write a word, or "" for an empty one (in a shell \'KEY=""\')'
        return "; write a value"
    if type_name in ("list", "tuple") and isinstance(value, str) and "\n" not in value:
        return f"; write [{value}]"
    if type_name == "bool" and isinstance(value, str) and value.lower() in _BOOLEANS:
        return f"; write {_BOOLEANS[value.lower()]}"
    if type_name == "int" and isinstance(value, float) and value.is_integer():
        return f"; write {int(value)} without a point or an exponent"
    if type_name not in ("int", "float", "finite_number") or not isinstance(value, str):
        return ""
    # A number in the form of a word.
    written = value.strip()
    if isinstance(scalar(written), int | float) and not isinstance(scalar(written), bool):
        return f"; write {written} without quotation marks"
    # 10_000
    if re.fullmatch(r"[-+]?[0-9]+(_[0-9]+)+(\.[0-9]+)?", written):
        return f"; write {written.replace('_', '')}"
    # 10,000
    if re.fullmatch(r"[-+]?[0-9]{1,3}(,[0-9]{3})+", written) and type_name == "int":
        return f"; write {written.replace(',', '')}"
    # 0,5
    if re.fullmatch(r"[-+]?[0-9]+,[0-9]+", written):
        return f"; write {written.replace(',', '.')} with a point"
    # 5 %
    if type_name != "int" and re.fullmatch(r"[0-9]+(\.[0-9]+)?\s*%", written):
        return f"; write the share, {float(written.rstrip('% ')) / 100.0:g}"
    # 3 km or 20m/s, but neither 0x1f nor 1e5x
    if re.fullmatch(r"[-+]?[0-9]+(\.[0-9]+)?\s*(?![xe])[a-zA-Z%°µ][a-zA-Z0-9%/°²^]*", written):
        return "; write the number alone, in the unit of the key"
    return ""


_BOOLEANS = {
    **dict.fromkeys(("yes", "on", "true", "y"), "true"),
    **dict.fromkeys(("no", "off", "false", "n"), "false"),
}


def _without_quotes(words: object) -> str:
    return str(words).replace("'", "")


def shown(value: object) -> str:
    """Write a value of a config, cut if it is long."""
    if isinstance(value, float) and value.is_integer():
        return f"{value:g}"
    text = repr(value) if isinstance(value, str) else json.dumps(value)
    if len(text) >= 60:
        return text[:57] + "..."
    return text
