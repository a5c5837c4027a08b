"""Putting a config together: parts from other files, and overrides by path."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

from trackbench.config.build_dataclass import at
from trackbench.errors import Mark, Problem, UserError, reason
from trackbench.field_types import require_regular_file
from trackbench.yaml_source import Keys, Source, dotted, parse, read, scalar, unprintable_reason

_PARTS = ("filters", "tables", "figures")


def inline_parts(source: Source, folder: Path) -> dict[str, list[Problem]]:
    """Replace every path, and every ``{use: path, ...}``, by the mapping in that file.

    A part that cannot be read becomes an empty mapping; why is returned under its path.
    """
    places: list[Keys] = [("scenario",)] if "scenario" in source.data else []
    tuning = source.data.get("tuning")
    if isinstance(tuning, dict) and tuning.get("scenario") is not None:
        places.append(("tuning", "scenario"))
    for group in _PARTS:
        if isinstance(source.data.get(group), dict):
            places += [(group, label) for label in source.data[group]]
    unread: dict[str, list[Problem]] = {}
    for keys in places:
        try:
            _inline(source, keys, folder, depth=0)
            if isinstance(at(source, keys), dict):
                _include_nested(source, keys, depth=0)
        except UserError as error:
            found = [p for p in error.problems if isinstance(p, Problem)]
            unread[dotted(keys)] = [replace(p, path=p.path or dotted(keys)) for p in found]
            at(source, keys[:-1])[keys[-1]] = {}  # so that the rest can be looked at, too
    return unread


def _include_nested(source: Source, keys: Keys, depth: int) -> None:
    """Include the components within a component; paths are relative to their file."""
    data = at(source, keys)
    inner: Iterable[str | int] = data if isinstance(data, dict) else range(len(data))
    for key in list(inner):
        value, place = data[key], (*keys, key)
        is_file = isinstance(value, str) and key != "use" and value.endswith((".yaml", ".yml"))
        if is_file or (isinstance(value, dict) and "use" in value):
            _inline(source, place, Path(source.mark(place).file).parent, depth + 1)
            _include_nested(source, place, depth + 1)
        elif isinstance(value, dict | list):
            _include_nested(source, place, depth)


def override(source: Source, keys: Keys, value: Any, mark: Mark) -> None:
    """Set the value at ``keys``, making mappings on the way; all positions in it become ``mark``."""
    data = source.data
    for depth, key in enumerate(keys[:-1]):
        inner = data.get(key) if isinstance(data, dict) else data[key]
        if not isinstance(inner, dict | list):
            data[key] = inner = {}
            source.marks[keys[: depth + 1]] = mark
        data = inner
    before = data.get(keys[-1]) if isinstance(data, dict) else data[keys[-1]]
    data[keys[-1]] = value
    if isinstance(before, dict | list):
        for marks in (source.marks, source.key_marks):
            for old in [k for k in marks if k[: len(keys)] == keys]:
                del marks[old]
    _mark_all(source, keys, value, mark)


def _mark_all(source: Source, keys: Keys, value: Any, mark: Mark) -> None:
    source.marks[keys] = source.key_marks[keys] = mark
    inner = (
        value if isinstance(value, dict) else range(len(value)) if isinstance(value, list) else ()
    )
    for key in inner:
        _mark_all(source, (*keys, key), value[key], mark)


def assignment(source: Source, text: str) -> tuple[Keys, Any, Mark]:
    """Return ``PATH=VALUE`` as keys, value and a mark; a label in the path may have an ``=`` itself.

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
    best: tuple[int, Keys, str] | None = None
    for i in places:
        keys = split_path(source, text[:i])
        known = _known_depth(source, keys)
        if best is None or known > best[0]:
            best = known, keys, text[i + 1 :]
    assert best is not None
    return best[1], best[2], mark


def _known_depth(source: Source, keys: Keys) -> int:
    """Return the number of leading keys that exist."""
    return sum(keys[:depth] in source.marks for depth in range(1, len(keys) + 1))


def split_path(source: Source, path: str) -> Keys:
    """Return a dotted path as keys; a key that has dots itself (a label) is recognised if it exists."""
    keys: Keys = ()
    data: Any = source.data
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
    parent = at(source, keys[:-1])
    data = parent[keys[-1]]
    changes: dict[str, Any] = {}
    name = data
    if isinstance(data, dict):
        if "use" not in data:
            return
        changes = {k: v for k, v in data.items() if k != "use"}
        name = data["use"]
    mark = source.mark((*keys, "use") if isinstance(data, dict) else keys)
    if not isinstance(name, str):
        raise UserError(Problem(mark, dotted(keys), "is neither a mapping nor a path"))
    if depth > 10:
        raise UserError(Problem(mark, dotted(keys), "use: files that use each other in a circle"))
    path = folder / name
    try:
        require_regular_file(path)
    except OSError as error:
        what = f"cannot read {path}: {reason(error)}"
        raise UserError(Problem(mark, dotted(keys), what)) from None
    part = read(path)
    if not isinstance(part.data, dict):
        raise UserError(Problem(part.mark(()), dotted(keys), "is not a mapping with a kind"))
    own = source.subtree(keys, changes)
    own.marks.pop((), None)  # the part stands where its file begins
    source.adopt_positions(keys, part)
    source.adopt_positions(keys, own)
    parent[keys[-1]] = deep_merge(part.data, changes, by_kind=True)
    if "use" in part.data:
        parent[keys[-1]]["use"] = part.data["use"]
        _inline(source, keys, path.parent, depth + 1)


def deep_merge(base: dict[str, Any], top: dict[str, Any], by_kind: bool = False) -> dict[str, Any]:
    """Return ``base`` with the keys of ``top``; a mapping in both is laid over in the same way.

    ``by_kind``: but of another kind, and so with other keys, it stands in place of the base's.
    """

    def both(key: str, value: Any) -> Any:
        mine = base.get(key)
        if not isinstance(mine, dict) or not isinstance(value, dict):
            return value
        other = by_kind and value.get("kind", mine.get("kind")) != mine.get("kind")
        return value if other else deep_merge(mine, value, by_kind)

    return {**base, **{key: both(key, value) for key, value in top.items()}}
