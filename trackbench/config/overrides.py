"""Override keys of a config by path: ``PATH=VALUE``, as in ``--set filters.PF.N=100``."""

from collections.abc import Mapping, Sequence

from trackbench.config.did_you_mean import unknown
from trackbench.config.includes import COMPONENT_GROUPS
from trackbench.errors import Mark, Problem, UserError, counted, first_names
from trackbench.unsafe_characters import unprintable_reason
from trackbench.yaml_scalars import scalar
from trackbench.yaml_source import Keys, MarkedMapping, Source, dotted, has_item, marked, parse, put


def override(source: Source, keys: Keys, value: object, mark: Mark) -> None:
    """Set the value at ``keys``, creating mappings on the way; all positions in it become ``mark``.

    A position is where messages report a mistake: in a file, or in an option such as `--set`.
    """
    node = source.data
    for key in keys[:-1]:
        inner = None
        if has_item(node, key):
            inner = node[key]
        if not isinstance(inner, dict | list):
            inner = MarkedMapping()
            # The new mapping gets the position. A key that stands in the file keeps its own position.
            put(node, key, inner, mark)
        node = inner
    # Both the value and its key get the position.
    put(node, keys[-1], marked(value, mark), mark, mark)


def assignment(source: Source, text: str) -> tuple[Keys, object, Mark]:
    """Parse ``PATH=VALUE`` to keys, value and a mark; a label in the path may have an ``=`` itself.

    The mark is the position that messages show for the value: the option `--set` with this text.
    The value is read as in a file: ``null``, ``""``, ``[1, 2]`` and ``{kind: pf}`` are no words.
    """
    keys, text_of_value, mark = split_assignment(source, text, "--set")
    if not text_of_value.lstrip().startswith(("[", "{", '"', "'")):
        return keys, scalar(text_of_value.strip()), mark
    try:
        value = parse(text_of_value, mark.file).data
    except UserError as error:
        # The mistakes are reported at the path of the assignment.
        problems = []
        for problem in error.problems:
            if isinstance(problem, Problem):
                problems.append(Problem(mark, dotted(keys), problem.message))
        raise UserError(*problems) from None
    return keys, value, mark


def override_all(source: Source, texts: Sequence[str]) -> list[Keys]:
    """Set the values of assignments ``PATH=VALUE`` one after the other, and return the keys of each.

    Raises UserError if a path has two values.
    """
    texts_by_keys: dict[Keys, str] = {}
    filters = source.data.get("filters")
    labels = list(filters) if isinstance(filters, dict) else []
    for text in texts:
        keys, value, mark = assignment(source, text)
        check_single_value(texts_by_keys, keys, text, mark)  # also adds the text to `texts_by_keys`
        override(source, keys, value, mark)
    if isinstance(filters, dict):
        _check_labels(source, texts_by_keys, labels)
    return list(texts_by_keys)


def _check_labels(source: Source, texts_by_keys: Mapping[Keys, str], labels: list[str]) -> None:
    """Raise UserError if an assignment sets a key of a filter that does not exist.

    ``labels`` are those of the filters before the assignments. These may add a filter by its `kind`.
    """
    problems = []
    for keys in texts_by_keys:
        if len(keys) < 3 or keys[0] != "filters" or keys[1] in labels:
            continue
        entry = source.value_at(keys[:2])
        if isinstance(entry, dict) and not entry.keys() & {"kind", "use"}:
            hint = unknown(str(keys[1]), labels)
            if hint.startswith("did you mean"):
                hint += f" (filters: {first_names(labels, 20)})"
            message = (
                f"there is no filter {str(keys[1])!r}; {hint}; a filter is added by "
                "`--set 'filters.LABEL={kind: KIND}'` or `--filter FILE`"
            )
            problems.append(Problem(source.mark(keys), dotted(keys), message))
    if problems:
        raise UserError(*problems)


def check_single_value(texts_by_keys: dict[Keys, str], keys: Keys, text: str, mark: Mark) -> None:
    """Raise UserError if an earlier assignment gives another value to the same path.

    ``text`` is the assignment ``PATH=VALUE``, ``keys`` its path. It is added to ``texts_by_keys``, which
    has the earlier assignments.
    """
    other = texts_by_keys.setdefault(keys, text)
    if other != text:
        message = f"has another value in --set {other}: leave one of them out"
        raise UserError(Problem(mark, dotted(keys), message))


def split_assignment(source: Source, text: str, option: str) -> tuple[Keys, str, Mark]:
    """Split ``PATH=VALUE``, given to ``option``, into the path's keys, the value as typed, and a mark.

    The mark is the position that messages show: the option with this text, in place of a line of a file.
    Raises UserError for a text without ``=``.
    """
    mark = Mark(f"{option} {text}")
    equals_places = [i for i, c in enumerate(text) if c == "=" and i > 0]
    if not equals_places or unprintable_reason(text):
        raise UserError(Problem(mark, "", unprintable_reason(text) or "write PATH=VALUE"))

    # Of several "=", the one whose left side leads deepest into the config.
    deepest = -1
    for i in equals_places:
        path_keys = split_path(source, text[:i])
        depth = sum(source.has(path_keys[:n]) for n in range(1, len(path_keys) + 1))
        if depth > deepest:
            deepest = depth
            keys = path_keys
            value = text[i + 1 :]
    return keys, value, mark


class MissingItemError(UserError):
    """A path that leads through a list, and names none of its items."""

    def __init__(self, keys: Keys, key: str, rest: str, length: int) -> None:
        """Explain that a list of so many items, its ``length``, at ``keys`` has no item ``key``.

        ``rest`` is the path behind this key.
        """
        self.key = key
        self.length = length
        place = dotted((*keys, key))
        message = f"no such item; the list has {counted(length, 'item')}, numbered from 0"
        if not self.is_number:
            example = dotted((*keys, 0, key)) + (f".{rest}" if rest else "")
            way = f"name one of its items by number, from 0: {example}"
            message = f"{dotted(keys)} is a list: {way}"
        super().__init__(f"{place}: {message}")

    @property
    def is_number(self) -> bool:
        """True if the path names an item by number, and the list is shorter."""
        return self.key.isascii() and self.key.isdigit()


def split_path(source: Source, path: str) -> Keys:
    """Split a dotted path into keys; a key that has dots itself (a label) is recognized if it exists."""
    keys: Keys = ()
    data: object = source.data
    rest = path
    while rest:
        # The next key: the longest existing one, or the text up to the next dot.
        key = rest.partition(".")[0]
        if isinstance(data, dict):
            existing = [k for k in data if rest == k or rest.startswith(f"{k}.")]
            if existing:
                key = max(existing, key=len)
        rest = rest[len(key) + 1 :]
        # Its value, in which the next key is looked up.
        if isinstance(data, list):
            index = next((i for i in range(len(data)) if key == str(i)), None)
            if index is None:
                raise MissingItemError(keys, key, rest, len(data))
            keys = (*keys, index)
            data = data[index]
        else:
            keys = (*keys, key)
            data = data.get(key) if isinstance(data, dict) else None
    return keys


def check_overridden_parts(source: Source, overridden: Sequence[Keys]) -> None:
    """Raise UserError if an option gives the path of a file to a component of the config.

    The files of components are read before options change single keys. ``overridden`` are the keys that
    options have set.
    """
    problems = []
    for keys in overridden:
        value = source.value_at(keys)
        if isinstance(value, dict):
            value = value.get("use")
        is_component = keys[0] in COMPONENT_GROUPS or keys[:2] == ("tuning", "scenario")
        is_file = isinstance(value, str) and value.endswith((".yaml", ".yml"))
        if is_component and is_file:
            message = f"{value} is a file, and options read no files: write `{keys[-1]}: {value}`"
            example = f"--set {dotted(keys)}.KEY=VALUE"
            way = f"into the config in place of its `{keys[-1]}`, or change single keys, {example}"
            problems.append(Problem(source.mark(keys), dotted(keys), f"{message} {way}"))
    if problems:
        raise UserError(*problems)
