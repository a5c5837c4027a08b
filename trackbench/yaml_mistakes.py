"""Mistakes against YAML's grammar, in words: brackets, spaces, conflicts of git, missing spaces."""

import re

import yaml

from trackbench.errors import Mark
from trackbench.yaml_scalars import WHOLE_NUMBER

MOST_NODES = 100_000  # with aliases expanded: 1 MB of ten bytes each, as in lines of configs
TOO_MANY = f"more than {MOST_NODES} values"


def explain_invalid_yaml(error: yaml.MarkedYAMLError, text: str, name: str) -> tuple[Mark, str]:
    """Find the place of an error of YAML's grammar, and explain it.

    Parameters
    ----------
    error
        error of the parser
    text
        text of the file
    name
        name of the file in messages

    Returns
    -------
    mark : Mark
        place of the mistake, which may be far above the place at which the parser stopped
    message : str
        explanation
    """
    mark = Mark(name)
    position = error.problem_mark or error.context_mark
    if position is not None:
        mark = Mark(name, position.line + 1, position.column + 1)
    if isinstance(error, TooManyError):
        return mark, TOO_MANY
    lines = text.split("\n")
    # Step 1: characters that are no YAML, often far above the place where the parser stops.
    place_and_message = _find_odd_space(lines, mark) or _find_merge_conflict(lines, mark)
    if place_and_message is not None:
        return place_and_message
    # Step 2: what began at another place and does not end.
    problem = str(error.problem)
    message = f"not valid YAML: {error.problem}"
    if "another document" in problem:
        second = "not valid YAML: a second document begins here (---); write each into its own file"
        return mark, second
    if "block end" in problem and problem.endswith(("'}'", "']'")):
        bracket = problem[-2]  # the last letter is the quotation mark
        return mark, f"not valid YAML: the bracket {bracket} here closes nothing; leave it out"
    start = error.context_mark
    if start is not None:
        place = Mark(name, start.line + 1, start.column + 1)
        if error.context in _IN_BRACKETS:
            bracket = lines[start.line][start.column : start.column + 1]
            opened = f"the bracket {bracket} at {place.line}:{place.column}"
            return mark, f"{message}; close {opened}, or separate its parts by commas"
        if problem == "could not find expected ':'":
            line = lines[start.line].strip()
            advice = "write KEY: VALUE"
            missing_space = re.match(r"[\w-]+:(?=\S)", line)
            if missing_space:
                advice = f"write a space after the colon: {missing_space.group()} ..."
            return place, f"not valid YAML: {line!r} is no key with a value; {advice}"
        if "end of stream" in problem and "quoted" in str(error.context):
            unclosed = "not valid YAML: the quotation mark here has no partner; close the text"
            return place, unclosed
    # Step 3: the place itself.
    if "'\\t'" in problem:
        return mark, f"{message}; indent with spaces"
    if "cannot start any token" in problem:
        return mark, f"{message}; put the text in quotation marks"
    if "mapping values are not allowed" in problem:
        place_and_message = _find_missing_space(lines, mark)
        if place_and_message is not None:
            return place_and_message
    if "mapping" in problem or "block end" in problem:
        message += "; check the indentation, or quote a text with ': '"
    return mark, message


def _find_odd_space(lines: list[str], mark: Mark) -> tuple[Mark, str] | None:
    """Find a space of a word processor or a web page: near the place, or in an indentation above.

    ``mark`` is the place where the parser stops. Return the space's place with a message, or None.
    """
    for number in range(min(mark.line, len(lines)), 0, -1):
        line = lines[number - 1]
        is_near = number > mark.line - 3
        if not is_near:
            line = line[: len(line) - len(line.lstrip())]
        space = _ODD_SPACE.search(line)
        if space is not None:
            message = f"not valid YAML: {describe_space(number, space.group())}"
            return Mark(mark.file, number, space.start() + 1), message
    return None


def _find_merge_conflict(lines: list[str], mark: Mark) -> tuple[Mark, str] | None:
    """Find a line of a conflict that git has left, above the place ``mark`` or at it.

    Return the line's place with a message, or None.
    """
    for number, line in enumerate(lines[: mark.line], 1):
        if line.startswith(("<<<<<<< ", "=======", ">>>>>>> ")):
            message = (
                f"not valid YAML: {line[:20]!r} is a mark of a conflict in git; choose one version"
            )
            return Mark(mark.file, number, 1), message
    return None


def _find_missing_space(lines: list[str], mark: Mark) -> tuple[Mark, str] | None:
    """Find ``KEY:VALUE`` in the line above, if the place ``mark`` itself is the first key of its line.

    Return the place of the key with a message, or None.
    """
    if not 1 < mark.line <= len(lines):
        return None
    line_above = lines[mark.line - 2]
    text_above = line_above.strip()
    text_before = lines[mark.line - 1][: mark.column - 1].strip()
    if not re.fullmatch(r"[\w-]+:\S+", text_above) or ":" in text_before:
        return None
    message = (
        f"not valid YAML: {text_above!r} is no key with a value; write a space after the colon"
    )
    column = len(line_above) - len(text_above) + 1
    return Mark(mark.file, mark.line - 1, column), message


_IN_BRACKETS = ("while parsing a flow mapping", "while parsing a flow sequence")
_ODD_SPACES = {
    **{0x00A0: "a no-break space", 0x2007: "a figure space", 0x202F: "a narrow no-break space"},
    **{0x2009: "a thin space", 0x3000: "an ideographic space", 0x200B: "a space without width"},
    **{0x2003: "an em space", 0x2002: "an en space", 0xFEFF: "a byte order mark"},
}
_ODD_SPACE = re.compile("[" + "".join(map(chr, _ODD_SPACES)) + "]")
ODD_ENDS = re.compile(f"^{_ODD_SPACE.pattern}|:{_ODD_SPACE.pattern}|{_ODD_SPACE.pattern}$")


def describe_space(line: int, space: str) -> str:
    """Explain that a line has a space which YAML takes for a letter."""
    code = ord(space)
    return f"line {line} has {_ODD_SPACES[code]} (U+{code:04X}); type an ordinary space"


class TooManyError(yaml.MarkedYAMLError):
    """Place of a surplus value in a file."""


def is_plain(node: yaml.Node) -> bool:
    """Test whether a node is a scalar without quotes."""
    return isinstance(node, yaml.ScalarNode) and node.style is None


def explain_joined_key(key: yaml.Node, value: yaml.Node) -> str:
    """Explain a part of ``{kind:position, sigma = 50}`` that is all key.

    Parameters
    ----------
    key, value
        nodes of a key and of its value in a mapping in braces

    Returns
    -------
    str
        explanation; empty for a key that is written correctly
    """
    if not is_plain(key) or not is_plain(value):
        return ""
    match = re.fullmatch(r"([\w-]+)(:(?=\S)|\s*=\s*)(\S.*)", str(key.value))
    if match is None or value.value != "":
        return ""
    return f"{key.value!r} is no key with a value; write {match[1]}: {match[3]}"


def is_after_comma(before: yaml.Node, key: yaml.Node, value: yaml.Node) -> bool:
    """Test whether ``{q: 0,1}`` was split at its comma: into ``q: 0`` and a key 1 without a value."""
    if not is_plain(before) or not is_plain(key) or not is_plain(value):
        return False
    is_number = WHOLE_NUMBER.fullmatch(str(before.value)) and str(key.value).isdecimal()
    return bool(is_number) and value.value == ""
