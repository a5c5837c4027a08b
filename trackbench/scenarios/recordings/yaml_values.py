"""Words, namings, formats, missing numbers and reasons as YAML, and names in options."""

import json
import re
from dataclasses import fields

from trackbench.scenarios.recordings.csv_layout_and_rows import TextFormat
from trackbench.scenarios.recordings.naming_of_columns import Naming

_NO_PLAIN_NAME = re.compile(r"""[\[{"']|.*[\\"]|[-+]?[0-9.,_]+([eE][-+]?[0-9]+)?$|$""")
"""Names that stand in quotation marks in an option, such as [x], 1.5 and a"b."""
_NO_WORDS = ("null", "true", "false")
"""Words that YAML reads as something else."""


def mapping_in_braces(mapping: dict[str, str]) -> str:
    """Return the entries of a mapping as YAML, for use in braces: "x: east, y: north"."""
    return ", ".join(f"{name}: {quoted(value)}" for name, value in mapping.items())


def missing_in_yaml(naming: Naming) -> str:
    """Return the numbers that stand for missing cells as YAML: of all columns, or of each quantity."""
    if not isinstance(naming.missing, dict):
        return f"[{', '.join(f'{value:.15g}' for value in naming.missing or ())}]"
    entries = []
    for quantity, numbers in naming.missing.items():
        entries.append(f"{quantity}: [{', '.join(f'{value:.15g}' for value in numbers)}]")
    return f"{{{', '.join(entries)}}}"


def comment_on(reasons: dict[str, str], key: str) -> str:
    """Return the reason for a key as a comment of YAML; empty if there is none."""
    if key not in reasons:
        return ""
    return f"  # {reasons[key]}"


def format_in_braces(text_format: TextFormat) -> str:
    """Return the keys that are set in a format of text files as YAML: {separator: ";"}."""
    keys = []
    for key in fields(text_format):
        value = getattr(text_format, key.name)
        if value:
            keys.append(f"{key.name}: {value_in_braces(value)}")
    return f"{{{', '.join(keys)}}}"


def value_in_braces(value: object) -> str:
    """Return a list, a text or a number as YAML that may stand in braces."""
    if isinstance(value, (tuple, list)):
        return f"[{', '.join(quoted(str(item)) for item in value)}]"
    if isinstance(value, str):
        return quoted(value)
    return json.dumps(value)


def in_option(name: str) -> str:
    """Return a column's name as an option ``--set 'columns.x=NAME'`` needs it.

    It stands in quotation marks if YAML would read another value than the name. An apostrophe would end
    the quotes of the shell.
    """
    is_plain = name.isprintable() and not _NO_PLAIN_NAME.match(name)
    text = name
    if not is_plain or name.strip() != name:
        # JSON escapes what cannot be printed. Letters of any language stay.
        text = "".join(c if c.isprintable() else json.dumps(c)[1:-1] for c in _escaped(name))
        text = f'"{text}"'
    return text.replace("'", "'\\''")


def _escaped(name: str) -> str:
    """Return a name with a backslash before quotation marks and backslashes."""
    return name.replace("\\", "\\\\").replace('"', '\\"')


def quoted(word: str) -> str:
    """Return a word as YAML, in quotes if it has more than letters, digits and underscores.

    A word that YAML reads as a truth value or as nothing is quoted, too. Characters that cannot be
    printed, such as line breaks of Unicode, are escaped, so that words of an unknown table cannot begin
    a new line of the config.
    """
    if re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*|[1-9][0-9]*", word) and word.lower() not in _NO_WORDS:
        return word
    text = json.dumps(word, ensure_ascii=False)
    return "".join(c if c.isprintable() else _escape(c) for c in text)


def _escape(character: str) -> str:
    """Escape a character as YAML does within double quotes."""
    number = ord(character)
    if number < 0x10000:
        return f"\\u{number:04x}"
    return f"\\U{number:08x}"


def naming_in_braces(naming: Naming) -> str:
    """Return the names and units of a file's columns, and its formats, as YAML in braces."""
    keys = []
    for name in ("columns", "units"):
        entries = getattr(naming, name)
        if entries:
            pairs = ", ".join(f"{key}: {quoted(value)}" for key, value in entries.items())
            keys.append(f"{name}: {{{pairs}}}")
    if naming.format is not None:
        keys.append(f"format: {format_in_braces(naming.format)}")
    if naming.time_format:
        keys.append(f"time_format: {json.dumps(naming.time_format)}")
    if naming.zone:
        keys.append(f"zone: {quoted(naming.zone)}")
    if naming.missing is not None:
        keys.append(f"missing: {missing_in_yaml(naming)}")
    if naming.clockwise:
        keys.append(f"clockwise: [{', '.join(naming.clockwise)}]")
    if naming.same_time is not None:
        keys.append(f"same_time: {naming.same_time}")
    return f"{{{', '.join(keys)}}}"
