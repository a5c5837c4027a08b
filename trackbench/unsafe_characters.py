"""Texts that are rejected: control characters, which a terminal obeys, and formulas of a spreadsheet."""

import json
from collections.abc import Iterator
from typing import Any

from yaml.reader import Reader

from trackbench.field_types import FORMULA
from trackbench.yaml_scalars import scalar

_UNPRINTABLE = Reader.NON_PRINTABLE  # YAML allows these in quotes only, XML nowhere
_LONGEST_TEXT = 10_000  # characters: a figure takes a minute to lay out 100 000


def unprintable_reason(text: str) -> str | None:
    """Explain why a text cannot be written into a file or page.

    Parameters
    ----------
    text
        text of a config or of a data file

    Returns
    -------
    str or None
        reason: too many characters, or the first unprintable one; None if the text can be written
    """
    if len(text) > _LONGEST_TEXT:
        return f"has {len(text)} characters; a text has {_LONGEST_TEXT} at most"
    match = _UNPRINTABLE.search(text)
    if match is None:
        return None
    return f"{text!r} holds the character U+{ord(match.group()):04X}; write printable text"


def explain_formula(text: str) -> str | None:
    """Explain that a spreadsheet would run a word as a formula; None if it would not.

    A negative number begins with ``-``, but is no word.
    """
    if not text.startswith(tuple(FORMULA)) or not isinstance(scalar(text), str):
        return None
    return f"{text!r} begins with {text[0]}, as a formula of a spreadsheet; put another character first"


def printable_json(text: str) -> Any:
    """Parse a JSON file, and reject control characters in its texts.

    Anybody may have written it, and a terminal obeys some of these characters.

    Parameters
    ----------
    text
        content of the file

    Returns
    -------
    object
        parsed content

    Raises
    ------
    ValueError
        if the text is no JSON, and for the first text or key that has an unprintable character
    """
    content = json.loads(text)
    for word in _texts(content):
        reason = unprintable_reason(word)
        if reason:
            raise ValueError(reason)
    return content


def _texts(content: object) -> Iterator[str]:
    """Yield all texts in the content of a JSON file, names of keys included."""
    if isinstance(content, str):
        yield content
    elif isinstance(content, dict):
        for value in (*content, *content.values()):
            yield from _texts(value)
    elif isinstance(content, list):
        for value in content:
            yield from _texts(value)
