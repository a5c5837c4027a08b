"""Put a config together: include components from other files, and override keys by path."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

from trackbench.config.mistakes import unknown
from trackbench.errors import Mark, Problem, UserError, reason
from trackbench.field_types import require_regular_file
from trackbench.registry import Group, kinds, of_kind
from trackbench.yaml_source import (
    Keys,
    MarkedMapping,
    Source,
    dotted,
    has_item,
    marked,
    parse,
    put,
    read,
    scalar,
    unprintable_reason,
)

_GROUPS: dict[str, Group] = {
    "scenario": "scenarios",
    "filters": "filters",
    "tables": "tables",
    "figures": "figures",
}
_PARTS = ("filters", "tables", "figures")
_DEEPEST = 10  # files that use another file


def inline_parts(source: Source, folder: Path) -> dict[str, list[Problem]]:
    """Replace every path, and every ``{use: path, ...}``, by the mapping in that file.

    A part that cannot be read becomes an empty mapping; why is returned under its path.
    """
    # Step 1: where a component may stand.
    places: list[Keys] = [("scenario",)] if "scenario" in source.data else []
    tuning = source.data.get("tuning")
    if isinstance(tuning, dict) and tuning.get("scenario") is not None:
        places.append(("tuning", "scenario"))
    for group in _PARTS:
        if isinstance(source.data.get(group), dict):
            places += [(group, label) for label in source.data[group]]
    # Step 2: replace each by its file, then those within it.
    unread: dict[str, list[Problem]] = {}
    for keys in places:
        try:
            _inline(source, keys, folder, depth=0)
            if isinstance(source.at(keys), dict):
                _include_nested(source, keys, depth=0)
        except UserError as error:
            problems = [p for p in error.problems if isinstance(p, Problem)]
            unread[dotted(keys)] = [replace(p, path=p.path or dotted(keys)) for p in problems]
            source.at(keys[:-1])[keys[-1]] = MarkedMapping()  # to check the rest, too
    return unread


def _include_nested(source: Source, keys: Keys, depth: int) -> None:
    """Include the components within a component; paths are relative to their file."""
    data = source.at(keys)
    inner: Iterable[str | int] = data if isinstance(data, dict) else range(len(data))
    for key in list(inner):
        value, place = data[key], (*keys, key)
        is_file = isinstance(value, str) and key != "use" and value.endswith((".yaml", ".yml"))
        if is_file or (isinstance(value, dict) and "use" in value):
            _inline(source, place, Path(source.mark(place).file).parent, depth + 1)
            _include_nested(source, place, depth + 1)
        elif isinstance(value, dict | list):
            _include_nested(source, place, depth)


def override(source: Source, keys: Keys, value: object, mark: Mark) -> None:
    """Set the value at ``keys``, creating mappings on the way; all positions in it become ``mark``."""
    node = source.data
    for key in keys[:-1]:
        inner = node[key] if has_item(node, key) else None
        if not isinstance(inner, dict | list):
            inner = MarkedMapping()
            put(node, key, inner, mark)
        node = inner
    put(node, keys[-1], marked(value, mark), mark, mark)


def assignment(source: Source, text: str) -> tuple[Keys, object, Mark]:
    """Parse ``PATH=VALUE`` to keys, value and a mark; a label in the path may have an ``=`` itself.

    The value is read as in a file: ``null``, ``""``, ``[1, 2]`` and ``{kind: pf}`` are no words.
    """
    keys, value, mark = split_assignment(source, text, "--set")
    if not value.lstrip().startswith(("[", "{", '"', "'")):
        return keys, scalar(value.strip()), mark
    try:
        return keys, parse(value, mark.file).data, mark
    except UserError as error:
        whats = [p.what for p in error.problems if isinstance(p, Problem)]
        raise UserError(*(Problem(mark, dotted(keys), what) for what in whats)) from None


def split_assignment(source: Source, text: str, option: str) -> tuple[Keys, str, Mark]:
    """Split an assignment and keep the value as typed."""
    mark = Mark(f"{option} {text}")
    places = [i for i, c in enumerate(text) if c == "=" and i > 0]
    if not places or unprintable_reason(text):
        raise UserError(Problem(mark, "", unprintable_reason(text) or "write PATH=VALUE"))

    def depth(keys: Keys) -> int:
        return sum(source.has(keys[:n]) for n in range(1, len(keys) + 1))

    # Of several "=", the one whose left side leads deepest into the config.
    splits = [(split_path(source, text[:i]), text[i + 1 :]) for i in places]
    keys, value = max(splits, key=lambda split: depth(split[0]))
    return keys, value, mark


def split_path(source: Source, path: str) -> Keys:
    """Split a dotted path into keys; a key that has dots itself (a label) is recognized if it exists."""
    keys: Keys = ()
    data: object = source.data
    while path:
        known = (
            [k for k in data if path == k or path.startswith(f"{k}.")]
            if isinstance(data, dict)
            else []
        )
        key: str = max(known, key=len) if known else path.partition(".")[0]
        path = path[len(key) + 1 :]
        if isinstance(data, list):
            index = next((i for i in range(len(data)) if key == str(i)), None)
            if index is None:
                raise UserError(f"{dotted((*keys, key))}: no such item")
            keys, data = (*keys, index), data[index]
        else:
            keys, data = (*keys, key), data.get(key) if isinstance(data, dict) else None
    return keys


def _inline(source: Source, keys: Keys, folder: Path, depth: int) -> None:
    """Put the mapping in a file, with the keys beside ``use`` on top, in place of its path."""
    # Step 1: the path, and the keys beside `use`.
    parent = source.at(keys[:-1])
    name, changes = parent[keys[-1]], MarkedMapping()
    mark = source.mark(keys)
    if isinstance(name, dict):
        if "use" not in name:
            return
        mark = source.mark((*keys, "use"))
        changes = MarkedMapping(name)
        name = changes.pop("use")
        changes.marks.pop("use", None)
    if not isinstance(name, str):
        what = "is neither a mapping nor a path; write {kind: ...} or the path of a YAML file"
        raise UserError(Problem(mark, dotted(keys), what))
    if depth > _DEEPEST:
        raise UserError(Problem(mark, dotted(keys), "use: files that use each other in a circle"))
    # Step 2: read the file, and lay the keys over its mapping.
    path = folder / name
    try:
        require_regular_file(path)
    except OSError as error:
        what = f"cannot read {path}: {reason(error)}"
        group = _GROUPS.get(str(keys[0]))
        is_word = isinstance(parent[keys[-1]], str) and not name.endswith((".yaml", ".yml"))
        if group is not None and is_word and depth == 0:
            what = _instead_of_word(group, name, what)
        raise UserError(Problem(mark, dotted(keys), what)) from None
    part = read(path)
    if not isinstance(part.data, dict):
        raise UserError(Problem(part.start, dotted(keys), "is not a mapping with a kind"))
    whole = deep_merge(part.data, changes, by_kind=True)
    put(parent, keys[-1], whole, part.start)  # a part stands where its file begins
    if "use" in whole:
        _inline(source, keys, path.parent, depth + 1)


def _instead_of_word(group: Group, word: str, what: str) -> str:
    """Explain how a component is written, in place of a word that is no path."""
    if of_kind(group, word) is not None:
        return f"{word!r} is a kind, and not the path of a file; write {{kind: {word}}}"
    return f"{what}; a component is written {{kind: ...}}, {unknown(word, list(kinds(group)))}"


def deep_merge(
    base: Mapping[str, object], top: Mapping[str, object], by_kind: bool = False
) -> MarkedMapping:
    """Merge the keys of ``top`` into ``base``; a mapping in both is merged in the same way.

    ``by_kind``: a mapping of another kind, and so with other keys, replaces that of the base.
    """
    merged, on_top = MarkedMapping(base), MarkedMapping(top)
    merged.marks |= on_top.marks
    merged.key_marks |= on_top.key_marks
    for key, value in top.items():
        below = base.get(key)
        merged[key] = value
        if isinstance(below, dict) and isinstance(value, dict):
            is_other_kind = value.get("kind", below.get("kind")) != below.get("kind")
            if not (by_kind and is_other_kind):
                merged[key] = deep_merge(below, value, by_kind)
    return merged
