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
        """position of each key's value"""
        self.key_marks: dict[str | int, Mark] = {}
        """position of each key itself"""
        if isinstance(items, MarkedMapping):
            self.marks |= items.marks
            self.key_marks |= items.key_marks


class MarkedList(list[Any]):
    """A list of a config that carries the positions of its items."""

    def __init__(self, items: Iterable[object] = ()) -> None:
        super().__init__(items)
        self.marks: dict[str | int, Mark] = {}
        """position of each item, by its index"""
        self.key_marks: dict[str | int, Mark] = {}
        """position of an item again, where `put` got one, since an item has no key"""


yaml.SafeDumper.add_representer(MarkedMapping, yaml.SafeDumper.represent_dict)
yaml.SafeDumper.add_representer(MarkedList, yaml.SafeDumper.represent_list)


def put(node: Any, key: str | int, value: object, mark: Mark, key_mark: Mark | None = None) -> None:
    """Set the value of a key of a mapping, or the item at an index of a list, in place.

    ``mark`` is the position of the value, and ``key_mark`` that of the key.
    """
    node[key] = value
    if isinstance(node, MarkedMapping | MarkedList):
        node.marks[key] = mark
        if key_mark is not None:
            node.key_marks[key] = key_mark


def marked(value: object, mark: Mark) -> Any:
    """Return a copy of plain data in which everything stands at one position, ``mark``."""
    if isinstance(value, dict):
        mapping = MarkedMapping()
        for key, inner in value.items():
            put(mapping, key, marked(inner, mark), mark, mark)
        return mapping
    if isinstance(value, list):
        items = MarkedList(value)
        for i, item in enumerate(value):
            put(items, i, marked(item, mark), mark, mark)
        return items
    return value


@dataclass
class Source:
    """The data of a config, which carry their positions, and the mistakes found in them."""

    data: Any
    start: Mark = _NOWHERE
    """position of the whole"""
    problems: list[Problem] = field(default_factory=list)
    programs: set[str] | None = field(default_factory=set)  # that the user allows; None: all
    typed_folders: dict[str, str] = field(default_factory=dict)
    """absolute paths of the folders of data files, and these paths as the user wrote them"""

    def value_at(self, keys: Keys) -> Any:
        """Return the value at ``keys``."""
        value = self.data
        for key in keys:
            value = value[key]
        return value

    def mark(self, keys: Keys) -> Mark:
        """Return the position of a value, or of the nearest one around it.

        The index of a list's item may be a word of digits.
        """
        node: Any = self.data
        mark = self.start
        for key in keys:
            if isinstance(node, list) and isinstance(key, str) and key.isdecimal():
                key = int(key)
            marks = getattr(node, "marks", {})  # plain data have none
            if key not in marks:
                break
            mark = marks[key]
            if not has_item(node, key):
                break
            node = node[key]
        return mark

    def key_mark(self, keys: Keys) -> Mark:
        """Return the position of a key; of the value where the key has none."""
        if not keys:
            return self.start
        if self.has(keys[:-1]):
            parent = self.value_at(keys[:-1])
            if isinstance(parent, MarkedMapping | MarkedList) and keys[-1] in parent.key_marks:
                return parent.key_marks[keys[-1]]
        return self.mark(keys)

    def has(self, keys: Keys) -> bool:
        """Return whether there is a value at ``keys``."""
        node = self.data
        for key in keys:
            if not has_item(node, key):
                return False
            node = node[key]
        return True

    def is_set(self, keys: Keys) -> bool:
        """Return whether there is a value at ``keys`` that is not null."""
        return self.has(keys) and self.value_at(keys) is not None

    def problem(self, keys: Keys, text: str) -> Problem:
        """Return a mistake in the value at ``keys``, which ``text`` explains."""
        return Problem(self.mark(keys), dotted(keys), text)

    def add_problem(self, keys: Keys, text: str) -> None:
        """Add a mistake in the value at ``keys``, which ``text`` explains."""
        self.problems.append(self.problem(keys, text))

    def add_key_problem(self, keys: Keys, text: str) -> None:
        """Add a mistake in the key itself, which ``text`` explains."""
        self.problems.append(Problem(self.key_mark(keys), dotted(keys), text))

    def check(self) -> None:
        """Raise UserError with every mistake that was added, if there are any."""
        if self.problems:
            raise UserError(*sorted(set(self.problems)))

    def replaced(self, keys: Keys, value: object) -> "Source":
        """Return a config with another value at ``keys``, and no problems.

        It shares all other values with this config, which stays as it is.
        """
        # Copy the mappings on the way to the value.
        data = MarkedMapping(self.data)
        node = data
        for key in keys[:-1]:
            inner = MarkedMapping(node[str(key)])
            node[str(key)] = inner
            node = inner
        put(node, keys[-1], value, self.mark(keys))
        return Source(data, self.start, programs=self.programs, typed_folders=self.typed_folders)


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
        text = _read_stdin() if is_stdin else text_of(path)
        return parse(text, name)
    except OSError as error:
        # A file that cannot be read is reported at its beginning.
        raise UserError(Problem(Mark(name, 1, 1), "", reason(error))) from None


def text_of(path: Path) -> str:
    """Read a text file of at most 1 MB; raises OSError."""
    size = require_regular_file(path).stat().st_size
    if size > _LARGEST_FILE:
        raise OSError(errno.EFBIG, f"has {size} bytes, and may have 1 MB at most")
    return _decoded(path.read_bytes())


@cache
def _read_stdin() -> str:
    """Read stdin as text. The text is kept, since stdin can be read only once; raises OSError."""
    content = sys.stdin.buffer.read(_LARGEST_FILE + 1)
    if len(content) > _LARGEST_FILE:
        raise OSError(errno.EFBIG, "has more than 1 MB")
    return _decoded(content)


def _decoded(content: bytes) -> str:
    """Return the text of a file with this content, with line ends of one character.

    Raises OSError if it is not UTF-8.
    """
    try:
        text = content.decode("utf-8-sig")  # a byte order mark is left out
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


def explain_formula(text: str) -> str | None:
    """Explain that a spreadsheet would run a word as a formula; None if it would not.

    A negative number begins with ``-``, but is no word.
    """
    if not text.startswith(tuple(FORMULA)) or not isinstance(scalar(text), str):
        return None
    return f"{text!r} begins with {text[0]}, as a formula of a spreadsheet; put another character first"


def parse(text: str, name: str) -> Source:
    """Parse YAML text; ``name`` is how messages name it."""
    node = None
    mark = Mark(name, 1, 1)
    mistake = "is empty"
    try:
        node = _composed(text)
    except yaml.MarkedYAMLError as error:
        mark, mistake = _explain_invalid_yaml(error, text, name)
    except yaml.YAMLError as error:
        mistake = f"not valid YAML: {str(error).splitlines()[0]}"
    except RecursionError:
        mistake = "is nested too deeply"
    if node is None:
        raise UserError(Problem(mark, "", mistake))
    # Plain data with positions from the composed nodes.
    builder = _Builder(name)
    source = Source(builder.build(node, ()), builder.mark(node), builder.problems)
    if builder.problems:
        raise UserError(*builder.problems)
    return source


def _explain_invalid_yaml(error: yaml.MarkedYAMLError, text: str, name: str) -> tuple[Mark, str]:
    """Find the place of an error of YAML's grammar, and explain it: return the place and a message.

    ``text`` is the text of the file, ``name`` how messages name it.
    """
    mark = Mark(name)
    position = error.problem_mark or error.context_mark
    if position is not None:
        mark = Mark(name, position.line + 1, position.column + 1)
    if isinstance(error, _TooManyError):
        return mark, _TOO_MANY
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
            message = f"not valid YAML: {_describe_space(number, space.group())}"
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
        if len(text) >= _LONGEST_NUMBER:  # so many digits are read as a word
            return text
        return int(text)
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
        """Begin with no node; ``name`` is how messages name the document."""
        self.name = name
        self.problems: list[Problem] = []
        self.nodes = 0
        """nodes that were built, one at each alias counted again"""

    def build(self, node: yaml.Node, keys: Keys) -> Any:
        """Return the value of a node that stands at ``keys``."""
        # A node is counted at each alias to it: a few nested aliases can stand for billions of values.
        self.nodes += 1
        if self.nodes > _MOST_NODES:
            raise UserError(Problem(self.mark(node), "", f"{_TOO_MANY} after aliases"))
        if len(keys) > DEEPEST:
            raise UserError(Problem(self.mark(node), "", f"nested more than {DEEPEST} levels deep"))
        if isinstance(node, yaml.CollectionNode) and node.tag not in _COLLECTION_TAGS:
            self._add_problem(self.mark(node), keys, f"the tag {node.tag} is not allowed")
        if isinstance(node, yaml.MappingNode):
            return self._build_mapping(node, keys)
        if isinstance(node, yaml.SequenceNode):
            items = MarkedList()
            for i, item in enumerate(node.value):
                items.append(self.build(item, (*keys, i)))
                items.marks[i] = self.mark(item)
            return items
        return self._build_scalar(node, keys)

    def mark(self, node: yaml.Node) -> Mark:
        """Return the position of a node."""
        return Mark(self.name, node.start_mark.line + 1, node.start_mark.column + 1)

    def _build_mapping(self, node: yaml.MappingNode, keys: Keys) -> MarkedMapping:
        """Return the mapping of a node; add a problem for each key that a config cannot have.

        These keys are left out.
        """
        mapping = MarkedMapping()
        value_before: yaml.Node | None = None
        for key_node, value_node in node.value:
            mark = self.mark(key_node)
            if (
                node.flow_style
                and value_before is not None
                and _is_after_comma(value_before, key_node, value_node)
            ):
                # {q: 0,1} reads as q: 0 and a key 1: the number is that of the key before.
                number = f"{value_before.value},{key_node.value}"
                keys_before = (*keys, str(list(mapping)[-1]))
                comma = f"{number} has a decimal comma; write {number.replace(',', '.')}"
                self._add_problem(self.mark(value_before), keys_before, comma)
                continue
            value_before = value_node
            if not isinstance(key_node, yaml.ScalarNode):
                self._add_problem(mark, keys, "a key must be a word")
                continue
            key = str(key_node.value)
            if node.flow_style:
                joined = _explain_joined_key(key_node, value_node)
                if joined:
                    self._add_problem(mark, keys, joined)
                    continue
            # Mistakes in the key itself; a duplicate key would silently replace the first value.
            self._check_text(key, mark, keys)
            self._check_spaces(key_node, keys)
            mistake = explain_formula(key)
            if mistake:
                self._add_problem(mark, keys, mistake)
            keys_of_value = (*keys, key)
            if key in mapping:
                duplicate = f"duplicate key, first given on line {mapping.key_marks[key].line}"
                self._add_problem(mark, keys_of_value, duplicate)
                continue
            value = self.build(value_node, keys_of_value)
            put(mapping, key, value, self.mark(value_node), mark)
        return mapping

    def _build_scalar(self, node: yaml.Node, keys: Keys) -> Scalar:
        """Return the value of a scalar; add a problem for one that a config cannot have."""
        # Only a scalar without quotes can be other than a word, whose tag is the first.
        allowed_tags = _PLAIN_TAGS[:1]
        if _is_plain(node):
            allowed_tags = _PLAIN_TAGS
        if node.tag not in allowed_tags:
            self._add_problem(self.mark(node), keys, f"the tag {node.tag} is not allowed")
            return None
        text = str(node.value)
        self._check_text(text, self.mark(node), keys)
        self._check_spaces(node, keys)
        if _is_plain(node):
            return scalar(text)
        return text

    def _check_spaces(self, node: yaml.Node, keys: Keys) -> None:
        """Reject a no-break space around a word without quotes, or after its colon."""
        if not _is_plain(node):
            return
        space = _ODD_ENDS.search(str(node.value))
        if space is not None:
            mark = self.mark(node)
            character = space.group().strip(":")  # the match may begin with a colon
            self._add_problem(mark, keys, _describe_space(mark.line, character))

    def _check_text(self, text: str, mark: Mark, keys: Keys) -> None:
        """Add a problem for a text with an unprintable character."""
        mistake = unprintable_reason(text)
        if mistake:
            self._add_problem(mark, keys, mistake)

    def _add_problem(self, mark: Mark, keys: Keys, text: str) -> None:
        self.problems.append(Problem(mark, dotted(keys), text))


def _is_plain(node: yaml.Node) -> bool:
    """Test whether a node is a scalar without quotes."""
    return isinstance(node, yaml.ScalarNode) and node.style is None


def _explain_joined_key(key: yaml.Node, value: yaml.Node) -> str:
    """Explain a part of ``{kind:position, sigma = 50}`` that is all key; an empty text for others."""
    if not _is_plain(key) or not _is_plain(value):
        return ""
    match = re.fullmatch(r"([\w-]+)(:(?=\S)|\s*=\s*)(\S.*)", str(key.value))
    if match is None or value.value != "":
        return ""
    return f"{key.value!r} is no key with a value; write {match[1]}: {match[3]}"


def _is_after_comma(before: yaml.Node, key: yaml.Node, value: yaml.Node) -> bool:
    """Test whether ``{q: 0,1}`` was split at its comma: into ``q: 0`` and a key 1 without a value."""
    if not _is_plain(before) or not _is_plain(key) or not _is_plain(value):
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
    """Return a Python value as plain data: mappings, lists and scalars.

    What a config cannot express becomes None, with a problem added to the source.
    """
    mistake = _inexpressible(value, keys)
    if mistake:
        source.problems.append(Problem(source.start, dotted(keys), mistake))
        return None
    if isinstance(value, Mapping):
        return {key: _as_plain(inner, (*keys, key), source) for key, inner in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_as_plain(inner, (*keys, i), source) for i, inner in enumerate(value)]
    if isinstance(value, _NumpyValue):  # an array, or a number of numpy
        return _as_plain(value.tolist(), keys, source)
    if isinstance(value, Path):
        return str(value)
    return value


def _inexpressible(value: object, keys: Keys) -> str | None:
    """Explain why a Python value cannot be written into a config; None if it can."""
    if len(keys) > DEEPEST:
        return f"nested more than {DEEPEST} levels deep"
    if isinstance(value, Mapping):
        if not all(isinstance(key, str) for key in value):
            return "a key must be a word"
        reasons = (unprintable_reason(key) or explain_formula(key) for key in value)
        return next(filter(None, reasons), None)
    if isinstance(value, str):
        return unprintable_reason(value)
    expressible = (bool, int, float, Path, Sequence, _NumpyValue, type(None))
    if isinstance(value, bytes) or not isinstance(value, expressible):
        name = type(value).__name__
        return f"is of the type {name}; a config holds words, numbers, lists and mappings"
    return None
