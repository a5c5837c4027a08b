"""YAML with positions: mappings and lists that carry the place of every key and value.

Numbers follow YAML 1.2 (``1e-5`` is a number, ``no`` is a word). Duplicate keys, tags and unreasonable
sizes are mistakes. Only plain types are ever constructed.
"""

import errno
import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, lru_cache
from math import inf, nan
from pathlib import Path
from typing import Any, Protocol, TypeAlias, runtime_checkable

import yaml
from yaml.reader import Reader

from trackbench.errors import Mark, Problem, UserError, reason
from trackbench.field_types import FORMULA, require_regular_file

Keys: TypeAlias = tuple[str | int, ...]
"""Keys and list indices that lead to a value."""
Scalar: TypeAlias = bool | int | float | str | None
"""A value of a config that is no mapping or list."""

_LARGEST_FILE = 1_000_000  # bytes
_UNPRINTABLE = Reader.NON_PRINTABLE  # YAML allows these in quotes only, XML nowhere
_MOST_NODES = 100_000  # with aliases expanded: 1 MB of ten bytes each, as in lines of configs
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
_COLLECTION_TAGS = ("tag:yaml.org,2002:map", "tag:yaml.org,2002:seq")
_WORDS: dict[str, bool | None] = {"true": True, "false": False, "null": None, "~": None, "": None}
_NOWHERE = Mark("config")


class MarkedMapping(dict[str, Any]):
    """A mapping of a config that carries the positions of its keys and values."""

    def __init__(self, items: Mapping[str, object] | None = None) -> None:
        super().__init__(items or {})
        self.marks: dict[str | int, Mark] = {}
        self.key_marks: dict[str | int, Mark] = {}
        if isinstance(items, MarkedMapping):
            self.marks |= items.marks
            self.key_marks |= items.key_marks


class MarkedList(list[Any]):
    """A list of a config that carries the positions of its items."""

    def __init__(self, items: Iterable[object] = ()) -> None:
        super().__init__(items)
        self.marks: dict[str | int, Mark] = {}
        self.key_marks: dict[str | int, Mark] = {}


yaml.SafeDumper.add_representer(MarkedMapping, yaml.SafeDumper.represent_dict)
yaml.SafeDumper.add_representer(MarkedList, yaml.SafeDumper.represent_list)


def put(node: Any, key: str | int, value: object, mark: Mark, key_mark: Mark | None = None) -> None:
    """Set the value of a key, or the item of an index, with its position and that of the key."""
    node[key] = value
    if isinstance(node, MarkedMapping | MarkedList):
        node.marks[key] = mark
        if key_mark is not None:
            node.key_marks[key] = key_mark


def marked(value: object, mark: Mark) -> Any:
    """Return a copy of plain data in which everything stands at one position."""
    if not isinstance(value, dict | list):
        return value
    copy: MarkedMapping | MarkedList = MarkedMapping()
    if isinstance(value, list):
        copy = MarkedList(value)
    for key, inner in value.items() if isinstance(value, dict) else enumerate(value):
        put(copy, key, marked(inner, mark), mark, mark)
    return copy


@dataclass
class Source:
    """The data of a config, which carry their positions, and the mistakes found in them."""

    data: Any
    start: Mark = _NOWHERE
    """position of the whole"""
    problems: list[Problem] = field(default_factory=list)
    programs: set[str] | None = field(default_factory=set)  # that the user allows; None: all

    def at(self, keys: Keys) -> Any:
        """Return the value at ``keys``."""
        value = self.data
        for key in keys:
            value = value[key]
        return value

    def mark(self, keys: Keys) -> Mark:
        """Return the position of a value, or of the nearest one around it; list items may be named."""
        node: Any = self.data
        mark = self.start
        for key in keys:
            marks = node.marks if isinstance(node, MarkedMapping | MarkedList) else {}
            if isinstance(node, list) and isinstance(key, str) and key.isdecimal():
                key = int(key)
            if key not in marks:
                break
            mark = marks[key]
            node = node[key] if has_item(node, key) else None
        return mark

    def key_mark(self, keys: Keys) -> Mark:
        """Return the position of a key; of the value where the key has none."""
        parent = self.at(keys[:-1]) if self.has(keys[:-1]) else None
        marks = parent.key_marks if isinstance(parent, MarkedMapping | MarkedList) else {}
        return marks.get(keys[-1]) or self.mark(keys) if keys else self.start

    def has(self, keys: Keys) -> bool:
        """Return whether there is a value at ``keys``."""
        node = self.data
        for key in keys:
            if not has_item(node, key):
                return False
            node = node[key]
        return True

    def problem(self, keys: Keys, what: str) -> Problem:
        """Return a mistake in the value at ``keys``."""
        return Problem(self.mark(keys), dotted(keys), what)

    def add_problem(self, keys: Keys, what: str) -> None:
        """Add a mistake in the value at ``keys``."""
        self.problems.append(self.problem(keys, what))

    def add_key_problem(self, keys: Keys, what: str) -> None:
        """Add a mistake in the key itself."""
        self.problems.append(Problem(self.key_mark(keys), dotted(keys), what))

    def check(self) -> None:
        """Raise UserError with every mistake that was added, if there are any."""
        if self.problems:
            raise UserError(*sorted(set(self.problems)))

    def replaced(self, keys: Keys, value: object) -> "Source":
        """Return a config with another value at ``keys``; it shares everything else, but problems."""
        # Copy the mappings on the way to the value.
        data = node = MarkedMapping(self.data)
        for key in keys[:-1]:
            node[str(key)] = node = MarkedMapping(node[str(key)])
        put(node, keys[-1], value, self.mark(keys))
        return Source(data, self.start, programs=self.programs)


@dataclass(frozen=True)
class Assembled:
    """A config that the program put together, such as a problem of a suite."""

    source: Source
    """its data with the positions where they come from; paths in it are absolute"""
    allowed: tuple[Path, ...] = ()
    """files of the config whose code the user allowed to run"""


Config: TypeAlias = Path | str | Mapping[str, object] | Assembled
"""A file, the name of a shipped experiment, the content of a file as a mapping, or a config that the
program put together."""


def has_item(node: object, key: str | int) -> bool:
    """Test whether a mapping has the key, or a list the index."""
    if isinstance(node, list):
        return isinstance(key, int) and key < len(node)
    return isinstance(node, dict) and key in node


def dotted(keys: Keys) -> str:
    """Write ``filters.HDEPF.CR``."""
    return ".".join(str(k) for k in keys)


def read(path: Path, shown: str | None = None) -> Source:
    """Parse a YAML file, or for ``-`` what comes on stdin; ``shown`` is how messages name it."""
    is_stdin = str(path) == "-"
    name = "stdin" if is_stdin else shown or str(path)
    try:
        return parse(_stdin() if is_stdin else text_of(path), name)
    except OSError as error:
        raise UserError(Problem(Mark(name, 1, 1), "", reason(error))) from None


def text_of(path: Path) -> str:
    """Read a text file of at most 1 MB; raises OSError."""
    size = require_regular_file(path).stat().st_size
    if size > _LARGEST_FILE:
        raise OSError(errno.EFBIG, f"has {size} bytes, and may have 1 MB at most")
    return _decoded(path.read_bytes())


@cache
def _stdin() -> str:
    """Read stdin, which can be read once."""
    content = sys.stdin.buffer.read(_LARGEST_FILE + 1)
    if len(content) > _LARGEST_FILE:
        raise OSError(errno.EFBIG, "has more than 1 MB")
    return _decoded(content)


def _decoded(content: bytes) -> str:
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise OSError(errno.EILSEQ, "is not a text file in UTF-8") from None
    return re.sub("\r\n?", "\n", text)


def unprintable_reason(text: str) -> str | None:
    """Explain why a text cannot be written into a file or page; None if it can."""
    if len(text) > _LONGEST_TEXT:
        return f"has {len(text)} characters; a text has {_LONGEST_TEXT} at most"
    match = _UNPRINTABLE.search(text)
    if match is None:
        return None
    return f"{text!r} holds the character U+{ord(match.group()):04X}; write printable text"


def formula(text: str) -> str | None:
    """Describe the mistake of a word that a spreadsheet would run as a formula; None for others."""
    if not text.startswith(tuple(FORMULA)) or not isinstance(scalar(text), str):
        return None
    return f"{text!r} begins with {text[0]}, as a formula of a spreadsheet; put another character first"


def parse(text: str, name: str) -> Source:
    """Parse YAML text; ``name`` is how messages name it."""
    node, mark, what = None, Mark(name, 1, 1), "is empty"
    try:
        node = _composed(text)
    except yaml.MarkedYAMLError as error:
        mark, what = _invalid_yaml(error, text, name)
    except yaml.YAMLError as error:
        what = f"not valid YAML: {str(error).splitlines()[0]}"
    except RecursionError:
        what = "is nested too deeply"
    if node is None:
        raise UserError(Problem(mark, "", what))
    # Plain data with positions from the composed nodes.
    builder = _Builder(name)
    source = Source(builder.build(node, ()), builder.mark(node), builder.problems)
    if builder.problems:
        raise UserError(*builder.problems)
    return source


def _invalid_yaml(error: yaml.MarkedYAMLError, text: str, name: str) -> tuple[Mark, str]:
    """Find the place of an error of YAML's grammar, and explain it."""
    at = error.problem_mark or error.context_mark
    mark = Mark(name, at.line + 1, at.column + 1) if at else Mark(name)
    if isinstance(error, _TooManyError):
        return mark, _TOO_MANY
    lines = text.split("\n")
    # A space that a word processor or a web page has put in: near the place, or in an indentation.
    for number in range(min(mark.line, len(lines)), 0, -1):
        line = lines[number - 1]
        is_near = number > mark.line - 3
        space = _ODD_SPACE.search(line if is_near else line[: len(line) - len(line.lstrip())])
        if space is not None:
            what = f"not valid YAML: {_describe_space(number, space.group())}"
            return Mark(name, number, space.start() + 1), what
    for number, line in enumerate(lines[: mark.line], 1):
        if line.startswith(("<<<<<<< ", "=======", ">>>>>>> ")):
            what = (
                f"not valid YAML: {line[:20]!r} is a mark of a conflict in git; choose one version"
            )
            return Mark(name, number, 1), what
    what = f"not valid YAML: {error.problem}"
    start = error.context_mark
    if "another document" in what:
        return (
            mark,
            "not valid YAML: a second document begins here (---); write each into its own file",
        )
    if "block end" in what and what.endswith(("'}'", "']'")):
        return mark, f"not valid YAML: the bracket {what[-2]} here closes nothing; leave it out"
    if start is not None and error.context in _IN_BRACKETS:
        bracket = lines[start.line][start.column : start.column + 1]
        opened = f"the bracket {bracket} at {start.line + 1}:{start.column + 1}"
        return mark, f"{what}; close {opened}, or separate its parts by commas"
    if start is not None and error.problem == "could not find expected ':'":
        line = lines[start.line].strip()
        missing_space = re.match(r"[\w-]+:(?=\S)", line)
        how = f"write a space after the colon: {missing_space.group()} ..." if missing_space else ""
        what = f"not valid YAML: {line!r} is no key with a value; {how or 'write KEY: VALUE'}"
        return Mark(name, start.line + 1, start.column + 1), what
    if start is not None and "end of stream" in what and "quoted" in str(error.context):
        place = Mark(name, start.line + 1, start.column + 1)
        return place, "not valid YAML: the quotation mark here has no partner; close the text"
    if "'\\t'" in what:
        return mark, f"{what}; indent with spaces"
    if "cannot start any token" in what:
        return mark, f"{what}; put the text in quotation marks"
    before = lines[mark.line - 1][: mark.column - 1] if 0 < mark.line <= len(lines) else ""
    if "mapping values are not allowed" in what:
        above = lines[mark.line - 2].strip() if mark.line > 1 else ""
        missing_space = re.fullmatch(r"([\w-]+:)\S+", above)
        if missing_space and ":" not in before.strip():
            what = (
                f"not valid YAML: {above!r} is no key with a value; write a space after the colon"
            )
            return Mark(name, mark.line - 1, len(lines[mark.line - 2]) - len(above) + 1), what
    if "mapping" in what or "block end" in what:
        what += "; check the indentation, or quote a text with ': '"
    return mark, what


_IN_BRACKETS = ("while parsing a flow mapping", "while parsing a flow sequence")
_ODD_SPACES = {
    **{0x00A0: "a no-break space", 0x2007: "a figure space", 0x202F: "a narrow no-break space"},
    **{0x2009: "a thin space", 0x3000: "an ideographic space", 0x200B: "a space without width"},
    **{0x2003: "an em space", 0x2002: "an en space", 0xFEFF: "a byte order mark"},
}
_ODD_SPACE = re.compile("[" + "".join(map(chr, _ODD_SPACES)) + "]")
_ODD_ENDS = re.compile(f"^{_ODD_SPACE.pattern}|:{_ODD_SPACE.pattern}|{_ODD_SPACE.pattern}$")


def _describe_space(line: int, space: str) -> str:
    """Explain that a line has a space which YAML takes for a letter."""
    code = ord(space)
    return f"line {line} has {_ODD_SPACES[code]} (U+{code:04X}); type an ordinary space"


def scalar(text: str) -> Scalar:
    """Parse a plain scalar by YAML 1.2's core schema: number, true, false, null, or a word."""
    if text.lower() in _WORDS and text in (text.lower(), text.capitalize(), text.upper()):
        return _WORDS[text.lower()]
    if _INT.fullmatch(text):
        return int(text) if len(text) < _LONGEST_NUMBER else text
    if _FLOAT.fullmatch(text):
        return float(text)
    return _SPECIAL.get(text.lower(), text)


@lru_cache(maxsize=128)
def _composed(text: str) -> yaml.Node | None:
    """Parse a document; cached, since experiments share their parts."""
    return _Loader(text).get_single_node()


class _TooManyError(yaml.MarkedYAMLError):
    """Place of a surplus value in a file."""


class _Loader(yaml.SafeLoader):
    """Stops early in a file of far too many values, which take some 20 us each."""

    nodes = 0

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        """Return the next node, unless it is one too many."""
        self.nodes += 1
        if self.nodes > _MOST_NODES:
            event = self.peek_event()  # type: ignore[no-untyped-call]
            raise _TooManyError(problem_mark=event.start_mark)
        return super().compose_node(parent, index)


class _Builder:
    """Plain data with positions from the nodes of one document."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.problems: list[Problem] = []
        self.nodes = 0

    def build(self, node: yaml.Node, keys: Keys) -> Any:
        """Return the value of a node that stands at ``keys``."""
        self.nodes += 1
        if self.nodes > _MOST_NODES:
            raise UserError(Problem(self.mark(node), "", f"{_TOO_MANY} after aliases"))
        if len(keys) > DEEPEST:
            what = f"nested more than {DEEPEST} levels deep"
            raise UserError(Problem(self.mark(node), "", what))
        if isinstance(node, yaml.CollectionNode) and node.tag not in _COLLECTION_TAGS:
            what = f"the tag {node.tag} is not allowed"
            self.problems.append(Problem(self.mark(node), dotted(keys), what))
        if isinstance(node, yaml.MappingNode):
            return self._mapping(node, keys)
        if isinstance(node, yaml.SequenceNode):
            items = MarkedList(self.build(item, (*keys, i)) for i, item in enumerate(node.value))
            items.marks.update((i, self.mark(item)) for i, item in enumerate(node.value))
            return items
        return self._scalar(node, keys)

    def mark(self, node: yaml.Node) -> Mark:
        """Return the position of a node."""
        return Mark(self.name, node.start_mark.line + 1, node.start_mark.column + 1)

    def _mapping(self, node: yaml.MappingNode, keys: Keys) -> MarkedMapping:
        mapping = MarkedMapping()
        before: yaml.Node | None = None
        for key_node, value_node in node.value:
            mark = self.mark(key_node)
            if (
                node.flow_style
                and before is not None
                and _is_after_comma(before, key_node, value_node)
            ):
                number = f"{before.value},{key_node.value}"
                place = (*keys, str(list(mapping)[-1]))
                what = f"{number} has a decimal comma; write {number.replace(',', '.')}"
                self.problems.append(Problem(self.mark(before), dotted(place), what))
                continue
            before = value_node
            if not isinstance(key_node, yaml.ScalarNode):
                self.problems.append(Problem(mark, dotted(keys), "a key must be a word"))
                continue
            key = str(key_node.value)
            at = (*keys, key)
            if node.flow_style and (how := _joined_key(key_node, value_node)):
                self.problems.append(Problem(mark, dotted(keys), how))
                continue
            # Mistakes in the key itself; a duplicate key would silently replace the first value.
            self._check_text(key, mark, keys)
            self._check_spaces(key_node, keys)
            if mistake := formula(key):
                self.problems.append(Problem(mark, dotted(keys), mistake))
            if key in mapping:
                what = f"duplicate key, first given on line {mapping.key_marks[key].line}"
                self.problems.append(Problem(mark, dotted(at), what))
                continue
            put(mapping, key, self.build(value_node, at), self.mark(value_node), mark)
        return mapping

    def _scalar(self, node: yaml.Node, keys: Keys) -> Scalar:
        # Only a scalar without quotes can be other than a word.
        is_plain = isinstance(node, yaml.ScalarNode) and node.style is None
        if node.tag not in (_PLAIN_TAGS if is_plain else _PLAIN_TAGS[:1]):
            what = f"the tag {node.tag} is not allowed"
            self.problems.append(Problem(self.mark(node), dotted(keys), what))
            return None
        text = str(node.value)
        self._check_text(text, self.mark(node), keys)
        self._check_spaces(node, keys)
        return scalar(text) if is_plain else text

    def _check_spaces(self, node: yaml.Node, keys: Keys) -> None:
        """Reject a no-break space around a word without quotes, or after its colon."""
        is_plain = isinstance(node, yaml.ScalarNode) and node.style is None
        space = _ODD_ENDS.search(str(node.value)) if is_plain else None
        if space is not None:
            mark = self.mark(node)
            what = _describe_space(mark.line, space.group().strip(":"))
            self.problems.append(Problem(mark, dotted(keys), what))

    def _check_text(self, text: str, mark: Mark, keys: Keys) -> None:
        if what := unprintable_reason(text):
            self.problems.append(Problem(mark, dotted(keys), what))


def _joined_key(key: yaml.Node, value: yaml.Node) -> str:
    """Explain a part of ``{kind:position, sigma = 50}`` that is all key; an empty text for others."""
    nodes = (key, value)
    if not all(isinstance(node, yaml.ScalarNode) and node.style is None for node in nodes):
        return ""
    match = re.fullmatch(r"([\w-]+)(:(?=\S)|\s*=\s*)(\S.*)", str(key.value))
    if match is None or value.value != "":
        return ""
    return f"{key.value!r} is no key with a value; write {match[1]}: {match[3]}"


def _is_after_comma(before: yaml.Node, key: yaml.Node, value: yaml.Node) -> bool:
    """Test whether ``{q: 0,1}`` was split at its comma: into ``q: 0`` and a key 1 without a value."""
    nodes = (before, key, value)
    if not all(isinstance(node, yaml.ScalarNode) and node.style is None for node in nodes):
        return False
    is_number = _INT.fullmatch(str(before.value)) and str(key.value).isdecimal()
    return bool(is_number) and value.value == ""


@runtime_checkable
class _NumpyValue(Protocol):
    """An array or number of numpy, which is not imported for it."""

    def tolist(self) -> object:
        """Return the value as plain numbers and lists."""


def from_mapping(config: Mapping[str, object]) -> Source:
    """Copy a Python mapping as a source; raises UserError for what YAML cannot express."""
    source = Source(None)
    source.data = marked(_as_plain(config, (), source), source.start)
    source.check()
    return source


def _as_plain(value: object, keys: Keys, source: Source) -> Any:
    if what := _inexpressible(value, keys):
        source.problems.append(Problem(source.start, dotted(keys), what))
        return None
    if isinstance(value, Mapping):
        return {key: _as_plain(inner, (*keys, key), source) for key, inner in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_as_plain(inner, (*keys, i), source) for i, inner in enumerate(value)]
    if isinstance(value, _NumpyValue):
        return _as_plain(value.tolist(), keys, source)
    return str(value) if isinstance(value, Path) else value


def _inexpressible(value: object, keys: Keys) -> str | None:
    """Explain why a Python value cannot be written into a config; None if it can."""
    if len(keys) > DEEPEST:
        return f"nested more than {DEEPEST} levels deep"
    if isinstance(value, Mapping):
        if not all(isinstance(key, str) for key in value):
            return "a key must be a word"
        reasons = (unprintable_reason(key) or formula(key) for key in value)
        return next(filter(None, reasons), None)
    if isinstance(value, str):
        return unprintable_reason(value)
    expressible = (bool, int, float, Path, Sequence, _NumpyValue, type(None))
    if isinstance(value, bytes) or not isinstance(value, expressible):
        name = type(value).__name__
        return f"is of the type {name}; a config holds words, numbers, lists and mappings"
    return None
