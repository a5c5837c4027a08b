"""YAML with positions: mappings and lists that carry the place of every key and value.

Numbers follow YAML 1.2 (``1e-5`` is a number, ``no`` is a word). Duplicate keys, tags and unreasonable
sizes are mistakes. Only plain types are ever constructed.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeAlias

import yaml

from trackbench.errors import Mark, Problem, UserError, reason
from trackbench.readable_files import text_of, text_of_stdin
from trackbench.unsafe_characters import explain_formula, unprintable_reason
from trackbench.yaml_mistakes import (
    MOST_NODES,
    ODD_ENDS,
    TOO_MANY,
    TooManyError,
    describe_space,
    explain_invalid_yaml,
    explain_joined_key,
    is_after_comma,
    is_plain,
)
from trackbench.yaml_scalars import Scalar, scalar

Keys: TypeAlias = tuple[str | int, ...]
"""Keys and list indices that lead to a value."""

DEEPEST = 50  # levels
_PLAIN_TAGS = [
    f"tag:yaml.org,2002:{name}"
    for name in ("str", "int", "float", "bool", "null", "timestamp", "merge", "value")
]
_COLLECTION_TAGS = ("tag:yaml.org,2002:map", "tag:yaml.org,2002:seq")
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

    Parameters
    ----------
    node
        mapping or list; a plain one gets no positions
    key
        key, or index of an item
    value
        new value
    mark
        position of the value
    key_mark
        position of the key; None leaves it as it is
    """
    node[key] = value
    if isinstance(node, MarkedMapping | MarkedList):
        node.marks[key] = mark
        if key_mark is not None:
            node.key_marks[key] = key_mark


def marked(value: object, mark: Mark) -> Any:
    """Return a copy of plain data in which everything stands at one position.

    Parameters
    ----------
    value
        mapping, list or scalar
    mark
        position of each key, value and item

    Returns
    -------
    MarkedMapping, MarkedList or scalar
        copy with positions; a scalar is returned as it is
    """
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

        Parameters
        ----------
        keys
            keys and indices that lead to the value. The index of a list's item may be a word of digits

        Returns
        -------
        Mark
            position of the value. A key that was removed keeps its position
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
            if not has_item(node, key):  # a key that was removed keeps its position
                break
            node = node[key]
        return mark

    def key_mark(self, keys: Keys) -> Mark:
        """Return the position of a key.

        Parameters
        ----------
        keys
            keys and indices that lead to the key, which is the last of them; empty means the whole
            config

        Returns
        -------
        Mark
            position of the key, or of its value if the key has none
        """
        if not keys:
            return self.start
        if self.has(keys[:-1]):
            parent = self.value_at(keys[:-1])
            if isinstance(parent, MarkedMapping | MarkedList) and keys[-1] in parent.key_marks:
                return parent.key_marks[keys[-1]]
        return self.mark(keys)

    def has(self, keys: Keys) -> bool:
        """Return whether there is a value at ``keys``.

        Parameters
        ----------
        keys
            keys and indices that lead to the value

        Returns
        -------
        bool
            True also for a value that is null
        """
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

        Parameters
        ----------
        keys
            keys that lead to the value, through mappings alone
        value
            new value; it gets the position of the old one

        Returns
        -------
        Source
            copy that shares all other values with this config, which stays as it is
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
    """Parse a YAML file.

    Parameters
    ----------
    path
        file, or ``-`` for stdin
    shown
        name of the file in messages; None means its path

    Returns
    -------
    Source
        data with their positions

    Raises
    ------
    UserError
        if the file cannot be read or has mistakes, with one line per mistake
    """
    is_stdin = str(path) == "-"
    name = "stdin" if is_stdin else shown or str(path)
    try:
        text = text_of_stdin() if is_stdin else text_of(path)
        return parse(text, name)
    except OSError as error:
        # A file that cannot be read is reported at its beginning.
        raise UserError(Problem(Mark(name, 1, 1), "", reason(error))) from None


def parse(text: str, name: str) -> Source:
    """Parse YAML text.

    Parameters
    ----------
    text
        content of a config
    name
        name of the config in messages

    Returns
    -------
    Source
        data with their positions

    Raises
    ------
    UserError
        if the text is empty, nested too deeply or no valid YAML, and for keys and values that a config
        cannot have, with one line per mistake
    """
    node = None
    mark = Mark(name, 1, 1)
    mistake = "is empty"
    try:
        node = _composed(text)
    except yaml.MarkedYAMLError as error:
        mark, mistake = explain_invalid_yaml(error, text, name)
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


@lru_cache(maxsize=128)
def _composed(text: str) -> yaml.Node | None:
    """Parse a document; cached, since experiments share their parts."""
    return _Loader(text).get_single_node()


class _Loader(yaml.SafeLoader):
    """Stops early in a file of far too many values, which take some 20 us each."""

    nodes = 0

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        """Return the next node, unless it is one too many."""
        self.nodes += 1
        if self.nodes > MOST_NODES:
            event = self.peek_event()  # type: ignore[no-untyped-call]
            raise TooManyError(problem_mark=event.start_mark)
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
        if self.nodes > MOST_NODES:
            raise UserError(Problem(self.mark(node), "", f"{TOO_MANY} after aliases"))
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
                and is_after_comma(value_before, key_node, value_node)
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
                joined = explain_joined_key(key_node, value_node)
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
        if is_plain(node):
            allowed_tags = _PLAIN_TAGS
        if node.tag not in allowed_tags:
            self._add_problem(self.mark(node), keys, f"the tag {node.tag} is not allowed")
            return None
        text = str(node.value)
        self._check_text(text, self.mark(node), keys)
        self._check_spaces(node, keys)
        if is_plain(node):
            return scalar(text)
        return text

    def _check_spaces(self, node: yaml.Node, keys: Keys) -> None:
        """Reject a no-break space around a word without quotes, or after its colon."""
        if not is_plain(node):
            return
        space = ODD_ENDS.search(str(node.value))
        if space is not None:
            mark = self.mark(node)
            character = space.group().strip(":")  # the match may begin with a colon
            self._add_problem(mark, keys, describe_space(mark.line, character))

    def _check_text(self, text: str, mark: Mark, keys: Keys) -> None:
        """Add a problem for a text with an unprintable character."""
        mistake = unprintable_reason(text)
        if mistake:
            self._add_problem(mark, keys, mistake)

    def _add_problem(self, mark: Mark, keys: Keys, text: str) -> None:
        self.problems.append(Problem(mark, dotted(keys), text))
