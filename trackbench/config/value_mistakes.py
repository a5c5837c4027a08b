"""Mistakes in the value of a key, in words: a wrong type or form, a number beyond a limit."""

import json
import re
from collections.abc import Mapping
from math import isinf, isnan

from trackbench.field_types import LEGEND_LABEL, ONE_LINE
from trackbench.unsafe_characters import explain_formula
from trackbench.yaml_scalars import scalar

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
