"""YAML with positions: plain data, and where every key and value stands.

Numbers follow YAML 1.2 (``1e-5`` is a number, ``no`` is a word). Duplicate keys, tags and unreasonable
sizes are mistakes; nothing is ever constructed but the plain types.
"""

import errno
import re
import sys
from dataclasses import dataclass, field
from functools import cache, lru_cache
from io import IncrementalNewlineDecoder
from math import inf, nan
from pathlib import Path
from typing import Any, TypeAlias

import yaml
from yaml.reader import Reader

from trackbench.errors import Mark, Problem, UserError, reason
from trackbench.field_types import FORMULA, require_regular_file

Keys: TypeAlias = tuple[str | int, ...]
"""Where a value stands: the keys and list indices that lead to it."""

_LARGEST_FILE = 1_000_000  # bytes
_UNSEEN = Reader.NON_PRINTABLE  # what YAML lets stand in quotes only, and XML nowhere
_MOST_NODES = (
    100_000  # after aliases are expanded: 1 MB of ten bytes each, as lines of configs have
)
_TOO_MANY = f"more than {_MOST_NODES} values"
DEEPEST = 50  # levels
_LONGEST_TEXT = 10_000  # characters: a figure takes a minute to lay out 100 000
_LONGEST_NUMBER = 100  # characters; a longer whole number is a word, since no float could hold it
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_INT = re.compile(r"[-+]?[0-9]+")
_SPECIAL = {".inf": inf, "+.inf": inf, "-.inf": -inf, ".nan": nan}
_PLAIN_TAGS = [
    f"tag:yaml.org,2002:{name}"
    for name in ("str", "int", "float", "bool", "null", "timestamp", "merge", "value")
]
_WORDS: dict[str, bool | None] = {"true": True, "false": False, "null": None, "~": None, "": None}


@dataclass
class Source:
    """Plain data with the position of every value and of every key, and the mistakes found in it."""

    data: Any
    marks: dict[Keys, Mark] = field(default_factory=dict)
    key_marks: dict[Keys, Mark] = field(default_factory=dict)
    problems: list[Problem] = field(default_factory=list)

    def mark(self, keys: Keys) -> Mark:
        """Return the place of a value, or of the nearest thing around it; list items may be named."""
        if keys not in self.marks:
            keys = tuple(int(k) if isinstance(k, str) and k.isdecimal() else k for k in keys)
        while keys not in self.marks and keys:
            keys = keys[:-1]
        return self.marks.get(keys, Mark("config"))

    def key_mark(self, keys: Keys) -> Mark:
        """Return the place of a key."""
        return self.key_marks.get(keys) or self.mark(keys)

    def problem(self, keys: Keys, what: str) -> Problem:
        """Return a mistake in the value at ``keys``."""
        return Problem(self.mark(keys), dotted(keys), what)

    def add_problem(self, keys: Keys, what: str) -> None:
        """Note a mistake in the value at ``keys``."""
        self.problems.append(self.problem(keys, what))

    def add_key_problem(self, keys: Keys, what: str) -> None:
        """Note a mistake in the key itself."""
        self.problems.append(Problem(self.key_mark(keys), dotted(keys), what))

    def check(self) -> None:
        """Raise UserError with every mistake that was noted, if there are any."""
        if self.problems:
            raise UserError(*sorted(set(self.problems)))

    def subtree(self, keys: Keys, data: Any) -> "Source":
        """Return the value at ``keys`` as its own source: ``data`` and the positions in it."""
        n = len(keys)
        marks, key_marks = (
            {k[n:]: mark for k, mark in every.items() if k[:n] == keys}
            for every in (self.marks, self.key_marks)
        )
        return Source(data, marks, key_marks)

    def adopt_positions(self, keys: Keys, other: "Source") -> None:
        """Take over the positions of a part that came from elsewhere."""
        for mine, theirs in ((self.marks, other.marks), (self.key_marks, other.key_marks)):
            mine.update({keys + at: mark for at, mark in theirs.items()})


def dotted(keys: Keys) -> str:
    """Return ``filters.HDEPF.CR``."""
    return ".".join(str(k) for k in keys)


def read(path: Path, shown: str | None = None) -> Source:
    """Parse a YAML file, or for ``-`` what comes on stdin; ``shown`` is how messages name it."""
    given = str(path) == "-"
    name = "stdin" if given else shown or str(path)
    try:
        return parse(_given() if given else text_of(path), name)
    except OSError as error:
        raise UserError(Problem(Mark(name, 1, 1), "", reason(error))) from None


def text_of(path: Path) -> str:
    """Return the content of a text file of at most 1 MB; raises OSError."""
    size = require_regular_file(path).stat().st_size
    if size > _LARGEST_FILE:
        raise OSError(errno.EFBIG, f"has {size} bytes, and may have 1 MB at most")
    return _decoded(path.read_bytes())


@cache
def _given() -> str:
    """Return the text of stdin, which can be read once."""
    content = sys.stdin.buffer.read(_LARGEST_FILE + 1)
    if len(content) > _LARGEST_FILE:
        raise OSError(errno.EFBIG, "has more than 1 MB")
    return _decoded(content)


def _decoded(content: bytes) -> str:
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise OSError(errno.EILSEQ, "is not a text file in UTF-8") from None
    return IncrementalNewlineDecoder(None, translate=True).decode(text, final=True)


def unprintable_reason(text: str) -> str | None:
    """Return why a text cannot be written into a file or page, or an empty string."""
    if len(text) > _LONGEST_TEXT:
        return f"has {len(text)} characters; a text has {_LONGEST_TEXT} at most"
    found = _UNSEEN.search(text)
    if found is None:
        return None
    return f"{text!r} holds the character U+{ord(found.group()):04X}, which is none of text"


def formula(text: str) -> str | None:
    """Return what to say of a word that begins as a formula: a spreadsheet would run it in a CSV."""
    if not text.startswith(tuple(FORMULA)) or not isinstance(scalar(text), str):
        return None
    return f"{text!r} begins with {text[0]}, as a formula of a spreadsheet; put another character first"


def parse(text: str, name: str) -> Source:
    """Parse YAML text."""
    try:
        node = _composed(text)
    except _TooManyError as error:
        mark = Mark(name, error.line + 1, error.column + 1)
        raise UserError(Problem(mark, "", _TOO_MANY)) from None
    except yaml.MarkedYAMLError as error:
        at = error.problem_mark or error.context_mark
        mark = Mark(name, at.line + 1, at.column + 1) if at else Mark(name)
        raise UserError(Problem(mark, "", f"not valid YAML: {error.problem}")) from None
    except yaml.YAMLError as error:
        first = str(error).splitlines()[0]
        raise UserError(Problem(Mark(name, 1, 1), "", f"not valid YAML: {first}")) from None
    except RecursionError:
        raise UserError(Problem(Mark(name, 1, 1), "", "is nested too deeply")) from None
    if node is None:
        raise UserError(Problem(Mark(name, 1, 1), "", "is empty"))
    builder = _Builder(name)
    data = builder.build(node, ())
    if builder.problems:
        raise UserError(*builder.problems)
    return Source(data, builder.marks, builder.key_marks)


def scalar(text: str) -> Any:
    """Return a plain scalar by YAML 1.2's core schema: number, true, false, null, or a word."""
    if text.lower() in _WORDS and text in (text.lower(), text.capitalize(), text.upper()):
        return _WORDS[text.lower()]
    if _INT.fullmatch(text):
        return int(text) if len(text) < _LONGEST_NUMBER else text
    if _FLOAT.fullmatch(text):
        return float(text)
    return _SPECIAL.get(text.lower(), text)


@lru_cache(maxsize=32)
def _composed(text: str) -> yaml.Node | None:
    """Return the document's node; kept, since experiments share their parts."""
    return _Loader(text).get_single_node()


class _TooManyError(Exception):
    """Place of a surplus value in a file."""

    def __init__(self, at: yaml.Mark) -> None:
        super().__init__(_TOO_MANY)
        self.line, self.column = at.line, at.column


class _Loader(yaml.SafeLoader):
    """Stops early in a file of far too many values, which take some 20 us each."""

    nodes = 0

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        """Return the next node, unless it is one too many."""
        self.nodes += 1
        if self.nodes > _MOST_NODES:
            raise _TooManyError(self.peek_event().start_mark)  # type: ignore[no-untyped-call]
        return super().compose_node(parent, index)


class _Builder:
    def __init__(self, name: str) -> None:
        self.name = name
        self.problems: list[Problem] = []
        self.marks: dict[Keys, Mark] = {}
        self.key_marks: dict[Keys, Mark] = {}
        self.nodes = 0

    def build(self, node: yaml.Node, keys: Keys) -> Any:
        mark = self._mark(node)
        self.marks[keys] = mark
        self.nodes += 1
        if self.nodes > _MOST_NODES:
            raise UserError(Problem(mark, "", f"{_TOO_MANY} after aliases"))
        if len(keys) > DEEPEST:
            raise UserError(Problem(mark, "", f"nested more than {DEEPEST} levels deep"))
        if isinstance(node, yaml.MappingNode):
            return self._mapping(node, keys)
        if isinstance(node, yaml.SequenceNode):
            return [self.build(item, (*keys, i)) for i, item in enumerate(node.value)]
        return self._scalar(node, keys)

    def _mapping(self, node: yaml.MappingNode, keys: Keys) -> dict[str, Any]:
        out: dict[str, Any] = {}
        for key_node, value_node in node.value:
            mark = self._mark(key_node)
            if not isinstance(key_node, yaml.ScalarNode):
                self.problems.append(Problem(mark, dotted(keys), "a key must be a word"))
                continue
            key = str(key_node.value)
            at = (*keys, key)
            self._check_text(key, mark, keys)
            if what := formula(key):
                self.problems.append(Problem(mark, dotted(keys), what))
            if key in out:
                first = self.key_marks[at].line
                what = f"duplicate key, first given on line {first}"
                self.problems.append(Problem(mark, dotted(at), what))
                continue
            self.key_marks[at] = mark
            out[key] = self.build(value_node, at)
        return out

    def _scalar(self, node: yaml.Node, keys: Keys) -> Any:
        plain = getattr(node, "style", None) is None
        if node.tag not in (_PLAIN_TAGS if plain else _PLAIN_TAGS[:1]):
            what = f"the tag {node.tag} is not allowed"
            self.problems.append(Problem(self._mark(node), dotted(keys), what))
            return None
        self._check_text(node.value, self._mark(node), keys)
        return scalar(node.value) if plain else node.value

    def _check_text(self, text: str, mark: Mark, keys: Keys) -> None:
        if unprintable_reason(text):
            self.problems.append(Problem(mark, dotted(keys), str(unprintable_reason(text))))

    def _mark(self, node: yaml.Node) -> Mark:
        return Mark(self.name, node.start_mark.line + 1, node.start_mark.column + 1)
