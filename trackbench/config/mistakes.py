"""Mistakes in a config, in words and with their positions: unknown keys, values beyond limits."""

import json
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import fields, replace
from difflib import get_close_matches
from math import isinf, isnan
from typing import Any, get_type_hints

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from trackbench.errors import Mark, Problem
from trackbench.extension_points import Part, key_of
from trackbench.field_types import ONE_LINE, DataError, InvalidKeyError, dataclasses_in
from trackbench.yaml_source import Keys, Source, dotted, formula, scalar

REPORTED = "reported"
"""Type of the validator's error for a component whose mistakes are in the source."""
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


def unknown(word: str, known: list[str]) -> str:
    """Suggest ``did you mean ...?``, or list the first 40 known words."""
    near = nearest(word, known)
    # A word with a comma, as a label may have, is quoted.
    words = [repr(k) if "," in k else k for k in known[:40]]
    listed = ", ".join(words) + (f", {len(known) - 40} more" if len(known) > 40 else "")
    return f"did you mean {near}?" if near else f"known: {listed}"


def nearest(word: str, known: Sequence[str]) -> str:
    """Return the known word that was probably meant; an empty text if none is near."""
    lower = word.lower().replace(" ", "-")
    meant = _MEANT.get(lower, "")
    if meant in known:
        return meant
    # The same letters in another order (efk is ekf, not epf), then beginnings, then similar words.
    for other in known:
        if sorted(other.lower()) == sorted(lower):
            return other
    longer = [other for other in known if len(lower) > 2 and other.lower().startswith(lower)]
    if longer:
        return min(longer, key=lambda other: ("position" not in other, len(other)))
    near = get_close_matches(word, known, 1, 0.5) or get_close_matches(lower, known, 1, 0.5)
    return near[0] if near else ""


_MEANT = {
    **{"dt": "T", "interval": "T", "period": "T", "steps": "last", "duration": "last"},
    **{"n_runs": "runs", "monte_carlo_runs": "runs", "particles": "N", "n_particles": "N"},
    **{"pos_rmse": "rmse_position", "position_rmse": "rmse_position", "rmse": "rmse_position"},
    **{"position": "rmse_position", "position_error": "rmse_position", "velocity": "rmse_velocity"},
    **{"nees": "anees", "nis": "anis", "omega": "turn_rate_deg_s", "measurement": "sensor"},
    **{"kalman": "kf", "kalman-filter": "kf", "particle-filter": "pf", "particle": "pf"},
    **{"extended-kalman": "ekf", "unscented": "ukf", "radar": "range-azimuth", "gps": "position"},
    **{"constant-velocity": "cv", "constant-acceleration": "ca", "constant-turn": "ct"},
    **{"coordinated-turn": "ct", "line": "rmse-vs-time", "rmse_vs_time": "rmse-vs-time"},
}
"""Words that users write, and the key or kind that is meant, if it is known at the place."""


def mistakes_of(
    error: ValidationError, source: Source, keys: Keys, cls: type, also: Sequence[str] = ()
) -> list[Problem]:
    """Locate and describe what the validator of ``cls`` found wrong with the mapping at ``keys``.

    ``also`` names keys that stand beside those of the dataclass.
    """
    problems: dict[Problem, None] = {}
    for item in error.errors(include_url=False):
        problems |= dict.fromkeys(_problems(item, source, keys, cls, also))
    return _without_unions(problems)


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
        if before is not None:
            said, mark, advice = before.what.partition("; write ")
            rest, other_mark, other_advice = rest.partition("; write ")
            advice = f"{mark}{advice}" or f"{other_mark}{other_advice}"
            problem = replace(before, what=f"{said} and {rest}{advice}")
        merged[place] = problem
    return list(merged.values())


def _problems(
    item: ErrorDetails, source: Source, keys: Keys, cls: type, also: Sequence[str]
) -> list[Problem]:
    kind, ctx, value = item["type"], item.get("ctx", {}), item["input"]
    if kind == REPORTED:
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
    if kind == "missing" and isinstance(item["loc"][-1], int):
        what = f"{shown(value)} has too few values; at least {item['loc'][-1] + 1} are needed"
        return [source.problem(where, what)]
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


def _describe(kind: str, ctx: Mapping[str, object], value: object, message: str) -> str:
    """Describe in words what the validator found wrong with a value."""
    text = shown(value)
    if kind == "value_error":
        return str(ctx["error"])
    if kind == "json_invalid":
        return "the name of a folder it lies in is not UTF-8, and no config could hold it"
    if isinstance(value, float) and (
        isnan(value) or (isinf(value) and kind in ("less_than", "greater_than"))
    ):
        return f"{'NaN' if isnan(value) else text} is not a finite number"
    # Numbers beyond a limit, words that are not in a list, texts that do not match.
    if kind in _LIMITS:
        words, limit = _LIMITS[kind]
        return f"{text} is {words} {shown(ctx[limit])}"
    if kind == "literal_error":
        return f"{text} is not one of {_unquoted(ctx['expected'])}"
    if kind == "union_tag_invalid":
        return f"{ctx['tag']!r} is not one of {_unquoted(ctx['expected_tags'])}"
    if kind == "union_tag_not_found":
        return f"needs a {_unquoted(ctx['discriminator'])}"
    if kind == "string_pattern_mismatch" and ctx["pattern"] == ONE_LINE:
        return formula(str(value)) or f"{text} is not one line of visible characters"
    if kind == "string_pattern_mismatch":
        return f"{text} must start with a letter or digit and hold only letters, digits, . _ -"
    if kind in ("too_long", "too_short"):
        at_most = f"at most {ctx['max_length']} are allowed" if "max_length" in ctx else ""
        at_least = f"at least {ctx['min_length']} are needed" if "min_length" in ctx else ""
        return f"{text} has {ctx['actual_length']} values; {at_most or at_least}"
    # A value of another type.
    name = kind.removesuffix("_type").removesuffix("_parsing").removesuffix("_from_float")
    if name not in _TYPES:
        return message.lower()
    return f"{text} is not {_TYPES[name]}{_written_otherwise(name, value)}"


def _written_otherwise(name: str, value: object) -> str:
    """Advise how a value is written that has the form of another type."""
    if name in ("list", "tuple") and isinstance(value, str) and "\n" not in value:
        return f"; write [{value}]"
    if name == "bool" and isinstance(value, str) and value.lower() in _BOOLEANS:
        return f"; write {_BOOLEANS[value.lower()]}"
    if name == "int" and isinstance(value, float) and value.is_integer():
        return f"; write {int(value)} without a point or an exponent"
    if name not in ("int", "float", "finite_number") or not isinstance(value, str):
        return ""
    written = value.strip()
    if isinstance(scalar(written), int | float) and not isinstance(scalar(written), bool):
        return f"; write {written} without quotation marks"
    if re.fullmatch(r"[-+]?[0-9]+(_[0-9]+)+(\.[0-9]+)?", written):
        return f"; write {written.replace('_', '')}"
    if re.fullmatch(r"[-+]?[0-9]{1,3}(,[0-9]{3})+", written) and name == "int":
        return f"; write {written.replace(',', '')}"
    if re.fullmatch(r"[-+]?[0-9]+,[0-9]+", written):
        return f"; write {written.replace(',', '.')} with a point"
    if name != "int" and re.fullmatch(r"[0-9]+(\.[0-9]+)?\s*%", written):
        return f"; write the share, {float(written.rstrip('% ')) / 100.0:g}"
    if re.fullmatch(r"[-+]?[0-9]+(\.[0-9]+)?\s*(?![xe])[a-zA-Z%°µ][a-zA-Z0-9%/°²^]*", written):
        return "; write the number alone, in the unit of the key"
    return ""


_BOOLEANS = {
    **dict.fromkeys(("yes", "on", "true", "y"), "true"),
    **dict.fromkeys(("no", "off", "false", "n"), "false"),
}


def _unquoted(words: object) -> str:
    return str(words).replace("'", "")


def shown(value: object) -> str:
    """Write a value of a config, cut if it is long."""
    if isinstance(value, float) and value.is_integer():
        return f"{value:g}"
    text = json.dumps(value) if not isinstance(value, str) else repr(value)
    return text if len(text) < 60 else text[:57] + "..."
