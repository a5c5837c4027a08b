"""Values of a YAML file without quotes, by the rules of YAML 1.2: numbers, true, false, null, words."""

import re
from collections.abc import Mapping
from math import inf, nan
from typing import TypeAlias

Scalar: TypeAlias = bool | int | float | str | None
"""A value of a config that is no mapping or list."""
_LONGEST_NUMBER = 100  # characters; a longer whole number is a word, since no float could hold it
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
WHOLE_NUMBER = re.compile(r"[-+]?[0-9]+")
_SPECIAL = {".inf": inf, "+.inf": inf, "-.inf": -inf, ".nan": nan}
_WORDS: dict[str, bool | None] = {"true": True, "false": False, "null": None, "~": None, "": None}


def scalar(text: str) -> Scalar:
    """Parse a plain scalar by YAML 1.2's core schema: number, true, false, null, or a word.

    Parameters
    ----------
    text
        value as it is written, without quotes

    Returns
    -------
    bool, int, float, str or None
        value; a whole number of 100 characters or more is a word
    """
    if text.lower() in _WORDS and text in (text.lower(), text.capitalize(), text.upper()):
        return _WORDS[text.lower()]
    if WHOLE_NUMBER.fullmatch(text):
        if len(text) >= _LONGEST_NUMBER:  # so many digits are read as a word
            return text
        return int(text)
    if _FLOAT.fullmatch(text):
        return float(text)
    return _SPECIAL.get(text.lower(), text)


def one_line_yaml(value: object) -> str:
    """Write a value as YAML in one line.

    Parameters
    ----------
    value
        mapping, list, tuple or scalar; a named tuple is written as its ``str``

    Returns
    -------
    str
        YAML; a text has no quotes
    """
    if isinstance(value, Mapping):
        return f"{{{', '.join(f'{key}: {one_line_yaml(inner)}' for key, inner in value.items())}}}"
    is_record = hasattr(value, "_fields")  # such as a metric, which writes itself
    if isinstance(value, (list, tuple)) and not is_record:
        return f"[{', '.join(map(one_line_yaml, value))}]"
    if isinstance(value, bool):
        return str(value).lower()
    if value is None:
        return "null"
    return str(value)
